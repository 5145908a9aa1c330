"""Offline comparison: from a .tlog to its report, the steps in order, and the report as text for people."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from groundstation.analysis.shadow.facts import Commands, Facts, measured
from groundstation.analysis.shadow.flight import hover_share, thrust_shares
from groundstation.analysis.shadow.judge import Check, checks, verdict
from groundstation.analysis.shadow.path import FlownPath
from groundstation.analysis.shadow.recording import read_recording
from groundstation.analysis.shadow.replay import replay
from groundstation.analysis.shadow.vehicle import completed, described, latency_s, mavlink


class Report(Facts, frozen=True, kw_only=True):
    """A replay in numbers, and what to make of them: the object that ``--json`` prints."""

    verdict: str
    """``fit``, ``fit with care`` or ``not fit`` to fly on."""
    reasons: list[str]
    """The sentences that the verdict rests on: every one that is not fine, or all where all are."""
    checks: list[Check]
    """Everything that was looked at."""


def report(file: Path, config_path: Path | None = None, overrides: Sequence[str] = ()) -> Report:
    """Replay ``file``. The same file and configuration give the same report, to the last bit.

    Raises:
        ConfigError: the configuration is bad, or the file can't be read or holds no poses.
    """
    config = described(config_path, overrides)
    recording = read_recording(file, latency_s(config), mavlink(config).target_system)
    path = FlownPath([seen.pose for seen in recording.poses], config.flight.coast_s)
    shares = thrust_shares(recording.sent, config.thrust_curve)
    hover = hover_share(recording, shares, path, config.controller.gravity)
    config = completed(config, config_path, overrides, recording, hover)
    facts = measured(str(file), recording, replay(recording, config, path, hover), path, config, hover)
    looked_at = checks(facts)
    result = verdict(looked_at)
    return Report(
        **{name: getattr(facts, name) for name in Facts.__struct_fields__},
        verdict=result,
        reasons=[check.text for check in looked_at if result == "fit" or check.level != "fine"],
        checks=looked_at,
    )


def text_of(result: Report) -> str:
    """The report as lines of at most 120 characters, but for long sentences."""
    return "\n".join(_lines(result))


def _lines(result: Report) -> Iterator[str]:
    gaps = result.gaps
    dropped = ", ".join(f"{count} {reason}" for reason, count in sorted(result.dropped.items()))
    yield f"{result.file}: {result.autopilot}, poses from {result.pose_source}"
    yield ""
    yield _row("poses", f"{result.poses}" + (f" (not used: {dropped})" if dropped else ""))
    yield _row("flights", f"{result.flights}, {result.flight_s:.1f} s in the air on set-points")
    yield _row("pose rate", f"{_number(result.rate_hz, 1)} Hz{' in flight' if result.flights else ''}")
    yield _row("gaps", f"{gaps.count}, longest time without a pose {1e3 * gaps.longest_s:.0f} ms")
    yield _row("resets", f"{result.resets}, {len(result.resets_in_flight)} of them in flight")
    yield _row("hover thrust", f"{_number(result.hover_thrust, 3)} of full thrust")
    yield _row(
        "estimated velocity",
        f"{_number(result.velocity_rms_m_s, 3)} m/s RMS, {_number(result.velocity_max_m_s, 3)} at most, "
        "from the autopilot's own",
    )
    yield _row(
        "against positions",
        f"{_number(result.velocity_path_rms_m_s, 3)} m/s RMS ours, "
        f"{_number(result.own_velocity_path_rms_m_s, 3)} the autopilot's own",
    )
    yield _row("innovation", f"{_number(result.innovation_rms_m, 4)} m RMS")
    yield ""
    if result.commands is not None:
        yield from _commands(result.commands)
        yield ""
    yield f"{result.verdict.upper()} TO FLY ON"
    for check in result.checks:
        yield f"  {check.level:5} {check.text}"


def _commands(commands: Commands) -> Iterator[str]:
    yield f"commands along the flown path, {commands.compared} compared"
    yield f"{'':14}{'mean':>18}{'deviation':>20}{'difference':>14}{'correlation':>13}"
    yield f"{'':14}{'sent':>9}{'shadow':>9}{'sent':>11}{'shadow':>9}{'RMS':>14}"
    for name, pair in (
        ("thrust N", commands.thrust_n),
        ("roll rad/s", commands.roll_rate_rad_s),
        ("pitch rad/s", commands.pitch_rate_rad_s),
        ("yaw rad/s", commands.yaw_rate_rad_s),
    ):
        yield (
            f"  {name:12}{pair.sent_mean:>9.3f}{pair.shadow_mean:>9.3f}{pair.sent_std:>11.3f}{pair.shadow_std:>9.3f}"
            f"{pair.difference_rms:>14.3f}{_number(pair.correlation, 2):>13}"
        )


def _row(label: str, text: str) -> str:
    return f"{label:24}{text}"


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
