"""The numbers of a snapshot as lines of styled text."""

import math
from collections.abc import Mapping, Sequence

from groundstation.core.geometry import Vec3, euler_zyx
from groundstation.core.messages import Check, Snapshot, Verdict
from groundstation.interfaces.tui.parts.headline import OLD_POSE_S
from groundstation.interfaces.tui.parts.plot import Spans, bar, two_sided_bar
from groundstation.interfaces.tui.parts.themes import FLOWN, LABEL, NORMAL, WARNING, WIND
from links.core import LinkStatus, printable

RATE_SCALE_DEG_S = 360.0
"""Full scale of the rate bars where no limit is known [deg/s]."""


SMALL = 0.02
"""A smaller part of a vector has no arrow [m/s²]."""


def numbers(snapshot: Snapshot) -> list[Spans]:
    """Position, attitude, commands, disturbance, certificate, pose, link and battery, one row each."""
    roll, pitch, yaw = (math.degrees(angle) for angle in euler_zyx(snapshot.attitude))
    return [
        [("            north     east   height", LABEL)],
        row("position", f"{_place(snapshot.position_ned)} m"),
        row("reference", f"{_place(snapshot.reference_ned)} m"),
        row("error", f"{_centimetres(snapshot.error_m)}   rms {_centimetres(snapshot.rms_m)}"),
        row("attitude", f"roll {roll:+.1f}  pitch {pitch:+.1f}  yaw {yaw:+.1f} °"),
        _thrust(snapshot),
        *_rates(snapshot),
        *_disturbance(snapshot),
        _certificate(snapshot),
        _pose(snapshot),
        *_link(snapshot),
    ]


def _thrust(snapshot: Snapshot) -> Spans:
    full = not snapshot.thrust_n < 0.98 * snapshot.thrust_max_n
    return [
        ("thrust    ", LABEL),
        (bar(snapshot.thrust_n, snapshot.thrust_max_n, 17), WARNING if full else FLOWN),
        (f" {snapshot.thrust_n:5.2f} /{snapshot.thrust_max_n:.2f} N", NORMAL),
        ("!" if full else " ", WARNING),
    ]


def _rates(snapshot: Snapshot) -> list[Spans]:
    rows = []
    for i, name in enumerate(("rate roll", "pitch", "yaw")):
        rate = math.degrees(snapshot.rates_rad_s[i])
        known = snapshot.rate_limits_rad_s
        limit = math.degrees(known[i]) if known is not None else RATE_SCALE_DEG_S
        full = known is not None and not abs(rate) < 0.98 * limit
        told = f" /{limit:.0f} °/s" if known is not None else " °/s"
        rows.append(
            [
                (f"{name:>9}", LABEL),
                (" " + two_sided_bar(rate, limit, 8), WARNING if full else FLOWN),
                (f" {rate:+5.0f}{told}", NORMAL),
                ("!" if full else " ", WARNING),
            ]
        )
    return rows


def _disturbance(snapshot: Snapshot) -> list[Spans]:
    law = snapshot.diagnostics
    if law is None:
        return [row("b̂, d̂", "no control law runs")]
    return [
        row("b̂", f"{three(law.b_hat)} m/s² {arrow(law.b_hat)}", WIND),
        row("d̂", f"{three(law.disturbance)} λ {snapshot.thrust_effectiveness:.2f}"),
    ]


def arrow(vector_ned: Vec3) -> str:
    """Where a vector points: across as seen from above, north up, and then up or down; a dot where it is small."""
    north, east, down = vector_ned
    across = math.hypot(north, east)
    if not across < math.inf or not abs(down) < math.inf:
        return "?"
    flat = "·" if across < SMALL else "↑↗→↘↓↙←↖"[round(math.atan2(east, north) / (math.pi / 4.0)) % 8]
    return flat + ("" if abs(down) < SMALL else "▼" if down > 0.0 else "▲")


