"""Mission: the state of one flight, and a table of its moves, (state, event) to state. A missing
key is an illegal move. Sans-IO.
"""

from enum import StrEnum

from groundstation.core.messages import Ask, Sentence


class State(StrEnum):
    """States of a flight."""

    IDLE = "idle"
    CONNECTING = "connecting"
    """Waiting for the link and for poses."""
    READY = "ready"
    """On the ground, motors off; waiting for the operator."""
    ARMING = "arming"
    """Offboard control and arming are requested from the autopilot."""
    TAKEOFF = "takeoff"
    """Spooling up on the floor, then climbing."""
    HOLD = "hold"
    """Staying at one place."""
    TRACKING = "tracking"
    """Flying onto the trajectory, and along it."""
    MOVING = "moving"
    """Flying to a requested point."""
    RETURNING = "returning"
    """Flying back over the place of take-off."""
    LANDING = "landing"
    """Coming down under full control."""
    DESCENT = "descent"
    """Failsafe descent: level and down, by attitude and speed alone."""
    DISARMING = "disarming"
    """On the floor at zero thrust, until the motors are confirmed off."""
    LANDED = "landed"
    """On the floor, motors off."""
    ABORTED = "aborted"
    """Commands have stopped; a vehicle in the air was brought down by the link."""
    HANDED_OVER = "handed_over"
    """The autopilot follows another controller: nothing is sent any more."""
    KILLED = "killed"
    """Motors off at once."""


class Event(StrEnum):
    """Events of a mission. Requests are named as in :class:`Ask`."""

    START = "start"
    CONNECTED = "connected"
    ARM = "arm"
    ARMED = "armed"
    AIRBORNE = "airborne"
    """Armed in the air: only a simulator holds its vehicle there."""
    CLIMBED = "climbed"
    HOLD = "hold"
    TRACK = "track"
    GOTO = "goto"
    ARRIVED = "arrived"
    RETURN = "return"
    HOME = "home"
    LAND = "land"
    DESCEND = "descend"
    TOUCHDOWN = "touchdown"
    DISARMED = "disarmed"
    TAKEN_OVER = "taken_over"
    ABORT = "abort"
    KILL = "kill"


FINAL = frozenset({State.LANDED, State.ABORTED, State.HANDED_OVER, State.KILLED})
"""States that end a flight."""
ALARMING = frozenset({State.DESCENT, State.ABORTED, State.HANDED_OVER, State.KILLED})
"""States that are no regular end."""
ON_GROUND = (State.IDLE, State.CONNECTING, State.READY, State.ARMING)
"""No thrust that lifts the vehicle has been commanded yet."""
IN_AIR = (
    State.TAKEOFF,
    State.HOLD,
    State.TRACKING,
    State.MOVING,
    State.RETURNING,
    State.LANDING,
    State.DESCENT,
)
"""Commands may lift the vehicle. ``DISARMING`` and the final states are in neither tuple."""


def _list_emergency_moves() -> dict[tuple[State, Event], State]:
    """Return the moves by abort, descend, land and kill, which every state has.

    After the end only a kill changes the state.
    """
    table: dict[tuple[State, Event], State] = {}
    for state in State:
        over = state in FINAL
        table[state, Event.ABORT] = state if over else State.ABORTED
        table[state, Event.DESCEND] = (
            state if over else State.DESCENT if state in IN_AIR else State.ABORTED
        )
        table[state, Event.LAND] = (
            state if over else State.LANDING if state in IN_AIR else State.ABORTED
        )
        table[state, Event.KILL] = State.KILLED
    # A descent does not become a gentler landing.
    table[State.DESCENT, Event.LAND] = State.DESCENT
    # A vehicle on the floor is down already, and goes on disarming.
    for event in (Event.LAND, Event.DESCEND):
        table[State.DISARMING, event] = State.DISARMING
    return table


TABLE: dict[tuple[State, Event], State] = {
    (State.IDLE, Event.START): State.CONNECTING,
    (State.CONNECTING, Event.CONNECTED): State.READY,
    (State.READY, Event.ARM): State.ARMING,
    (State.ARMING, Event.ARMED): State.TAKEOFF,
    (State.ARMING, Event.AIRBORNE): State.TRACKING,
    (State.TAKEOFF, Event.CLIMBED): State.HOLD,
    (State.HOLD, Event.TRACK): State.TRACKING,
    (State.HOLD, Event.HOLD): State.HOLD,
    (State.TRACKING, Event.HOLD): State.HOLD,
    (State.RETURNING, Event.HOLD): State.HOLD,
    (State.HOLD, Event.GOTO): State.MOVING,
    (State.MOVING, Event.ARRIVED): State.HOLD,
    (State.MOVING, Event.HOLD): State.HOLD,
    (State.MOVING, Event.RETURN): State.RETURNING,
    (State.HOLD, Event.RETURN): State.RETURNING,
    (State.TRACKING, Event.RETURN): State.RETURNING,
    (State.RETURNING, Event.HOME): State.LANDING,
    (State.LANDING, Event.TOUCHDOWN): State.DISARMING,
    (State.DESCENT, Event.TOUCHDOWN): State.DISARMING,
    (State.DISARMING, Event.DISARMED): State.LANDED,
    # The autopilot detected touchdown, and disarmed, before we did.
    (State.LANDING, Event.DISARMED): State.LANDED,
    (State.DESCENT, Event.DISARMED): State.LANDED,
    **{(state, Event.TAKEN_OVER): State.HANDED_OVER for state in (*IN_AIR, State.ARMING)},
    **_list_emergency_moves(),
}

EVENT_OF = {ask: Event(ask.value) for ask in Ask}
"""Event of each request: that of the same name."""


class IllegalMove(Exception):
    """An event that the table does not allow in the present state."""


class Mission:
    """Present state of the mission, and its reason."""

    def __init__(self) -> None:
        self.state = State.IDLE
        self.reason: Sentence | None = None
        """Why the mission moved to this state; None where no reason was given."""

    def allows(self, event: Event) -> bool:
        """Whether the table has a move by ``event`` from the present state."""
        return (self.state, event) in TABLE

    def on(self, event: Event, reason: Sentence | None = None) -> State:
        """Move by ``event`` for ``reason``, and return the state.

        Where the state stays the same, so does the reason why it was entered.

        Raises:
            IllegalMove: the table has no such move.
        """
        target = TABLE.get((self.state, event))
        if target is None:
            raise IllegalMove(f"{event} is not possible while {self.state}")
        if target is not self.state:
            self.state = target
            self.reason = reason
        return target
