"""Procedures: what an autopilot must go through with us: arming, disarming, choosing what it sends.

Sans-IO.

The caller streams set-points while they last. What shapes them, measured on PX4 1.16-alpha and
ArduCopter 4.8-dev:

- PX4 arms in OFFBOARD only after set-points have come for about a second. Before, it still accepts
  the mode while disarmed, and then denies to arm; so the acceptance of the mode proves nothing, and
  streaming comes first.
- HEARTBEAT tells mode and armed state only once a second: what counts is COMMAND_ACK.
- PX4 denies to disarm for 1-3 s after touchdown, until it believes that it stands.
- ArduCopter takes thrust as a climb rate unless GUID_OPTIONS has bit 3 set, and raises the thrust
  of a leaning vehicle, as our controller has done already, unless ATC_ANGLE_BOOST is 0.
- ArduCopter's rotors stand for 2 s after it has acknowledged that it is armed; thrust before lifts
  nothing.
- ArduCopter refuses to disarm in GUIDED after a touchdown at zero thrust; mode LAND disarms by
  itself.

Parameters are read by name, set one by one, and insisted on. PARAM_VALUE has one 32-bit float for
every kind of number. PX4 puts the bytes of a whole number into it, ArduPilot the number itself:
taken for the other, 8 reads as 1.1e-44. Source: mavlink.io/en/services/parameter.html (encodings
"bytewise" and "C cast").

Steps: single things that an autopilot is asked for, each a state machine. A step is polled with the
time and answers with frames to send; it is shown every message that arrives; it ends ``done`` or
with a ``failure``, which tells the operator what the autopilot said and what to do. A
:class:`Handshake` is steps one after the other.

Source: mavlink.io/en/services/command.html (COMMAND_LONG until its COMMAND_ACK);
mavlink.io/en/messages/common.html (0 HEARTBEAT, 148 AUTOPILOT_VERSION, MAV_CMD_REQUEST_MESSAGE);
the four bytes of flight_sw_version are major, minor, patch and FIRMWARE_VERSION_TYPE, as PX4 and
ArduPilot fill it in.
"""

import math
import struct
from collections import deque
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from enum import IntEnum, IntFlag
from itertools import islice
from typing import NamedTuple, Protocol

from links.core import DISARM_S, LinkError, LinkLost, LinkRejected
from links.mavlink.protocol.autopilot_state import ESTIMATE, ESTIMATE_HZ, AutopilotTexts
from links.mavlink.protocol.codec import (
    ARDUPILOT,
    ARMED,
    FORCE,
    PX4,
    MavCommand,
    MavlinkCodec,
    MavResult,
    Message,
)
from links.text import Sentence, link_notice


class AutopilotAddress(NamedTuple):
    """Autopilot to ask: its codec, ids and kind."""

    codec: MavlinkCodec
    """Packs the requests."""
    words: AutopilotTexts
    """Its latest status texts."""
    system: int
    """Its MAVLink system."""
    component: int
    """Its MAVLink component."""
    kind: int
    """Its HEARTBEAT.autopilot."""
    vehicle: int = 2
    """Its HEARTBEAT.type; 2 is a quadrotor."""

    @property
    def name(self) -> str:
        """The autopilot's name for the operator."""
        return {PX4: "PX4", ARDUPILOT: "ArduPilot"}.get(self.kind, "the autopilot")

    @property
    def kind_name(self) -> str:
        """MAVLink's name of its kind."""
        return self.codec.value_name("MAV_AUTOPILOT", self.kind)

    @property
    def complaints(self) -> str:
        """Its latest warnings, as the reason of a refusal; or that it gave none."""
        return self.words.complaints() or link_notice("autopilot.no_reason").text

    def command(self, command: int, *params: float, repetition: int = 0) -> bytes:
        """COMMAND_LONG to it."""
        return self.codec.command(
            self.system, self.component, command, *params, confirmation=min(repetition, 255)
        )

    def message_request(self, name: str, repetition: int = 0) -> bytes:
        """COMMAND_LONG that asks it for one message ``name``."""
        return self.command(
            MavCommand.REQUEST_MESSAGE,
            float(self.codec.message_number(name)),
            repetition=repetition,
        )

    def answers(self, message: Message, command: int) -> bool:
        """Whether ``message`` is its answer to a ``command`` of ours, not of another station's."""
        if message.get_type() != "COMMAND_ACK" or message.command != command:
            return False
        return message.target_system in (0, self.codec.system_id)


