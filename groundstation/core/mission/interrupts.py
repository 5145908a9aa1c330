"""What an impatient operator means: the first Ctrl-C lands, the second brings down, the third kills. Sans-IO."""

from groundstation.core.messages import Ask, Request

ONCE_S = 1.0
"""Presses within this time count once [s]: a key that bounces, or a signal sent to a whole group, is no second one."""
STEPS = (
    (Ask.LAND, "landing", "once more: failsafe descent"),
    (Ask.DESCEND, "failsafe descent", "once more: motors off, AND IT FALLS"),
    (Ask.KILL, "motors off, now", "there is nothing stronger"),
)
"""What each press asks for, what is said, and what comes next."""


class Interrupts:
    """Counts the presses of one flight. Times are on the event loop's clock [s]."""

    def __init__(self) -> None:
        """None yet."""
        self._count = 0
        self._last_s: float | None = None

    def press(self, name: str, now_s: float) -> tuple[Request | None, str]:
        """What the press asks for, and what to tell the operator; None where it belongs to the one before."""
        again = self._last_s is not None and now_s - self._last_s < ONCE_S
        if not again:
            self._last_s = now_s
            self._count = min(self._count + 1, len(STEPS))
        ask, does, then = STEPS[self._count - 1]
        if again:
            return None, f"{name} within {ONCE_S:g} s of the last counts once: {does}; {then}"
        return Request(ask, f"told by {name}"), f"{name}: {does}; {then}"
