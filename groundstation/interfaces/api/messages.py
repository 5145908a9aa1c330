"""Messages of a ground station and its local clients: one JSON object a line, UTF-8. Sans-IO.

To a client, told apart by their one key::

    {"hello": {"version": 1, "vehicle": "mqx", "pid": 7, "groundstation": "0.1.0", "config": "TOML
    in force"}}
    {"control": {"holder": "tui 1234", "yours": false}}      first, and whenever it changes; holder
                                                             null: nobody
    {"snapshot": {...}}                                      a
                                                             :class:`~groundstation.core.messages.snapshot.Snapshot`
    {"answer": {"id": 7, "done": true, "says": "landing: told by tui 1234"}}
    {"refused": "..."}                                       a line that was no order: it has done
                                                             nothing

From a client, an :class:`ClientOrder`; its ids grow, so that a line that is played again does
nothing::

    {"id": 7, "ask": "land", "why": "too windy"}             land, descend, abort, kill: anyone
                                                             attached
    {"id": 8, "control": "take", "name": "tui"}              or "give"
    {"id": 9, "ask": "hold"}                                 arm, hold, track, return: needs control
    {"id": 10, "ask": "arm", "vehicle": "mqx", "until_s": 8123.4}    names the vehicle, as --arm
                                                                     does; late, it is none
    {"id": 11, "set": {"controller.k1": 3.2}}                needs control
    {"id": 12, "ask": "goto", "points": [[1.0, 0.5, -1.2], [0, 0, -1, 90]]}    needs control; north,
                                                                               east, down, yaw

A number that is not finite is ``null``. Keys may be added to what a client hears: it ignores those
it does not know. What a client says has no others.

The control desk: one client holds control; anyone attached may bring the vehicle down. Sans-IO.
"""

import math
import types
import typing
from typing import Annotated, Any, Literal, NamedTuple, Protocol, TypeAlias

import msgspec

from groundstation.config import locate
from groundstation.core.messages import (
    Ask,
    Notice,
    Numbers,
    Reply,
    Request,
    Sentence,
    Snapshot,
    Waypoints,
    ensure_points,
    notice,
)
from links.text import printable

VERSION = 2
"""Version of this protocol."""
ORDER_MAX_BYTES = 65536
"""No order is longer."""
LINE_MAX_BYTES = 1 << 20
"""Nothing that a client hears is longer."""


class ClientOrder(
    msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True, forbid_unknown_fields=True
):
    """Order of a client: exactly one of ``ask``, ``control`` and ``set``."""

    id: Annotated[int, msgspec.Meta(ge=0, le=1 << 53)]
    """Greater than that of any order before it on this connection."""
    ask: Ask | None = None
    control: Literal["take", "give"] | None = None
    gains: Annotated[dict[str, float], msgspec.Meta(min_length=1, max_length=8)] | None = (
        msgspec.field(name="set", default=None)
    )
    """Dotted keys of the configuration, and the values that they shall have."""
    points: Waypoints = ()
    """Where to, for ``goto``."""
    why: Annotated[str, msgspec.Meta(max_length=200)] = ""
    """Why, in words."""
    vehicle: Annotated[str, msgspec.Meta(max_length=64)] = ""
    """Which vehicle shall be armed."""
    name: Annotated[str, msgspec.Meta(max_length=32)] = ""
    """The client's name for itself; remembered from then on."""
    until_s: float | None = None
    """When it is too late for what starts or steers, on this machine's monotonic clock [s]; what
    brings the vehicle down is done at any time."""

    def __post_init__(self) -> None:
        ensure_points(self.ask, self.points)
        if sum(one is not None for one in (self.ask, self.control, self.gains)) != 1:
            raise ValueError(notice("order.not_one"))


class StationHello(msgspec.Struct, frozen=True):
    """The station's introduction."""

    version: int
    vehicle: str
    pid: int
    groundstation: str
    """The program's version."""
    config: str
    """The configuration in force, as TOML."""


class Control(msgspec.Struct, frozen=True):
    """Message on who holds control."""

    holder: str | None
    yours: bool


class OrderAnswer(msgspec.Struct, frozen=True):
    """Answer to an order."""

    id: int
    """The order's number, which its sender gave it."""
    done: bool
    """Whether it was followed."""
    says: str
    """The action taken, or the reason against it."""
    message: str = ""
    """Which sentence that is (docs/reference/messages.md)."""
    numbers: Numbers = {}
    """Its numbers, by their names."""