class HandshakeStep(Protocol):
    """One thing to be reached."""

    @property
    def done(self) -> bool:
        """True when it is reached."""

    @property
    def failure(self) -> LinkError | None:
        """Why it will not be reached; None where that is open."""

    def poll(self, now_s: float) -> list[bytes]:
        """Frames to send at ``now_s``."""

    def take_message(self, message: Message, now_s: float) -> None:
        """Take a message from the autopilot."""


class Handshake:
    """Steps one after the other; a step like them."""

    def __init__(self, steps: Iterable[HandshakeStep]) -> None:
        """The first failure ends it."""
        self._steps = deque(steps)
        self.failure: LinkError | None = None

    @property
    def done(self) -> bool:
        """True when every step is."""
        return not self._steps

    @property
    def at_last_step(self) -> bool:
        """True once the last request may have left: then it only waits."""
        return all(isinstance(step, Wait) for step in islice(self._steps, 1, None))

    def poll(self, now_s: float) -> list[bytes]:
        """Frames to send at ``now_s``."""
        while self._steps and self.failure is None:
            step = self._steps[0]
            frames = step.poll(now_s)
            self.failure = step.failure
            if not step.done:
                return frames
            self._steps.popleft()
        return []

    def take_message(self, message: Message, now_s: float) -> None:
        """Take a message from the autopilot."""
        if self._steps:
            self._steps[0].take_message(message, now_s)


class Wait:
    """Let time pass, while set-points stream."""

    failure: LinkError | None = None

    def __init__(self, duration_s: float) -> None:
        """Wait for ``duration_s`` [s] from the first poll on."""
        self._duration = duration_s
        self._until: float | None = None
        self.done = False

    def poll(self, now_s: float) -> list[bytes]:
        """No frames."""
        if self._until is None:
            self._until = now_s + self._duration
        self.done = now_s >= self._until
        return []

    def take_message(self, message: Message, now_s: float) -> None:
        """Nothing to learn."""


class Repeated:
    """A request that is sent again until something answers it."""

    period_s = 0.5
    """Time between two requests [s]."""
    tries = 6
    """Unanswered requests after which it gives up."""

    def __init__(self, what: str, frame: Callable[[int], bytes]) -> None:
        """``frame(n)`` is the request's n-th repetition; ``what`` completes "to …"."""
        self.done = False
        self.failure: LinkError | None = None
        self._what = what
        self._frame = frame
        self._sent = 0
        self._unanswered = 0
        self._next_s = self._since_s = -math.inf

    def poll(self, now_s: float) -> list[bytes]:
        """The request, where it is due."""
        if self.done or self.failure is not None or now_s < self._next_s:
            return []
        if self._unanswered == self.tries:
            self._give_up()
            return []
        if not self._sent:
            self._since_s = now_s
        self._next_s = now_s + self.period_s
        frame = self._frame(self._sent)
        self._sent += 1
        self._unanswered += 1
        return [frame]

    def _give_up(self) -> None:
        self.failure = LinkLost(
            link_notice("autopilot.unanswered", what=self._what, count=self.tries)
        )

    def _await_more(self, next_s: float) -> None:
        """There was an answer, but no end: ask again at ``next_s``."""
        self._unanswered = 0
        self._next_s = next_s


class Disarmed:
    """Wait for a HEARTBEAT that says that the motors are off."""

    def __init__(self, patience_s: float) -> None:
        self.done = False
        self.failure: LinkError | None = None
        self._patience = patience_s
        self._until: float | None = None

    def poll(self, now_s: float) -> list[bytes]:
        """No frames."""
        if self._until is None:
            self._until = now_s + self._patience
        elif now_s >= self._until:
            self.failure = LinkRejected(
                link_notice("autopilot.still_armed", patience_s=self._patience)
            )
        return []

    def take_message(self, message: Message, now_s: float) -> None:
        """Take a heartbeat."""
        if message.get_type() == "HEARTBEAT" and not message.base_mode & ARMED:
            self.done = True


PATIENCE_S = 4.0
"""For how long a refusal that may pass is answered by asking again [s]."""
AGAIN_S = 1.0
"""Pause before asking again after such a refusal [s]."""
WORDS_S = 0.3
"""The autopilot's explanation of a refusal is awaited for this long [s]."""

