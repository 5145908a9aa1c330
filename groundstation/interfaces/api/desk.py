"""Control desk: one client holds control; anyone attached may bring the vehicle down. Sans-IO."""

from typing import Protocol

from groundstation.core.messages import Ask, Reply, Request
from groundstation.interfaces.api.messages import ClientOrder, Control, OrderAnswer
from links.core import printable

ANYONE = frozenset({Ask.LAND, Ask.DESCEND, Ask.ABORT, Ask.KILL})
"""What needs no control: it only ever brings the vehicle down."""


class Core(Protocol):
    """What is asked: a flight, or a daemon with one flight after the other."""

    def ask(self, request: Request) -> Reply:
        """Do it, or say why not."""
        ...

    def set_gain(self, key: str, value: float) -> Reply:
        """Begin to move a gain, or say why not."""
        ...

    def note(self, text: str) -> None:
        """An event of the flight."""
        ...


class TokenBucket:
    """Allows a burst, and a rate ever after."""

    def __init__(self, rate_hz: float, burst: float) -> None:
        """Begin full."""
        self._rate_hz = rate_hz
        self._burst = self._left = burst
        self._at_s: float | None = None

    def take(self, now_s: float) -> bool:
        """Whether one more is allowed at ``now_s``."""
        elapsed_s = 0.0 if self._at_s is None else max(0.0, now_s - self._at_s)
        self._left = min(self._burst, self._left + self._rate_hz * elapsed_s)
        self._at_s = now_s
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


class Party:
    """One client, as the operator shall read of it."""

    def __init__(self, pid: int | None) -> None:
        """``pid`` is its process, where the system tells."""
        self._pid = "" if pid is None else f" {pid}"
        self._name = "client"
        self._newest_id = -1

    @property
    def label(self) -> str:
        """What it calls itself, and its process."""
        return f"{self._name}{self._pid}"

    def introduce(self, name: str) -> None:
        """It has told its name."""
        self._name = printable(name).strip() or self._name

    def replays(self, order: ClientOrder) -> bool:
        """Whether ``order`` is not newer than those before it."""
        old = order.id <= self._newest_id
        self._newest_id = max(self._newest_id, order.id)
        return old


class Desk:
    """Takes the orders of all clients, one after the other."""

    def __init__(self, vehicle: str, core: Core) -> None:
        """Nobody holds control."""
        self._vehicle = vehicle
        self._core = core
        self._holder: Party | None = None

    def control(self, party: Party) -> Control:
        """Who holds control, as told to ``party``."""
        return Control(None if self._holder is None else self._holder.label, self._holder is party)

    @property
    def is_held(self) -> bool:
        """Whether anybody holds control."""
        return self._holder is not None

    def take(self, order: ClientOrder, party: Party, now_s: float) -> OrderAnswer:
        """Do what ``order`` says, or say why not; ``now_s`` is on this machine's monotonic clock [s]."""
        if order.name:
            party.introduce(order.name)
        if order.control is not None:
            reply = self._take_control(party) if order.control == "take" else self._give_control(party)
        elif order.ask is not None and order.ask in ANYONE:
            reply = self._ask(order, party)
        elif order.until_s is not None and now_s > order.until_s:
            reply = Reply(False, f"it came {now_s - order.until_s:.1f} s too late: nothing was done; order it again")
        elif self._holder is not party:
            reply = Reply(False, f"needs control, which {self._who()} holds: take it first")
        elif order.ask is None:
            reply = self._set(order)
        elif order.ask is Ask.ARM and order.vehicle != self._vehicle:
            reply = Reply(False, f"arm must name the vehicle: expected {self._vehicle!r}, got {order.vehicle!r}")
        else:
            reply = self._ask(order, party)
        return OrderAnswer(order.id, reply.done, reply.says)

    def from_afar(self, request: Request) -> Reply:
        """Do what somebody asks who is not attached here.

        Never to arm; what needs control, only while nobody here holds it.
        """
        if request.ask is Ask.ARM:
            return Reply(False, "nobody arms from afar: only who stands by the vehicle may")
        if request.ask not in ANYONE and self._holder is not None:
            return Reply(False, f"{self._who()} holds control at the station: from afar it can only be brought down")
        return self._core.ask(request)

    def leave(self, party: Party) -> bool:
        """``party`` has gone; True where control went with it."""
        if self._holder is not party:
            return False
        self._holder = None
        self._core.note(f"{party.label} has gone, and held control: nobody does now")
        return True

    def _who(self) -> str:
        return "nobody" if self._holder is None else self._holder.label

    def _take_control(self, party: Party) -> Reply:
        if self._holder is party:
            return Reply(True, "you hold control already")
        if self._holder is not None:
            return Reply(False, f"{self._holder.label} holds control; it must give it first, or go")
        self._holder = party
        self._core.note(f"{party.label} holds control")
        return Reply(True, "you hold control")

    def _give_control(self, party: Party) -> Reply:
        if self._holder is not party:
            return Reply(False, f"you do not hold control; {self._who()} does")
        self._holder = None
        self._core.note(f"{party.label} has given control away")
        return Reply(True, "nobody holds control now")

    def _ask(self, order: ClientOrder, party: Party) -> Reply:
        assert order.ask is not None, "the caller has looked"
        why = printable(order.why).strip()
        told = f"{why} ({party.label})" if why else f"told by {party.label}"
        return self._core.ask(Request(order.ask, told, order.points))

    def _set(self, order: ClientOrder) -> Reply:
        assert order.gains is not None, "an order has one of the three"
        replies = [self._core.set_gain(key, value) for key, value in order.gains.items()]
        return Reply(all(reply.done for reply in replies), "; ".join(reply.says for reply in replies))
