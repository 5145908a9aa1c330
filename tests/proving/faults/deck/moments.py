"""When a fault strikes: the states of a mission in which something moves, or is about to, and the instant within."""

from collections.abc import Callable

from groundstation.core.mission import State

DESCENT_AFTER_S = 1.0
"""The failsafe descent is asked for after so long on the figure [s]."""
CLIMBED_M = 0.3
"""A take-off is struck so high above the floor [m]."""

PLANNED = {
    (State.IDLE, State.CONNECTING),
    (State.CONNECTING, State.READY),
    (State.READY, State.ARMING),
    (State.ARMING, State.TAKEOFF),
    (State.TAKEOFF, State.HOLD),
    (State.HOLD, State.TRACKING),
    (State.TRACKING, State.RETURNING),
    (State.LANDING, State.DISARMING),
    (State.DESCENT, State.DISARMING),
    (State.DISARMING, State.LANDED),
}
"""Moves that a flight makes by itself; onto a landing it moves by itself for one reason only."""
LANDS_BY_ITSELF = "over the place of take-off"
FELT = "the autopilot has felt the floor and disarmed"


def is_planned(before: State, after: State, reason: str) -> bool:
    """Whether a move would have come without any fault."""
    return (before, after) in PLANNED or reason in (LANDS_BY_ITSELF, FELT)


class Moves:
    """The states of one flight, and which of them answer a fault."""

    def __init__(self, now: Callable[[], float]) -> None:
        """``now`` tells the time [s]."""
        self.state = State.IDLE
        self.since_s = 0.0
        """When it began."""
        self.reason = ""
        """Why it is there."""
        self.struck = False
        """True from the fault on."""
        self.answers: list[tuple[float, State, str]] = []
        """When, what and why."""
        self._now = now

    def lasted(self, state: State, for_s: float) -> bool:
        """Whether it has been in ``state`` for ``for_s`` [s]."""
        return self.state is state and self._now() >= self.since_s + for_s - 1e-9

    def entered(self, state: State, reason: str) -> None:
        """A state has begun."""
        before, self.state, self.since_s, self.reason = self.state, state, self._now(), reason
        if self.struck and not is_planned(before, state, reason):
            self.answers.append((self.since_s, state, reason))


class Moment:
    """A place in the mission."""

    def __init__(self, state: State, after_s: float, *, flying: bool = True, climbed_m: float | None = None) -> None:
        """``after_s`` within ``state`` [s], or at a height of ``climbed_m`` [m]."""
        self.state = state
        self.after_s = after_s
        self.flying = flying
        """Whether it is in the air then."""
        self.climbed_m = climbed_m

    def is_now(self, moves: Moves, height_m: float) -> bool:
        """Whether it has come for a flight with ``moves``, ``height_m`` above the floor [m]."""
        climbed = self.climbed_m is None or height_m >= self.climbed_m
        return climbed and moves.lasted(self.state, self.after_s)


MOMENTS: dict[str, Moment] = {
    "start": Moment(State.IDLE, 0.0, flying=False),
    "ready": Moment(State.READY, 0.3, flying=False),
    "arming": Moment(State.ARMING, 0.4, flying=False),
    "spool-up": Moment(State.TAKEOFF, 1.0, flying=False),
    "take-off": Moment(State.TAKEOFF, 0.0, climbed_m=CLIMBED_M),
    "hold": Moment(State.HOLD, 0.5),
    "tracking": Moment(State.TRACKING, 1.0),
    "returning": Moment(State.RETURNING, 1.0),
    "landing": Moment(State.LANDING, 0.7),
    "descent": Moment(State.DESCENT, 0.3),
}
"""By the name that the deck gives them. ``start`` is before the first pose comes; ``spool-up`` and ``take-off`` are two
parts of one state."""