_MAY_PASS = (MavResult.TEMPORARILY_REJECTED, MavResult.FAILED)


class Exchange(Repeated):
    """One COMMAND_LONG until its COMMAND_ACK."""

    def __init__(
        self,
        autopilot: AutopilotAddress,
        what: str,
        command: int,
        params: Sequence[float],
        hint: Sentence | str,
        patience_s: float = PATIENCE_S,
        any_answer: bool = False,
    ) -> None:
        """Ask ``autopilot`` for ``command``.

        A refusal quotes its words and ends with ``hint``: what to do.

        A refusal that may pass is final after ``patience_s`` [s]; with ``any_answer`` it is as good
        as a yes.
        """
        super().__init__(what, lambda n: autopilot.command(command, *params, repetition=n))
        self._autopilot = autopilot
        self._command = command
        self._hint = str(hint)
        self._patience = patience_s
        self._any_answer = any_answer
        self._refused: tuple[int, float] | None = None

    def poll(self, now_s: float) -> list[bytes]:
        """The request, where it is due."""
        if self._refused is None:
            return super().poll(now_s)
        result, at_s = self._refused
        if now_s >= at_s + WORDS_S and self.failure is None:
            self.failure = LinkRejected(
                link_notice(
                    "autopilot.refused",
                    autopilot=self._autopilot.name,
                    what=self._what,
                    because=self._autopilot.codec.describe_result(result),
                    reason=self._autopilot.complaints,
                    hint=self._hint,
                )
            )
        return []

    def take_message(self, message: Message, now_s: float) -> None:
        """Take the answer, where ``message`` is one and answers us."""
        if not self._sent or not self._autopilot.answers(message, self._command):
            return
        result = message.result
        if result == MavResult.ACCEPTED or self._any_answer:
            self.done = True
        elif result == MavResult.IN_PROGRESS:
            self._await_more(now_s + self.period_s * self.tries)
        elif result in _MAY_PASS and now_s < self._since_s + self._patience:
            self._await_more(now_s + AGAIN_S)
        else:
            self._refused = (result, now_s)


KINDS = {0: "dev", 64: "alpha", 128: "beta", 192: "rc", 255: "release"}
"""FIRMWARE_VERSION_TYPE."""


class ReadVersion(Repeated):
    """Ask for the firmware's version; one that it does not tell is no failure."""

    tries = 3
    """An autopilot that does not tell after so many questions keeps it to itself."""

    def __init__(self, autopilot: AutopilotAddress) -> None:
        """Ask ``autopilot`` for its firmware; the answer is in ``firmware`` when done."""
        super().__init__(
            "tell its version", lambda n: autopilot.message_request("AUTOPILOT_VERSION", n)
        )
        self.firmware = ""
        """Version text, e.g. ``PX4 1.16.0 release 0a1b2c3d4e5f6071``; empty without a report."""
        self._autopilot = autopilot

    def _give_up(self) -> None:
        self.done = True

    def take_message(self, message: Message, now_s: float) -> None:
        """Take the version, or the answer that there is none."""
        if message.get_type() == "AUTOPILOT_VERSION":
            self.firmware = f"{self._autopilot.name} {version(message)}"
            self.done = True
        elif (
            self._autopilot.answers(message, MavCommand.REQUEST_MESSAGE)
            and message.result != MavResult.ACCEPTED
        ):
            self.done = True


def version(message: Message) -> str:
    """Version by AUTOPILOT_VERSION: number, kind, and the first bytes of the commit."""
    number = int(message.flight_sw_version)
    major = number >> 24 & 0xFF
    minor = number >> 16 & 0xFF
    patch = number >> 8 & 0xFF
    kind = number & 0xFF
    commit = bytes(message.flight_custom_version).hex()
    return f"{major}.{minor}.{patch} {KINDS.get(kind, kind)} {commit}"


