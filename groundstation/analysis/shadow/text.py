"""The report of a replay as text for people."""

from collections.abc import Iterator

from groundstation.analysis.shadow.facts import Commands
from groundstation.analysis.shadow.report import Report


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