def _certificate(snapshot: Snapshot) -> Spans:
    seen = snapshot.certificate
    if seen is None:
        return row("V", "-")
    bad = seen.state == "violated"
    text = f"{seen.v:.3g}  {printable(seen.state)}{'!' if bad else ''}"
    if seen.excess > 0.0:
        text += f" by {seen.excess:.2g}"
    if seen.b_hat_fraction is not None:
        text += f"  b̂ {100.0 * seen.b_hat_fraction:.0f} %"
    return row("V", text, WARNING if bad else NORMAL)


def _pose(snapshot: Snapshot) -> Spans:
    if snapshot.pose_id < 0:
        return row("pose", f"none yet{_drops(snapshot.poses_dropped)}", WARNING)
    old = not snapshot.pose_age_s < OLD_POSE_S
    age = f"{snapshot.pose_age_s:.1f} s" if snapshot.pose_age_s >= 1.0 else f"{1e3 * snapshot.pose_age_s:.0f} ms"
    text = f"age {age}{'!' if old else ''}  {snapshot.pose_rate_hz:.0f} Hz{_drops(snapshot.poses_dropped)}"
    return row("pose", text, WARNING if old else NORMAL)


def _link(snapshot: Snapshot) -> list[Spans]:
    link = snapshot.link
    lost = link.state == "lost"
    text = (
        f"{printable(link.state)}{'!' if lost else ''}  sent {link.sent} expired {link.expired}{_drops(link.dropped)}"
    )
    return [
        row("link", text, WARNING if lost else NORMAL),
        row("battery", battery(link)),
        row("", printable(link.text) or "-", LABEL),
    ]


def battery(link: LinkStatus) -> str:
    """Voltage and charge of the vehicle's battery, and how long a round trip to it takes."""
    told = [f"{link.battery_v:.2f} V"] if link.battery_v is not None else []
    told += [f"{100.0 * link.battery_share:.0f} %"] if link.battery_share is not None else []
    trip = "" if link.rtt_s is None else f"   round trip {1e3 * link.rtt_s:.1f} ms"
    return ("  ".join(told) or "not told") + trip


def _drops(dropped: Mapping[str, int]) -> str:
    """The total, and the commonest reason."""
    if not any(dropped.values()):
        return "  drops 0"
    reason = max(dropped, key=lambda name: dropped[name])
    return f"  drops {sum(dropped.values())} {printable(reason)}"


def row(label: str, text: str, style: str = NORMAL) -> Spans:
    """A name, and what is told of it."""
    return [(f"{label}{' ' * (10 - _width(label))}", LABEL), (text, style)]


def _width(label: str) -> int:
    return sum(1 for letter in label if letter != "\u0302")  # the hat of b̂ stands above its letter


def _place(position_ned: Vec3) -> str:
    north, east, down = position_ned
    return f"{north:+7.3f}  {east:+7.3f}  {-down:+7.3f}"


def three(vector: Vec3) -> str:
    """Three numbers in columns."""
    return "  ".join(f"{component:+7.3f}" for component in vector)


def _centimetres(metres: float) -> str:
    return f"{100.0 * metres:.1f} cm"


def flight_time(time_s: float) -> str:
    """How long the trajectory is flown, or when it begins, from its time [s]."""
    return f"{time_s:.1f} s" if time_s >= 0.0 else f"trajectory in {-time_s:.1f} s"


def checks(made: Sequence[Check]) -> list[Spans]:
    """The pre-flight list, what stands in the way first."""
    if not made:
        return [[("no pre-flight checks yet: they need link and poses; a start in the air has none", LABEL)]]
    order = (Verdict.FAIL, Verdict.WARN, Verdict.PASS, Verdict.OFF)
    rows: list[Spans] = [[("─ before take-off ", LABEL)]]
    for check in sorted(made, key=lambda one: order.index(one.verdict)):
        bad = check.verdict in (Verdict.FAIL, Verdict.WARN)
        mark = {Verdict.FAIL: "✗", Verdict.WARN: "!", Verdict.PASS: "✓", Verdict.OFF: "-"}[check.verdict]
        style = "bold $bad reverse" if check.verdict is Verdict.FAIL else WARNING if bad else NORMAL
        rows.append([(f"{mark} {check.verdict:4} ", style), (f"{printable(check.name)}: ", style if bad else NORMAL)])
        rows[-1].append((printable(check.says), style if bad else LABEL))
    return rows