class Refusal(msgspec.Struct, frozen=True):
    """Why a line was no order."""

    text: str


Message: TypeAlias = StationHello | Control | Snapshot | OrderAnswer | Refusal

_KEYS: dict[type, str] = {
    StationHello: "hello",
    Control: "control",
    Snapshot: "snapshot",
    OrderAnswer: "answer",
}
_TYPES: dict[str, Any] = {key: kind for kind, key in _KEYS.items()}
SNAPSHOT_PREFIX = b'{"snapshot":'
"""A client that wants only the newest knows one by this, without decoding it."""


def new_events(before: tuple[Notice, ...], now: tuple[Notice, ...]) -> tuple[Notice, ...]:
    """The events of ``now`` that follow those of ``before``: both are windows of one list."""
    for start in range(len(before)):
        tail = before[start:]
        if now[: len(tail)] == tail:
            return now[len(tail) :]
    return now


def encode(message: Message) -> bytes:
    """``message`` as a line."""
    if isinstance(message, Refusal):
        return msgspec.json.encode({"refused": message.text}) + b"\n"
    return msgspec.json.encode({_KEYS[type(message)]: message}) + b"\n"


def encode_order(order: ClientOrder) -> bytes:
    """``order`` as a line."""
    return msgspec.json.encode(order) + b"\n"


def decode_order(line: bytes) -> ClientOrder | str:
    """The order in ``line``, or why it is none."""
    try:
        return msgspec.json.decode(line, type=ClientOrder)
    except msgspec.ValidationError as error:
        return ": ".join(part for part in ("not an order", *locate(error)) if part)
    except (msgspec.DecodeError, RecursionError, UnicodeDecodeError) as error:
        return f"not an order: {error}"


def decode(line: bytes) -> Message | None:
    """The message in ``line``; None where it is of a kind that this version does not know.

    Raises:
        ValueError: it is no message.
    """
    try:
        data = msgspec.json.decode(line)
        if not isinstance(data, dict) or len(data) != 1:
            raise ValueError(notice("order.keys"))
        [(key, body)] = data.items()
        if key == "refused":
            return Refusal(str(body))
        if key == "snapshot":
            return _snapshot(body)
        kind = _TYPES.get(key)
        return None if kind is None else typing.cast("Message", msgspec.convert(body, kind))
    except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError) as error:
        raise ValueError(str(error)) from error


def _snapshot(body: Any) -> Snapshot:
    try:
        return msgspec.convert(body, Snapshot)
    except msgspec.ValidationError:
        return msgspec.convert(_with_nan(body, Snapshot), Snapshot)


def _without_notes(kind: Any) -> Any:
    """Return the type ``T`` of ``Annotated[T, …]``, and any other type as it is."""
    while typing.get_origin(kind) is typing.Annotated:
        kind = typing.get_args(kind)[0]
    return kind


def _with_nan(body: Any, kind: Any) -> Any:
    """JSON has no NaN: a null where a number must stand was one that is not finite."""
    kind = _without_notes(kind)
    options = typing.get_args(kind) if isinstance(kind, types.UnionType) else (kind,)
    if body is None:
        return None if types.NoneType in options else math.nan
    [kind] = [_without_notes(option) for option in options if option is not types.NoneType]
    if isinstance(body, list):
        parts = typing.get_args(kind)
        each = parts if Ellipsis not in parts else parts[:1] * len(body)
        return [_with_nan(item, part) for item, part in zip(body, each, strict=True)]
    if isinstance(body, dict) and isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        fields = {field.encode_name: field.type for field in msgspec.structs.fields(kind)}
        return {
            key: _with_nan(value, fields[key]) if key in fields else value
            for key, value in body.items()
        }
    return body


ANYONE = frozenset({Ask.LAND, Ask.DESCEND, Ask.ABORT, Ask.KILL})
"""Requests that need no control: each only brings the vehicle down."""


class Core(Protocol):
    """Receiver of orders: a flight, or a daemon with one flight after the other."""

    def ask(self, request: Request) -> Reply:
        """Do it, or say why not."""

    def set_gain(self, key: str, value: float) -> Reply:
        """Begin to move a gain, or say why not."""

    def say(self, sentence: Sentence) -> None:
        """An event of the flight."""


