"""Operator: what pressing Ctrl-C asks for, and a control that must be held to fly. Sans-IO.

Whether the operator holds what must be held to fly (a hold-to-run control, as ISO 12100 calls it). Sans-IO.
"""

from collections.abc import Callable

from groundstation.core.messages import Ask, Request, Sentence, notice, notice_fact

ONCE_S = 1.0
"""Presses within this time count once [s]: a key that bounces, or a signal sent to a whole group, is no second one."""
STEPS = (
    (Ask.LAND, "landing", "once more: failsafe descent"),
    (Ask.DESCEND, "failsafe descent", "once more: motors off, AND IT FALLS"),
    (Ask.KILL, "motors off, now", "there is nothing stronger"),
)
"""Action, confirmation and outlook of each press."""


class Interrupts:
    """Requests by repeated Ctrl-C: the first lands, the second descends, the third kills.

    Times are on the event loop's clock [s].
    """

    def __init__(self) -> None:
        self._count = 0
        self._last_s: float | None = None

    def press(self, name: str, now_s: float) -> tuple[Request | None, Sentence]:
        """Return the request of a press, or None for a bounce, and the operator's text."""
        again = self._last_s is not None and now_s - self._last_s < ONCE_S
        if not again:
            self._last_s = now_s
            self._count = min(self._count + 1, len(STEPS))
        ask, does, then = STEPS[self._count - 1]
        if again:
            return None, notice("key.bounce", key=name, once_s=ONCE_S, does=does, then=then)
        return Request(ask, f"told by {name}"), notice("key.step", key=name, does=does, then=then)


DEBOUNCE_S = 0.03
"""A contact that opens for less than this only bounces, or was shaken [s]."""
HYSTERESIS = 0.1
"""An axis is let go by this share of its travel below where it is held [-]."""


class InputLost(Exception):
    """Input that can't be read any more; the text says why."""


class HoldToRun:
    """One input, from free over held to free again. Times are on the event loop's clock [s].

    It must have been seen free before it counts as held: what is stuck, tied down or turned round can't fly anything.
    """

    def __init__(self, what: str, above: float) -> None:
        """``what`` names it to the operator; it is held from the share ``above`` of its travel on [-]."""
        self._what = what
        self._above = above
        self._held = self._was_free = False
        self._open_s: float | None = None
        self._lost = notice("hold.unseen").text

    def name(self, what: str) -> None:
        """Call it ``what`` from now on."""
        self._what = what

    def see(self, share: float | None, now_s: float) -> None:
        """Take the input's position, 0 (free) to 1 (held); None before its first value."""
        self._lost = "" if share is not None else notice("hold.silent").text
        if share is not None and share >= self._above - (HYSTERESIS if self._held else 0.0):
            self._open_s = None
            self._held = self._was_free
            return
        if self._open_s is None:
            self._open_s = now_s
        if not self._held or now_s - self._open_s >= DEBOUNCE_S - 1e-9:
            self._held = False
            self._was_free = self._was_free or share is not None

    def lose(self, why: str) -> None:
        """Mark the input as lost; once it is back, it must be released before it counts."""
        self._held = self._was_free = False
        self._lost = why

    @property
    def lost(self) -> bool:
        """Whether nobody knows how it stands."""
        return bool(self._lost)

    @property
    def obstacle(self) -> Sentence | None:
        """Why the vehicle may not fly; None while it is held."""
        return None if self._held and not self._lost else self._describe(notice_fact)

    @property
    def advice(self) -> Sentence:
        """The same, and what to do."""
        return self._describe(notice)

    def _describe(self, make: Callable[..., Sentence]) -> Sentence:
        if self._lost:
            return make("hold.lost", what=self._what, why=self._lost)
        if self._held:
            return notice("hold.held", what=self._what)
        return make("hold.free" if self._was_free else "hold.stuck", what=self._what)
