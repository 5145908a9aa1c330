"""Offline comparison, ``groundstation replay LOG.tlog``: what our estimator and controller make of a recorded flight.

Its report says whether the stream of poses is fit to fly on: one check an aspect, each a sentence with its number.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal

import msgspec

from groundstation.analysis.shadow.path import FlownPath, hover_share, thrust_shares
from groundstation.analysis.shadow.recording import complete_config, latency_s, load_described, mavlink, read_recording
from groundstation.analysis.shadow.replay import ComparedCommands, ShadowFacts, measure_facts, replay

RATE_HZ = 30.0
"""Fewer poses a second than this are not enough for the observer and its prediction."""
VELOCITY_M_S = (0.1, 0.3)
"""Velocity error up to which all is fine, and up to which care does. A standing error e moves the vehicle by e / 3
(the law's slope r is 3 1/s): 3 cm and 10 cm."""
WANDER_M_S = (0.1, 0.3)
"""The same for how far positions and velocity of the source disagree. No filter can tell which of the two is wrong.
If it is the positions, the vehicle follows them: at 0.3 m/s a metre in 3 s, while the screen shows it in place."""
INNOVATION_M = (0.01, 0.05)
"""The same for the innovation: one pose may move the vehicle's reference by this much."""
RESET_M, RESET_RAD = 0.1, 0.1
"""A reset in flight that moves or turns the vehicle further than this makes it jump."""
BAD_STAMPS = 0.01
"""More than this share of poses with a stamp that is not newer is a fault of the source, not an accident."""
SATURATED = (0.01, 0.1)
"""Share of commands at a limit: a take-off may touch it. A flown path hardly needs it, so more is the fault of the
configuration or of the estimate, and beyond its limits the law proves nothing."""
HOVER = 0.1
"""The configuration's hover thrust may differ from the flown one by this share."""

Level = Literal["fine", "care", "bad"]
VERDICTS: dict[Level, str] = {"fine": "fit", "care": "fit with care", "bad": "not fit"}


class ShadowCheck(msgspec.Struct, frozen=True):
    """One thing that was looked at."""

    about: str
    """What: rate, gaps, stamps, resets, velocity, wander, innovation, commands, hover or flight."""
    level: Level
    text: str
    """What was found, with numbers, and what it means."""


def checks(facts: ShadowFacts) -> list[ShadowCheck]:
    """Everything that can be said about a replay."""
    return [*_stream(facts), *_flight(facts)]


def verdict(checks_: list[ShadowCheck]) -> str:
    """``fit``, ``fit with care`` or ``not fit``: as the worst of the checks."""
    levels = {check.level for check in checks_}
    worst: Level = "bad" if "bad" in levels else "care" if "care" in levels else "fine"
    return VERDICTS[worst]


def _stream(facts: ShadowFacts) -> Iterator[ShadowCheck]:
    rate, gaps = facts.rate_hz or 0.0, facts.gaps
    yield ShadowCheck(
        "rate",
        "fine" if rate >= RATE_HZ else "bad",
        f"{rate:.1f} poses a second; at least {RATE_HZ:.0f} are needed",
    )
    yield ShadowCheck(
        "gaps",
        "bad" if gaps.longest_s >= gaps.limit_s else "care" if gaps.longest_s >= 0.5 * gaps.limit_s else "fine",
        f"the longest time without a pose is {gaps.longest_s:.3f} s; "
        f"after {gaps.limit_s:.2f} s commands stop (flight.coast_s)",
    )
    old = sum(facts.dropped.get(reason, 0) for reason in ("duplicate", "out_of_order", "not_newer"))
    yield ShadowCheck(
        "stamps",
        "bad" if old > BAD_STAMPS * facts.poses else "care" if old else "fine",
        f"{old} of {facts.poses + old} poses carry a stamp that is not newer than the one before",
    )
    for reset in facts.resets_in_flight:
        yield ShadowCheck(
            "resets",
            "bad" if reset.moved_m > RESET_M or reset.turned_rad > RESET_RAD else "care",
            f"at {reset.time_s:.1f} s, in flight, the source reset its estimate, "
            f"by {1e3 * reset.moved_m:.0f} mm and {57.3 * reset.turned_rad:.1f} deg",
        )


def _flight(facts: ShadowFacts) -> Iterator[ShadowCheck]:
    if not facts.flights:
        yield ShadowCheck(
            "flight", "care", "the recording holds no flight on set-points: only the stream could be judged"
        )
        return
    if facts.hover_thrust is None:
        yield ShadowCheck(
            "hover",
            "care",
            "no steady flight on SET_ATTITUDE_TARGET (thrust and rates): the estimator could not know the thrust",
        )
    else:
        off = abs(facts.hover_configured / facts.hover_thrust - 1.0)
        yield ShadowCheck(
            "hover",
            "fine" if off <= HOVER else "care",
            f"{facts.hover_thrust:.3f} of full thrust carries the vehicle"
            + (f"; its configuration says {facts.hover_configured:.3f}" if off > 1e-3 else ""),
        )
    yield from _velocity(facts)
    innovation = facts.innovation_rms_m or 0.0
    yield ShadowCheck(
        "innovation",
        _level(innovation, INNOVATION_M),
        f"poses are {1e3 * innovation:.1f} mm RMS from where the model expects them",
    )
    if facts.commands is not None:
        share = facts.commands.saturated_fraction
        yield ShadowCheck(
            "commands",
            _level(share, SATURATED),
            f"{100.0 * share:.1f} % of the commands along the flown path would be at a limit",
        )


def _velocity(facts: ShadowFacts) -> Iterator[ShadowCheck]:
    own, path, source = facts.velocity_rms_m_s, facts.velocity_path_rms_m_s, facts.own_velocity_path_rms_m_s
    if own is not None:
        text = f"the estimated velocity is {own:.3f} m/s RMS from the autopilot's own"
        yield ShadowCheck("velocity", _level(own, VELOCITY_M_S), text)
    elif path is not None:
        text = (
            f"the estimated velocity is {path:.3f} m/s RMS from that of the recorded positions; the source sends none"
        )
        yield ShadowCheck("velocity", _level(path, VELOCITY_M_S), text)
    if source is not None:
        level = _level(source, WANDER_M_S)
        text = f"positions and velocity of the autopilot disagree by {source:.3f} m/s RMS between themselves"
        if level != "fine":
            text += ": the vehicle may wander in the room that fast, although it looks good on screen; keep clear of it"
        yield ShadowCheck("wander", level, text)


def _level(value: float, limits: tuple[float, float]) -> Level:
    return "fine" if value <= limits[0] else "care" if value <= limits[1] else "bad"


class ShadowReport(ShadowFacts, frozen=True, kw_only=True):
    """A replay in numbers, and what to make of them: the object that ``--json`` prints."""

    verdict: str
    """``fit``, ``fit with care`` or ``not fit`` to fly on."""
    reasons: list[str]
    """The sentences that the verdict rests on: every one that is not fine, or all where all are."""
    checks: list[ShadowCheck]
    """Everything that was looked at."""


def report(file: Path, config_path: Path | None = None, overrides: Sequence[str] = ()) -> ShadowReport:
    """Replay ``file``. The same file and configuration give the same report, to the last bit.

    Raises:
        ConfigError: the configuration is bad, or the file can't be read or holds no poses.
    """
    config = load_described(config_path, overrides)
    recording = read_recording(file, latency_s(config), mavlink(config).target_system)
    path = FlownPath([seen.pose for seen in recording.poses], config.flight.coast_s)
    shares = thrust_shares(recording.sent, config.thrust_curve)
    hover = hover_share(recording, shares, path, config.controller.gravity)
    config = complete_config(config, config_path, overrides, recording, hover)
    facts = measure_facts(str(file), recording, replay(recording, config, path, hover), path, config, hover)
    looked_at = checks(facts)
    result = verdict(looked_at)
    return ShadowReport(
        **{name: getattr(facts, name) for name in ShadowFacts.__struct_fields__},
        verdict=result,
        reasons=[check.text for check in looked_at if result == "fit" or check.level != "fine"],
        checks=looked_at,
    )


def text_of(result: ShadowReport) -> str:
    """The report as lines of at most 120 characters, but for long sentences."""
    return "\n".join(_lines(result))


def _lines(result: ShadowReport) -> Iterator[str]:
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


def _commands(commands: ComparedCommands) -> Iterator[str]:
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


def replay_command(file: Path, config: Path | None, overrides: list[str], *, as_json: bool) -> int:
    """Replay ``file`` (a .tlog), print a report (or one JSON object), and return 0 whatever the verdict.

    Without ``config`` the vehicle is as the recording shows it.

    Raises:
        ConfigError: the configuration is bad, or the file can't be read or holds no poses.
    """
    result = report(file, config, overrides)
    print(msgspec.json.encode(result).decode() if as_json else text_of(result))
    return 0
