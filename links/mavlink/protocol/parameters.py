"""An autopilot's parameters over MAVLink: reading several by name, setting one, insisting on one. Sans-IO.

PARAM_VALUE has one 32-bit float for every kind of number. PX4 puts the bytes of a whole number into it, ArduPilot
the number itself: taken for the other, 8 reads as 1.1e-44.
Source: mavlink.io/en/services/parameter.html (encodings "bytewise" and "C cast").
"""

import math
import struct
from collections.abc import Callable, Iterable
from typing import NamedTuple

from links.core import LinkError, LinkRejected
from links.mavlink.protocol.codec import PX4, Message
from links.mavlink.protocol.steps import ANSWER_S, AutopilotAddress, Repeated

REAL32 = 9
"""MAV_PARAM_TYPE_REAL32."""
WHOLE_BITS = {1: (8, False), 2: (8, True), 3: (16, False), 4: (16, True), 5: (32, False), 6: (32, True)}
"""MAV_PARAM_TYPE of whole numbers → bits, signed."""
AT_ONCE = 8
"""Questions that may wait for their answers at the same time."""
ASKED = 4
"""A parameter that is asked for this often in vain is none of the autopilot's."""


class AutopilotParameter(NamedTuple):
    """A parameter as the autopilot has it."""

    name: str
    value: float
    kind: int
    """MAV_PARAM_TYPE."""


def decode(autopilot: int, number: float, kind: int) -> float:
    """The value of ``kind`` that an ``autopilot`` (HEARTBEAT.autopilot) says by the float ``number``."""
    if autopilot != PX4 or kind not in WHOLE_BITS:
        return number
    bits, signed = WHOLE_BITS[kind]
    return float(int.from_bytes(struct.pack("<f", number)[: bits // 8], "little", signed=signed))


def read_parameter(autopilot: int, message: Message) -> AutopilotParameter:
    """The parameter in a PARAM_VALUE of an ``autopilot`` (HEARTBEAT.autopilot); NaN where it is no number."""
    value = decode(autopilot, message.param_value, message.param_type)
    return AutopilotParameter(message.param_id, value, message.param_type)


def encode(autopilot: int, value: float, kind: int) -> float:
    """The float that says ``value`` of ``kind`` in a PARAM_SET to an ``autopilot`` (HEARTBEAT.autopilot).

    Raises:
        ValueError: such a parameter can't have this value.
    """
    if not math.isfinite(value):
        raise ValueError(f"{value} is no value for a parameter")
    if kind not in WHOLE_BITS:
        return value
    bits, signed = WHOLE_BITS[kind]
    low = -(1 << bits - 1) if signed else 0
    if value != int(value) or not low <= value < low + (1 << bits):
        raise ValueError(f"expected a whole number from {low} to {low + (1 << bits) - 1}, got {value:g}")
    if autopilot != PX4:
        return value
    data = int(value).to_bytes(bits // 8, "little", signed=signed)
    number: float = struct.unpack("<f", data.ljust(4, b"\0"))[0]
    return number


class ReadAll:
    """Ask for parameters by name; those that it never tells of it does not have."""

    failure: LinkError | None = None

    def __init__(self, autopilot: AutopilotAddress, names: Iterable[str]) -> None:
        """What came is in ``found`` when done."""
        self.found: dict[str, AutopilotParameter] = {}
        self._autopilot = autopilot
        self._left = dict.fromkeys(names, 0)
        self._asked_s: dict[str, float] = {}

    @property
    def done(self) -> bool:
        """Every one is told or given up."""
        return not self._left

    def poll(self, now_s: float) -> list[bytes]:
        """The questions that are due."""
        codec, system, component = self._autopilot.codec, self._autopilot.system, self._autopilot.component
        for name in [name for name, at_s in self._asked_s.items() if now_s >= at_s + ANSWER_S]:
            del self._asked_s[name]
            if self._left[name] >= ASKED:
                del self._left[name]
        # Seldom asked first: the ones that it does not have must not hold up the others.
        waiting = sorted((name for name in self._left if name not in self._asked_s), key=self._left.__getitem__)
        due = waiting[: AT_ONCE - len(self._asked_s)]
        for name in due:
            self._left[name] += 1
            self._asked_s[name] = now_s
        return [codec.parameter_request(system, component, name) for name in due]

    def hear(self, message: Message, now_s: float) -> None:
        """Take a parameter's value."""
        if message.get_type() != "PARAM_VALUE" or message.param_id not in self._left:
            return
        parameter = read_parameter(self._autopilot.kind, message)
        if math.isfinite(parameter.value):
            self.found[parameter.name] = parameter
            del self._left[parameter.name]
            self._asked_s.pop(parameter.name, None)


class Write(Repeated):
    """Set one parameter until the autopilot tells that it has the value."""

    def __init__(self, autopilot: AutopilotAddress, parameter: AutopilotParameter) -> None:
        """Its kind must be what the autopilot told.

        Raises:
            ValueError: such a parameter can't have this value.
        """
        number = encode(autopilot.kind, parameter.value, parameter.kind)
        codec, system, component = autopilot.codec, autopilot.system, autopilot.component
        super().__init__(
            f"set its parameter {parameter.name} to {parameter.value:g}",
            lambda _: codec.parameter_set(system, component, parameter.name, number, parameter.kind),
        )
        self._autopilot = autopilot
        self._parameter = parameter

    def hear(self, message: Message, now_s: float) -> None:
        """Take the parameter's new value."""
        wanted = self._parameter
        if message.get_type() != "PARAM_VALUE" or message.param_id != wanted.name or not self._sent:
            return
        got = read_parameter(self._autopilot.kind, message).value
        if is_same(got, wanted.value):
            self.done = True
        else:
            reason = self._autopilot.words.complaints() or "it gave no reason"
            self.failure = LinkRejected(
                f"{self._autopilot.name} keeps {wanted.name} at {got:g} instead of {wanted.value:g}: {reason}"
            )


class ParameterMust(Repeated):
    """Make sure that a parameter of ArduPilot has a value that we can fly with."""

    def __init__(self, autopilot: AutopilotAddress, name: str, accepts: Callable[[int], bool], hint: str) -> None:
        """Ask ``autopilot`` for the whole number ``name``; where ``accepts`` says no, fail with ``hint``."""
        super().__init__(
            f"tell its parameter {name}",
            lambda _: autopilot.codec.parameter_request(autopilot.system, autopilot.component, name),
        )
        self._name = name
        self._accepts = accepts
        self._hint = hint

    def hear(self, message: Message, now_s: float) -> None:
        """Take the parameter's value."""
        if message.get_type() != "PARAM_VALUE" or message.param_id != self._name:
            return
        if math.isfinite(message.param_value):
            # ArduPilot sends whole numbers as floats of the same value.
            self.done = self._accepts(int(message.param_value))
            if not self.done:
                self.failure = LinkRejected(f"{self._name} is {message.param_value:g}: {self._hint}")


def is_same(a: float, b: float) -> bool:
    """Equal as 32-bit floats."""
    return struct.pack("<f", a) == struct.pack("<f", b)