class AskMode(Repeated):
    """Ask for HEARTBEAT, which tells the mode and comes only once a second by itself.

    Done when one has been heard.

    One that refuses is waited for. Its answer is waited for, too: a HEARTBEAT of before the
    question may be under way.
    """

    period_s = 0.1
    tries = 15
    """Number of requests: 1.5 s of them, while the bring-down goes on."""

    def __init__(self, autopilot: AutopilotAddress) -> None:
        super().__init__("tell its mode", lambda n: autopilot.message_request("HEARTBEAT", n))
        self._autopilot = autopilot
        self._heard = self._answered = False

    def _give_up(self) -> None:
        self.failure = LinkLost(
            link_notice("autopilot.no_mode", limit_s=self.tries * self.period_s)
        )

    def take_message(self, message: Message, now_s: float) -> None:
        """Take a heartbeat, or the answer."""
        self._heard = self._heard or message.get_type() == "HEARTBEAT"
        self._answered = self._answered or self._autopilot.answers(
            message, MavCommand.REQUEST_MESSAGE
        )
        self.done = self._heard and self._answered


class Kill(Repeated):
    """Disarm by force (COMMAND_LONG 400, second parameter 21196), which works in the air.

    A step.
    """

    period_s = 0.05
    tries = 100
    """Number of requests: 5 s of them."""
    acceptances = 2
    """Number that end the request: one alone may answer an order to arm that was under way."""

    def __init__(self, autopilot: AutopilotAddress) -> None:
        super().__init__(
            "stop its motors",
            lambda n: autopilot.command(MavCommand.ARM_DISARM, 0.0, FORCE, repetition=n),
        )
        self._autopilot = autopilot
        self._accepted = 0
        self._refused: int | None = None

    def take_message(self, message: Message, now_s: float) -> None:
        """Take the answer, where ``message`` is one."""
        if not self._sent or not self._autopilot.answers(message, MavCommand.ARM_DISARM):
            return
        if message.result == MavResult.ACCEPTED:
            self._accepted += 1
            self.done = self._accepted >= self.acceptances
        else:
            self._refused = message.result

    def _give_up(self) -> None:
        if self._accepted:  # the rest of the answers got lost
            self.done = True
        elif self._refused is None:
            self.failure = LinkLost(link_notice("kill.unanswered", count=self._sent))
        else:
            name = self._autopilot.name
            because = self._autopilot.codec.describe_result(self._refused)
            reason = self._autopilot.complaints
            self.failure = LinkRejected(
                link_notice("kill.refused", autopilot=name, because=because, reason=reason)
            )


class MavParamType(IntEnum):
    """MAV_PARAM_TYPE."""

    UINT8 = 1
    INT8 = 2
    UINT16 = 3
    INT16 = 4
    UINT32 = 5
    INT32 = 6
    REAL32 = 9


INTEGER_BITS: dict[int, tuple[int, bool]] = {
    MavParamType.UINT8: (8, False),
    MavParamType.INT8: (8, True),
    MavParamType.UINT16: (16, False),
    MavParamType.INT16: (16, True),
    MavParamType.UINT32: (32, False),
    MavParamType.INT32: (32, True),
}
"""Types of whole numbers → bits, signed."""
AT_ONCE = 8
"""Questions that may wait for their answers at the same time."""


class AutopilotParameter(NamedTuple):
    """A parameter as the autopilot has it."""

    name: str
    value: float
    kind: int
    """MAV_PARAM_TYPE."""