class Allowance(NamedTuple):
    """A burst, and a rate ever after."""

    rate_hz: float
    """[1/s]"""
    burst: float
    """Number that may come at once [-]."""


class TokenBucket:
    """Allows no more than an :class:`Allowance`."""

    def __init__(self, allowance: Allowance) -> None:
        self._rate_hz, self._burst = allowance
        self._left = allowance.burst
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
        """The client's name for itself, and its process."""
        return f"{self._name}{self._pid}"

    def introduce(self, name: str) -> None:
        """Take the client's name for itself."""
        self._name = printable(name).strip() or self._name

    def replays(self, order: ClientOrder) -> bool:
        """Whether ``order`` is not newer than those before it."""
        old = order.id <= self._newest_id
        self._newest_id = max(self._newest_id, order.id)
        return old


class Desk:
    """Takes the orders of all clients, one after the other."""

    def __init__(self, vehicle: str, core: Core) -> None:
        self._vehicle = vehicle
        self._core = core
        self._holder: Party | None = None

    def control(self, party: Party) -> Control:
        """Return the message on who holds control, as ``party`` gets it."""
        return Control(None if self._holder is None else self._holder.label, self._holder is party)

    @property
    def is_held(self) -> bool:
        """Whether anybody holds control."""
        return self._holder is not None

    def take(self, order: ClientOrder, party: Party, now_s: float) -> OrderAnswer:
        """Do what ``order`` says, or say why not.

        ``now_s`` is on this machine's monotonic clock [s].
        """
        if order.name:
            party.introduce(order.name)
        if order.control is not None:
            reply = (
                self._take_control(party) if order.control == "take" else self._give_control(party)
            )
        elif order.ask is not None and order.ask in ANYONE:
            reply = self._ask(order, party)
        elif order.until_s is not None and now_s > order.until_s:
            reply = Reply.of(False, notice("order.late", late_s=now_s - order.until_s))
        elif self._holder is not party:
            reply = Reply.of(False, notice("order.needs_control", holder=self._who()))
        elif order.ask is None:
            reply = self._set(order)
        elif order.ask is Ask.ARM and order.vehicle != self._vehicle:
            reply = Reply.of(
                False, notice("order.other_vehicle", expected=self._vehicle, found=order.vehicle)
            )
        else:
            reply = self._ask(order, party)
        return OrderAnswer(order.id, reply.done, reply.says, reply.id, reply.numbers)

    def from_afar(self, request: Request) -> Reply:
        """Do what somebody asks who is not attached here.

        Never to arm; what needs control, only while nobody here holds it.
        """
        if request.ask is Ask.ARM:
            return Reply.of(False, notice("order.arm_from_afar"))
        if request.ask not in ANYONE and self._holder is not None:
            return Reply.of(False, notice("order.controlled_here", holder=self._who()))
        return self._core.ask(request)

    def leave(self, party: Party) -> bool:
        """``party`` has gone; True where control went with it."""
        if self._holder is not party:
            return False
        self._holder = None
        self._core.say(notice("control.gone", client=party.label))
        return True

    def _who(self) -> str:
        return "nobody" if self._holder is None else self._holder.label

    def _take_control(self, party: Party) -> Reply:
        if self._holder is party:
            return Reply.of(True, notice("control.yours_already"))
        if self._holder is not None:
            return Reply.of(False, notice("control.other", client=self._holder.label))
        self._holder = party
        self._core.say(notice("control.held", client=party.label))
        return Reply.of(True, notice("control.yours"))

    def _give_control(self, party: Party) -> Reply:
        if self._holder is not party:
            return Reply.of(False, notice("control.not_yours", client=self._who()))
        self._holder = None
        self._core.say(notice("control.given", client=party.label))
        return Reply.of(True, notice("control.free"))

    def _ask(self, order: ClientOrder, party: Party) -> Reply:
        assert order.ask is not None, "the caller has looked"
        why = printable(order.why).strip()
        told = f"{why} ({party.label})" if why else f"told by {party.label}"
        return self._core.ask(Request(order.ask, told, order.points))

    def _set(self, order: ClientOrder) -> Reply:
        assert order.gains is not None, "an order has one of the three"
        replies = [self._core.set_gain(key, value) for key, value in order.gains.items()]
        if len(replies) == 1:
            return replies[0]
        says = "; ".join(reply.says for reply in replies)
        return Reply.of(all(reply.done for reply in replies), notice("gain.several", says=says))
