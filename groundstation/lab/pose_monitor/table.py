"""What ``groundstation check --watch`` shows people."""

from typing import TYPE_CHECKING

from groundstation.core.geometry.ops import Vec3
from groundstation.lab.pose_monitor.seen import Seen
from groundstation.pose.outbreaks import HINTS
from links.core.printable import printable

if TYPE_CHECKING:
    from rich.table import Table

NOTHING = "nothing has come: check the address in [pose], that the tracker streams to this machine, and the firewall"
NOT_RESTING = "moves: let it stand to measure"
SHOWN_EVENTS = 5


def rows(seen: Seen) -> list[tuple[str, str]]:
    """What is known, in words."""
    lines = [
        ("poses", f"{seen.poses}, {seen.rate_hz:.1f} per second arrive, {seen.source_rate_hz:.1f} by their stamps"),
        ("age", _age(seen)),
        ("latency", f"{1e3 * seen.latency_s:.1f} ms, longest {1e3 * seen.latency_max_s:.1f} ms"),
        ("jitter", f"{1e3 * seen.jitter_s:.1f} ms, longest wait {1e3 * seen.longest_s:.0f} ms"),
        ("gaps", f"{seen.gaps}; its clock stepped {seen.clock_steps} times{_drift(seen.drift)}"),
    ]
    if seen.position_ned is not None and seen.roll_pitch_yaw_deg is not None:
        north, east, down = seen.position_ned
        lines.append(("place", f"north {north:+.3f}  east {east:+.3f}  up {-down:+.3f} m"))
        roll, pitch, yaw = seen.roll_pitch_yaw_deg
        lines.append(("attitude", f"roll {roll:+.1f}  pitch {pitch:+.1f}  yaw {yaw:+.1f}°"))
        lines.append(("noise at rest", _noise(seen.noise_m, seen.noise_deg)))
    lines += [("dropped", f"{count} {_named(reason)}") for reason, count in seen.dropped.items()]
    if not seen.poses and not seen.dropped:
        lines.append(("", NOTHING))
    if seen.bodies:
        lines.append(("bodies there", ", ".join(map(printable, seen.bodies))))
    lines += [("", printable(event)) for event in seen.events[-SHOWN_EVENTS:]]
    return lines


def table(title: str, seen: Seen) -> "Table":
    """The same as rich draws it."""
    from rich.table import Table
    from rich.text import Text

    drawn = Table(title=title, show_header=False, title_justify="left", min_width=72)
    drawn.add_column(style="dim", no_wrap=True)
    drawn.add_column()
    for name, text in rows(seen):
        bad = name == "dropped" or (name == "age" and not seen.ok)
        drawn.add_row(name, Text(text, style="bold yellow" if bad else ""))
    return drawn


def _age(seen: Seen) -> str:
    if seen.recorded and seen.poses:
        return "they are recorded"
    return "no pose yet" if seen.age_s is None else f"{1e3 * seen.age_s:.0f} ms"


def _drift(drift: float | None) -> str:
    return "" if drift is None else f", drift {1e6 * drift:+.0f} ppm"


def _noise(place_m: Vec3 | None, turn_deg: Vec3 | None) -> str:
    if place_m is None or turn_deg is None:
        return NOT_RESTING
    north, east, down = (1e3 * value for value in place_m)
    roll, pitch, yaw = turn_deg
    return f"{north:.2f} {east:.2f} {down:.2f} mm  {roll:.2f} {pitch:.2f} {yaw:.2f}°"


def _named(reason: str) -> str:
    hint = HINTS.get(reason)
    return reason if hint is None else f"{reason}: {hint}"