def decode_parameter(autopilot: int, number: float, kind: int) -> float:
    """Return the value of a parameter of ``kind`` (MAV_PARAM_TYPE) from the float ``number`` of an
    ``autopilot``'s PARAM_VALUE (HEARTBEAT.autopilot).
    """
    if autopilot != PX4 or kind not in INTEGER_BITS:
        return number
    bits, signed = INTEGER_BITS[kind]
    return float(int.from_bytes(struct.pack("<f", number)[: bits // 8], "little", signed=signed))


def read_parameter(autopilot: int, message: Message) -> AutopilotParameter:
    """The parameter in a PARAM_VALUE of an ``autopilot`` (HEARTBEAT.autopilot).

    NaN where it is no number.
    """
    value = decode_parameter(autopilot, message.param_value, message.param_type)
    return AutopilotParameter(message.param_id, value, message.param_type)


def encode_parameter(autopilot: int, value: float, kind: int) -> float:
    """Return the float for ``value`` of ``kind`` (MAV_PARAM_TYPE) in a PARAM_SET to an
    ``autopilot`` (HEARTBEAT.autopilot).

    Raises:
        ValueError: such a parameter can't have this value.
    """
    if not math.isfinite(value):
        raise ValueError(link_notice("parameter.no_value", found=value))
    if kind not in INTEGER_BITS:
        return value
    bits, signed = INTEGER_BITS[kind]
    low = -(1 << bits - 1) if signed else 0
    if value != int(value) or not low <= value < low + (1 << bits):
        high = low + (1 << bits) - 1
        raise ValueError(link_notice("parameter.whole_number", least=low, most=high, found=value))
    if autopilot != PX4:
        return value
    data = int(value).to_bytes(bits // 8, "little", signed=signed)
    number: float = struct.unpack("<f", data.ljust(4, b"\0"))[0]
    return number


class ReadParameters:
    """Read parameters by name; the autopilot has none of those that it never reports."""

    failure: LinkError | None = None

    def __init__(self, autopilot: AutopilotAddress, names: Iterable[str]) -> None:
        """Ask ``autopilot`` for parameters ``names``; the answers are in ``found`` when done."""
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
        codec = self._autopilot.codec
        system = self._autopilot.system
        component = self._autopilot.component
        for name in [
            name for name, at_s in self._asked_s.items() if now_s >= at_s + Repeated.period_s
        ]:
            del self._asked_s[name]
            if self._left[name] >= Repeated.tries:
                del self._left[name]
        # Seldom asked first: the ones that it does not have must not hold up the others.
        waiting = sorted(
            (name for name in self._left if name not in self._asked_s), key=self._left.__getitem__
        )
        due = waiting[: AT_ONCE - len(self._asked_s)]
        for name in due:
            self._left[name] += 1
            self._asked_s[name] = now_s
        return [codec.parameter_request(system, component, name) for name in due]

    def take_message(self, message: Message, now_s: float) -> None:
        """Take a parameter's value."""
        if message.get_type() != "PARAM_VALUE" or message.param_id not in self._left:
            return
        parameter = read_parameter(self._autopilot.kind, message)
        if math.isfinite(parameter.value):
            self.found[parameter.name] = parameter
            del self._left[parameter.name]
            self._asked_s.pop(parameter.name, None)


class WriteParameter(Repeated):
    """Set one parameter, until the autopilot reports the value."""

    def __init__(self, autopilot: AutopilotAddress, parameter: AutopilotParameter) -> None:
        """Its kind must be what the autopilot told.

        Raises:
            ValueError: such a parameter can't have this value.
        """
        number = encode_parameter(autopilot.kind, parameter.value, parameter.kind)
        codec, system, component = autopilot.codec, autopilot.system, autopilot.component
        super().__init__(
            f"set its parameter {parameter.name} to {parameter.value:g}",
            lambda _: codec.parameter_set(
                system, component, parameter.name, number, parameter.kind
            ),
        )
        self._autopilot = autopilot
        self._parameter = parameter

    def take_message(self, message: Message, now_s: float) -> None:
        """Take the parameter's new value."""
        wanted = self._parameter
        if message.get_type() != "PARAM_VALUE" or message.param_id != wanted.name or not self._sent:
            return
        got = read_parameter(self._autopilot.kind, message).value
        if is_same_float32(got, wanted.value):
            self.done = True
        else:
            self.failure = LinkRejected(
                link_notice(
                    "autopilot.keeps_parameter",
                    autopilot=self._autopilot.name,
                    name=wanted.name,
                    got=got,
                    wanted=wanted.value,
                    reason=self._autopilot.complaints,
                )
            )


class ParameterMust(Repeated):
    """Make sure that a parameter of ArduPilot has a value that we can fly with."""

    def __init__(
        self, autopilot: AutopilotAddress, name: str, accepts: Callable[[int], bool], hint: Sentence
    ) -> None:
        """Ask ``autopilot`` for the whole number ``name``.

        Where ``accepts`` says no, fail with ``hint``.
        """
        super().__init__(
            f"tell its parameter {name}",
            lambda _: autopilot.codec.parameter_request(
                autopilot.system, autopilot.component, name
            ),
        )
        self._name = name
        self._accepts = accepts
        self._hint = str(hint)

    def take_message(self, message: Message, now_s: float) -> None:
        """Take the parameter's value."""
        if message.get_type() != "PARAM_VALUE" or message.param_id != self._name:
            return
        if math.isfinite(message.param_value):
            # ArduPilot sends whole numbers as floats of the same value.
            self.done = self._accepts(int(message.param_value))
            if not self.done:
                self.failure = LinkRejected(
                    link_notice(
                        "autopilot.unfit_parameter",
                        name=self._name,
                        value=message.param_value,
                        hint=self._hint,
                    )
                )


def is_same_float32(a: float, b: float) -> bool:
    """Whether both are equal as 32-bit floats, as parameters travel."""
    return struct.pack("<f", a) == struct.pack("<f", b)


STREAM_S = 1.2
"""Set-points stream for this long before anything is asked [s]; PX4 wants a second of them."""
ARMING_DELAY_S = 2.5
"""ArduCopter's rotors turn by then after it was armed [s]: 2 s (ARMING_DELAY_SEC in its config.h),
on a slow clock."""

FOLLOWING_MODES = {"OFFBOARD": (1.0, 6.0), "GUIDED": (1.0, 4.0), "GUIDED_NOGPS": (1.0, 20.0)}
"""Modes that follow set-points, PX4's and ArduPilot's: parameters of MavCommand.DO_SET_MODE."""
MULTIROTORS = {
    2: "quadrotor",
    3: "coaxial",
    13: "hexarotor",
    14: "octorotor",
    15: "tricopter",
    29: "dodecarotor",
}
"""HEARTBEAT.type of vehicles that thrust and body rates fly."""

_LAND_MODE = {PX4: (1.0, 4.0, 6.0), ARDUPILOT: (1.0, 9.0)}


class GuidedOption(IntFlag):
    """Bits of ArduCopter's GUID_OPTIONS."""

    THRUST_AS_THRUST = 8
    """The thrust field is a thrust, no climb rate."""


def make_checks(autopilot: AutopilotAddress) -> Handshake:
    """Make the checks before arming that can be made without arming.

    Raises:
        LinkRejected: the autopilot is neither PX4 nor ArduPilot, or the vehicle no multirotor.
    """
    return Handshake(_musts(autopilot))


def make_arming(autopilot: AutopilotAddress, guided: str = "GUIDED") -> Handshake:
    """Make the hand-shake into the mode that follows our set-points, then motors on.

    The caller streams set-points throughout.

    ``guided`` is which of ``FOLLOWING_MODES`` that is on ArduPilot.

    Raises:
        LinkRejected: the autopilot is neither PX4 nor ArduPilot, or the vehicle no multirotor.
    """
    steps: list[HandshakeStep] = [Wait(STREAM_S), *_musts(autopilot)]
    mode = "OFFBOARD" if autopilot.kind == PX4 else guided
    hint = link_notice("hint.mode", mode=mode)
    steps.append(
        Exchange(autopilot, f"enter {mode}", MavCommand.DO_SET_MODE, FOLLOWING_MODES[mode], hint)
    )
    steps.append(
        Exchange(autopilot, "arm", MavCommand.ARM_DISARM, (1.0, 0.0), link_notice("hint.arm"))
    )
    if autopilot.kind == ARDUPILOT:
        steps.append(Wait(ARMING_DELAY_S))
    return Handshake(steps)


def _musts(autopilot: AutopilotAddress) -> list[HandshakeStep]:
    """Return the steps that every arming requires; raises LinkRejected, see :func:`make_arming`."""
    if autopilot.kind not in (PX4, ARDUPILOT):
        raise LinkRejected(
            link_notice("autopilot.unknown_kind", system=autopilot.system, kind=autopilot.kind_name)
        )
    if autopilot.vehicle not in MULTIROTORS:
        vehicle = autopilot.codec.value_name("MAV_TYPE", autopilot.vehicle)
        raise LinkRejected(
            link_notice("autopilot.no_multirotor", autopilot=autopilot.name, vehicle=vehicle)
        )
    if autopilot.kind == PX4:
        return []
    return [
        ParameterMust(
            autopilot,
            "GUID_OPTIONS",
            lambda v: bool(v & GuidedOption.THRUST_AS_THRUST),
            link_notice("hint.guid_options"),
        ),
        ParameterMust(
            autopilot, "ATC_ANGLE_BOOST", lambda v: v == 0, link_notice("hint.angle_boost")
        ),
    ]


def make_disarming(autopilot: AutopilotAddress) -> Handshake:
    """Make the hand-shake that stops the motors on the floor; it is repeated until the autopilot
    has detected the landing.
    """
    # ArduPilot that refuses goes on refusing: mode LAND is its way (:func:`make_landing_disarmed`).
    patience_s = 0.0 if autopilot.kind == ARDUPILOT else PATIENCE_S
    hint = link_notice("hint.disarm")
    return Handshake(
        [
            Exchange(
                autopilot, "disarm", MavCommand.ARM_DISARM, (0.0, 0.0), hint, patience_s=patience_s
            )
        ]
    )


def make_landing_disarmed(autopilot: AutopilotAddress) -> Handshake:
    """Make the hand-shake that stops ArduPilot's motors on the floor: mode LAND."""
    return Handshake([_enter_land(autopilot, "hint.land_disarmed"), Disarmed(DISARM_S)])


def make_landing(autopilot: AutopilotAddress) -> Handshake:
    """Make the hand-shake into the mode that lands by the autopilot's own estimate, in the air.

    Asked for while the bring-down is sent.

    Raises:
        LinkRejected: the autopilot is neither PX4 nor ArduPilot.
    """
    if autopilot.kind not in _LAND_MODE:
        raise LinkRejected(link_notice("autopilot.no_landing", kind=autopilot.kind_name))
    return Handshake([_enter_land(autopilot, "hint.land")])


def _enter_land(autopilot: AutopilotAddress, hint: str) -> Exchange:
    """Return the request for mode LAND; a refusal ends with the sentence ``hint``."""
    mode = _LAND_MODE[autopilot.kind]
    return Exchange(autopilot, "enter LAND", MavCommand.DO_SET_MODE, mode, link_notice(hint))


def stream(autopilot: AutopilotAddress, name: str, rate_hz: float) -> Handshake:
    """Have the message ``name`` sent ``rate_hz`` times a second."""
    params = (float(autopilot.codec.message_number(name)), 1e6 / rate_hz)
    return Handshake(
        [
            Exchange(
                autopilot,
                f"send {name} at {rate_hz:g} Hz",
                MavCommand.SET_MESSAGE_INTERVAL,
                params,
                link_notice("hint.stream"),
                patience_s=0.0,
            )
        ]
    )


def silence(autopilot: AutopilotAddress, name: str) -> Handshake:
    """Have the message ``name`` sent no more.

    One that the autopilot does not have is silent already.
    """
    params = (float(autopilot.codec.message_number(name)), -1.0)
    return Handshake(
        [
            Exchange(
                autopilot,
                f"stop sending {name}",
                MavCommand.SET_MESSAGE_INTERVAL,
                params,
                hint="",
                any_answer=True,
            )
        ]
    )


QUIETENED = (
    "ATTITUDE", "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "ODOMETRY",
    "ATTITUDE_TARGET", "HIGHRES_IMU", "RAW_IMU", "SERVO_OUTPUT_RAW", "RC_CHANNELS", "VFR_HUD",
    "ALTITUDE",
    "POSITION_TARGET_LOCAL_NED", "POSITION_TARGET_GLOBAL_INT",
)  # fmt: skip
"""Messages that autopilots send by default at 10 Hz or more and that nobody here reads unasked."""


async def choose_streams(
    autopilot: AutopilotAddress,
    wanted: Mapping[str, float],
    wishes: Mapping[tuple[str, ...], float],
    run_handshake: Callable[[Handshake], Awaitable[None]],
    *,
    quiet: bool,
) -> None:
    """Have ``wanted`` messages sent (name → rate [Hz]); with ``quiet`` no others that come often.

    Asked for, too, but not needed: what its estimator knows of itself, and of each of ``wishes``
    (names → rate [Hz]) the first message that it is willing to send, unless one of them is wanted
    anyhow.

    Raises:
        LinkRejected: the autopilot refuses to send one of them.
        LinkLost: it does not answer.
    """
    wishes = {
        names: rate for names, rate in wishes.items() if not any(name in wanted for name in names)
    }
    spoken = {*wanted, *(names[0] for names in wishes)}
    spare = [[silence(autopilot, name)] for name in QUIETENED if quiet and name not in spoken]
    if autopilot.kind in ESTIMATE and ESTIMATE[autopilot.kind] not in wanted:
        spare.append([stream(autopilot, ESTIMATE[autopilot.kind], ESTIMATE_HZ)])
    spare += [[stream(autopilot, name, rate) for name in names] for names, rate in wishes.items()]
    with suppress(LinkLost):  # it takes no such commands; a link with idle talk on it works too
        for steps in spare:
            for step in steps:
                try:
                    await run_handshake(step)
                    break
                except LinkLost:
                    raise
                except LinkError:
                    continue
    for name, rate in wanted.items():
        await run_handshake(stream(autopilot, name, rate))
