"""What an operator may order, and by which key: the one table behind keys, buttons, palette and help. Sans-IO."""

import math

import msgspec

from groundstation.core.messages import Ask
from groundstation.core.mission import EVENT_OF, FINAL, TABLE, State

TWICE_S = 1.0
"""The second press that kills comes within this time of the first [s]."""


class Order(msgspec.Struct, frozen=True):
    """One order."""

    ask: Ask
    key: str
    """As Textual calls it; empty: only by the palette."""
    shown: str
    """The key on the screen."""
    label: str
    says: str
    always: bool = False
    """True where anyone attached may order it, and at once: from every screen, dialog and field of text."""
    tone: str = "go"
    """Its colours: ``go``, ``calm``, ``land``, ``abort`` or ``kill``."""


ORDERS = (
    Order(Ask.ARM, "a", "a", "ARM", "start the motors and take off; asks for the vehicle's name"),
    Order(Ask.TRACK, "t", "t", "FLY", "leave the hold for the trajectory; asks once more"),
    Order(Ask.HOLD, "h", "h", "HOLD", "stop and stay there", tone="calm"),
    Order(Ask.RETURN, "r", "r", "RETURN", "fly back over the place of take-off and land there", tone="calm"),
    Order(Ask.LAND, "ctrl+l", "^L", "LAND", "land here; before take-off, end the flight", always=True, tone="land"),
    Order(Ask.ABORT, "ctrl+x", "^X", "ABORT", "commands stop; the link brings it down", always=True, tone="abort"),
    Order(
        Ask.KILL, "ctrl+k", "^K^K", "KILL", "motors off, also in the air: twice within 1 s", always=True, tone="kill"
    ),
    Order(Ask.DESCEND, "", "", "DESCEND", "level and down by attitude and speed alone", always=True, tone="abort"),
)
BY_ASK = {order.ask: order for order in ORDERS}


def possible(order: Order, state: str | None) -> bool:
    """Whether the mission's table has a move by it; from a state that is not known, everything may be tried."""
    try:
        known = State(state or "")
    except ValueError:
        return True
    return (known, EVENT_OF[order.ask]) in TABLE and (known not in FINAL or order.ask is Ask.KILL)


class Twice:
    """What needs its key twice."""

    def __init__(self) -> None:
        """Not pressed yet."""
        self._first_s = -math.inf

    def press(self, now_s: float) -> bool:
        """One press; True where it is the second in time."""
        second = self.waits(now_s)
        self._first_s = -math.inf if second else now_s
        return second

    def waits(self, now_s: float) -> bool:
        """Whether one more press now would do it."""
        return now_s - self._first_s <= TWICE_S
