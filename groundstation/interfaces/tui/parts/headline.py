"""What the banner says: the mission state, or whatever is worse than it. Meaning is in the words, colour only helps."""

import msgspec

from groundstation.core.messages import Snapshot
from groundstation.core.mission import FINAL, IN_AIR

SILENCE_S = 1.5
"""Without a snapshot for this long, what is on the screen is no longer true [s]."""
OLD_POSE_S = 0.2
"""A pose older than this, in the air, is worth an alarm [s]."""

ALARM, BUSY, CALM, FLYING = "alarm", "busy", "calm", "flying"
_TONES = {
    **dict.fromkeys(("hold", "tracking", "returning"), FLYING),
    **dict.fromkeys(("arming", "takeoff", "landing", "disarming"), BUSY),
    **dict.fromkeys(("descent", "aborted", "handed_over", "killed"), ALARM),
}
_IN_THE_AIR = frozenset(state.value for state in IN_AIR)
_ENDED = frozenset(state.value for state in FINAL)


class Headline(msgspec.Struct, frozen=True):
    """The banner's words."""

    big: str
    """One or two words, shown large."""
    tone: str
    """``alarm``, ``busy``, ``calm`` or ``flying``."""
    detail: str
    """A sentence for the operator."""


def headline(snapshot: Snapshot | None, silence_s: float, trouble: str) -> Headline:
    """What matters most now.

    Args:
        snapshot: The newest; None before the first.
        silence_s: Time since it came, or since the screen was opened [s].
        trouble: Why the status socket can't be read; empty while it can.
    """
    silent = silence_s > SILENCE_S
    if snapshot is None:
        return Headline("NO DATA", ALARM, f"since {silence_s:.0f} s: {trouble or 'attached, nothing came yet'}")
    if silent and snapshot.state in _ENDED:
        reason = f"{snapshot.reason}; ended {silence_s:.0f} s ago"
        return Headline(_big(snapshot), _TONES.get(snapshot.state, CALM), reason)
    if silent:
        return Headline("NO DATA", ALARM, f"since {silence_s:.0f} s, it was {snapshot.state}. {trouble}".rstrip())
    if snapshot.link.phase == "bring_down":
        return Headline("COMING DOWN", ALARM, snapshot.reason)
    if snapshot.state == "aborted":
        return Headline("ABORTED", ALARM, snapshot.reason)
    if snapshot.link.state == "lost":
        return Headline("LINK LOST", ALARM, f"while {snapshot.state}: {snapshot.reason}")
    if snapshot.state in _IN_THE_AIR and not snapshot.pose_age_s < OLD_POSE_S:
        return Headline("NO POSE", ALARM, f"for {snapshot.pose_age_s:.1f} s while {snapshot.state}: {snapshot.reason}")
    return Headline(_big(snapshot), _TONES.get(snapshot.state, CALM), snapshot.reason)


def _big(snapshot: Snapshot) -> str:
    return snapshot.state.replace("_", " ")
