"""The mission as a table: state × event → state. A missing key is an illegal move. Sans-IO."""

from enum import StrEnum


class State(StrEnum):
    """Where a flight stands."""

    IDLE = "idle"
    CONNECTING = "connecting"
    READY = "ready"
    ARMING = "arming"
    FLYING = "flying"
    LANDING = "landing"
    LANDED = "landed"
    ABORTED = "aborted"


class Event(StrEnum):
    """What may happen to it."""

    START = "start"
    CONNECTED = "connected"
    ARM = "arm"
    ARMED = "armed"
    LAND = "land"
    TOUCHDOWN = "touchdown"
    FAILED = "failed"


TABLE: dict[tuple[State, Event], State] = {
    (State.IDLE, Event.START): State.CONNECTING,
    (State.CONNECTING, Event.CONNECTED): State.READY,
    (State.READY, Event.ARM): State.ARMING,
    (State.ARMING, Event.ARMED): State.FLYING,
    (State.FLYING, Event.LAND): State.LANDING,
    (State.LANDING, Event.TOUCHDOWN): State.LANDED,
    # Before take-off a request to land just ends the flight.
    (State.CONNECTING, Event.LAND): State.ABORTED,
    (State.READY, Event.LAND): State.ABORTED,
    (State.ARMING, Event.LAND): State.ABORTED,
    (State.LANDING, Event.LAND): State.LANDING,
    **{(state, Event.FAILED): State.ABORTED for state in State if state is not State.LANDED},
}

FINAL = frozenset({State.LANDED, State.ABORTED})
"""Nothing flies after these."""


class IllegalMove(Exception):
    """An event that the table does not allow in the present state."""


class Mission:
    """The present state, and why."""

    def __init__(self) -> None:
        """Begin idle."""
        self.state = State.IDLE
        self.reason = ""

    def on(self, event: Event, reason: str = "") -> State:
        """Move by ``event``.

        Raises:
            IllegalMove: the table has no such move.
        """
        target = TABLE.get((self.state, event))
        if target is None:
            raise IllegalMove(f"{event} is not possible while {self.state}")
        self.state = target
        self.reason = reason
        return target
