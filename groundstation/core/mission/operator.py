"""Operator: requests by Ctrl-C, and a hold-to-run control (ISO 12100), which must be held to fly.

Sans-IO.
"""

import math
from collections.abc import Callable

from groundstation.core.messages import ROUNDING_S, Ask, Request, Sentence, notice, notice_fact

ONCE_S = 1.0
"""Time within which presses count as one [s]: a bouncing key, or a signal to a whole group of
processes, is no second press. Chosen."""
REPEAT_S = 0.1
"""Interval below which a press is the repetition of a key that is held down [s]: keyboards repeat
it 11 to 33 times a second, and a finger taps 7 times a second at most."""
STEPS = (
    (Ask.LAND, "asked to land", "once more: failsafe descent"),
    (Ask.DESCEND, "asked for a failsafe descent", "once more: motors off, AND IT FALLS"),
    (Ask.KILL, "motors off, now", "there is nothing stronger"),
)
"""Request of each press, its confirmation, and the effect of the next press."""


class Interrupts:
    """Requests by repeated Ctrl-C: the first lands, the second descends, the third kills.

    A key that is held down counts as one press.

    Times are on the event loop's clock [s].
    """

    def __init__(self) -> None:
        self._count = 0
        self._counted_s = self._newest_s = -math.inf

    def press(self, name: str, now_s: float) -> tuple[Request | None, Sentence]:
        """Return the request of a press, None for a bounce or a repetition, and a sentence for the
        operator.
        """
        again = now_s - self._counted_s < ONCE_S or now_s - self._newest_s < REPEAT_S
        self._newest_s = now_s
        if not again:
            self._counted_s = now_s
            self._count = min(self._count + 1, len(STEPS))
        ask, does, then = STEPS[self._count - 1]
        if again:
            return None, notice("key.bounce", key=name, once_s=ONCE_S, does=does, then=then)
        return Request(ask, f"requested by {name}"), notice(
            "key.step", key=name, does=does, then=then
        )


DEBOUNCE_S = 0.03
"""Time for which a control must be open to count as released [s]: contacts bounce."""
HYSTERESIS = 0.1
"""Hysteresis of an axis between held and released, as a share of its travel [-]. Chosen."""


class InputLost(Exception):
    """Loss of an input; the text gives the reason."""


class HoldToRun:
    """State of one hold-to-run control: held or free. Times are on the event loop's clock [s].

    It counts as held only after it was free: a control that is stuck, tied down or reversed does
    not enable a flight.
    """

    def __init__(self, what: str, held_from: float) -> None:
        """Begin unseen.

        ``what`` is its name for the operator; from the share ``held_from`` of its travel [-] on it
        is held.
        """
        self._what = what
        self._held_from = held_from
        self._held = self._was_free = False
        self._open_s: float | None = None
        self._lost = notice("hold.unseen").text

    def rename(self, what: str) -> None:
        """Take ``what`` for its name from now on."""
        self._what = what

    def take_position(self, share: float | None, now_s: float) -> None:
        """Take the input's position, 0 (free) to 1 (held).

        None, as before its first value, counts as lost.
        """
        self._lost = "" if share is not None else notice("hold.silent").text
        if share is not None and share >= self._held_from - (HYSTERESIS if self._held else 0.0):
            self._open_s = None
            self._held = self._was_free
            return
        if self._open_s is None:
            self._open_s = now_s
        if not self._held or now_s - self._open_s >= DEBOUNCE_S - ROUNDING_S:
            self._held = False
            self._was_free = self._was_free or share is not None

    def lose(self, why: str) -> None:
        """Mark the input as lost; once it is back, it must be released before it counts."""
        self._held = self._was_free = False
        self._lost = why

    @property
    def lost(self) -> bool:
        """Whether its position is unknown."""
        return bool(self._lost)

    @property
    def obstacle(self) -> Sentence | None:
        """Sentence why the vehicle may not fly; None while the control is held."""
        return None if self._held and not self._lost else self._describe(notice_fact)

    @property
    def advice(self) -> Sentence:
        """Sentence on its state, with the remedy."""
        return self._describe(notice)

    def _describe(self, make: Callable[..., Sentence]) -> Sentence:
        if self._lost:
            return make("hold.lost", what=self._what, why=self._lost)
        if self._held:
            return notice("hold.held", what=self._what)
        return make("hold.free" if self._was_free else "hold.stuck", what=self._what)
