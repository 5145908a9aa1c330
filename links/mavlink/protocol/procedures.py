"""Procedures: what an autopilot must go through with us: arming, disarming, choosing what it sends. Sans-IO.

The caller streams set-points while they last. What shapes them, measured on PX4 1.16-alpha and ArduCopter 4.8-dev:

- PX4 arms in OFFBOARD only after set-points have come for about a second. Before, it still accepts the mode
  while disarmed, and then denies to arm; so the acceptance of the mode proves nothing, and streaming comes first.
- HEARTBEAT tells mode and armed state only once a second: what counts is COMMAND_ACK.
- PX4 denies to disarm for 1-3 s after touchdown, until it believes that it stands.
- ArduCopter takes thrust as a climb rate unless GUID_OPTIONS has bit 3 set, and raises the thrust of a leaning
  vehicle, as our controller has done already, unless ATC_ANGLE_BOOST is 0.
- ArduCopter refuses to disarm in GUIDED after a touchdown at zero thrust; mode LAND disarms by itself.

Parameters are read by name, set one by one, and insisted on. PARAM_VALUE has one 32-bit float for every kind of number.
PX4 puts the bytes of a whole number into it, ArduPilot the number itself: taken for the other, 8 reads as 1.1e-44.
Source: mavlink.io/en/services/parameter.html (encodings "bytewise" and "C cast").
"""

import math
import struct
from collections.abc import Awaitable, Callable, Iterable, Mapping
from contextlib import suppress
from typing import NamedTuple

from links.core import LinkError, LinkLost, LinkRejected
from links.mavlink.protocol.codec import ARDUPILOT, ARM_DISARM, DO_SET_MODE, PX4, SET_MESSAGE_INTERVAL, Message
from links.mavlink.protocol.status import ESTIMATE, ESTIMATE_HZ
from links.mavlink.protocol.steps import (
    ANSWER_S,
    PATIENCE_S,
    AutopilotAddress,
    Disarmed,
    Exchange,
    Handshake,
    HandshakeStep,
    Repeated,
    Wait,
)

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


STREAM_S = 1.2
"""Set-points stream for this long before anything is asked [s]; PX4 wants a second of them."""
LAND_S = 10.0
"""How long mode LAND may take to disarm a vehicle that stands on the ground [s]."""

GUIDED_MODES = {"GUIDED": (1.0, 4.0), "GUIDED_NOGPS": (1.0, 20.0)}
"""ArduPilot's modes that follow set-points: parameters of DO_SET_MODE."""
MULTIROTORS = {2: "quadrotor", 3: "coaxial", 13: "hexarotor", 14: "octorotor", 15: "tricopter", 29: "dodecarotor"}
"""HEARTBEAT.type of vehicles that thrust and body rates fly."""

_OFFBOARD = (1.0, 6.0)
_LAND_MODE = {PX4: (1.0, 4.0, 6.0), ARDUPILOT: (1.0, 9.0)}
_THRUST_AS_THRUST = 8


def fitness(autopilot: AutopilotAddress) -> Handshake:
    """What it is asked before it is armed, and can be asked without arming.

    Raises:
        LinkRejected: the autopilot is neither PX4 nor ArduPilot, or the vehicle no multirotor.
    """
    return Handshake(_musts(autopilot))


def arming(autopilot: AutopilotAddress, guided: str = "GUIDED") -> Handshake:
    """Into the mode that follows our set-points, then motors on; the caller streams set-points throughout.

    ``guided`` is which of ``GUIDED_MODES`` that is on ArduPilot.

    Raises:
        LinkRejected: the autopilot is neither PX4 nor ArduPilot, or the vehicle no multirotor.
    """
    steps: list[HandshakeStep] = [Wait(STREAM_S), *_musts(autopilot)]
    mode, params = ("OFFBOARD", _OFFBOARD) if autopilot.kind == PX4 else (guided, GUIDED_MODES[guided])
    hint = f"Switch to {mode} by hand to see what it lacks: it needs an attitude and our stream of set-points."
    steps.append(Exchange(autopilot, f"enter {mode}", DO_SET_MODE, params, hint))
    hint = "Clear what it names (its pre-arm checks tell more), then arm again."
    steps.append(Exchange(autopilot, "arm", ARM_DISARM, (1.0, 0.0), hint))
    return Handshake(steps)


def _musts(autopilot: AutopilotAddress) -> list[HandshakeStep]:
    """What we insist on; raises LinkRejected, see :func:`arming`."""
    if autopilot.kind not in (PX4, ARDUPILOT):
        raise LinkRejected(
            f"system {autopilot.system} is no PX4 and no ArduPilot (MAV_AUTOPILOT {autopilot.kind}): "
            "nobody tried how it takes body rates, so it is not armed"
        )
    if autopilot.vehicle not in MULTIROTORS:
        raise LinkRejected(
            f"{autopilot.name} says that its vehicle is no multirotor (MAV_TYPE {autopilot.vehicle}): it may take our "
            "thrust for something else, so it is not armed. Set its frame or airframe to the multirotor that it is"
        )
    if autopilot.kind == PX4:
        return []
    hint = (
        "it would take our thrust as a climb rate. Set GUID_OPTIONS to 8 (bit 3, thrust as "
        "thrust; `groundstation doctor` does), then arm again."
    )
    thrust = ParameterMust(autopilot, "GUID_OPTIONS", lambda v: bool(v & _THRUST_AS_THRUST), hint)
    hint = (
        "it would raise our thrust whenever the vehicle leans, on top of the controller, which does so already. "
        "Set ATC_ANGLE_BOOST to 0 (`groundstation doctor` does), then arm again."
    )
    return [thrust, ParameterMust(autopilot, "ATC_ANGLE_BOOST", lambda v: v == 0, hint)]


def disarming(autopilot: AutopilotAddress) -> Handshake:
    """Motors off, with patience until the autopilot believes that it stands."""
    hint = "It must stand on the ground at zero thrust; the remote control's kill switch always works."
    # ArduPilot that refuses goes on refusing: mode LAND is its way (see landing_disarmed).
    patience_s = 0.0 if autopilot.kind == ARDUPILOT else PATIENCE_S
    return Handshake([Exchange(autopilot, "disarm", ARM_DISARM, (0.0, 0.0), hint, patience_s=patience_s)])


def landing_disarmed(autopilot: AutopilotAddress) -> Handshake:
    """ArduPilot's own way from standing on the ground to motors off: mode LAND."""
    hint = "Stop the motors with the remote control."
    return Handshake([Exchange(autopilot, "enter LAND", DO_SET_MODE, _LAND_MODE[ARDUPILOT], hint), Disarmed(LAND_S)])


def landing(autopilot: AutopilotAddress) -> Handshake:
    """Into the mode that lands by the autopilot's own estimate, in the air; asked for while the bring-down is sent.

    Raises:
        LinkRejected: the autopilot is neither PX4 nor ArduPilot.
    """
    if autopilot.kind not in _LAND_MODE:
        raise LinkRejected(f"nobody knows how autopilot {autopilot.kind} is told to land")
    hint = "The bring-down by rates went on instead."
    return Handshake([Exchange(autopilot, "enter LAND", DO_SET_MODE, _LAND_MODE[autopilot.kind], hint)])


def stream(autopilot: AutopilotAddress, name: str, rate_hz: float) -> Handshake:
    """Have the message ``name`` sent ``rate_hz`` times a second."""
    params = (float(autopilot.codec.message_number(name)), 1e6 / rate_hz)
    hint = "This autopilot may not have the message; do without what it is for (pose.kind, operator.hold)."
    what = f"send {name} at {rate_hz:g} Hz"
    return Handshake([Exchange(autopilot, what, SET_MESSAGE_INTERVAL, params, hint, patience_s=0.0)])


def silence(autopilot: AutopilotAddress, name: str) -> Handshake:
    """Have the message ``name`` sent no more; one that the autopilot does not have is silent already."""
    params = (float(autopilot.codec.message_number(name)), -1.0)
    return Handshake(
        [Exchange(autopilot, f"stop sending {name}", SET_MESSAGE_INTERVAL, params, hint="", any_answer=True)]
    )


QUIETENED = (
    "ATTITUDE", "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "ODOMETRY",
    "ATTITUDE_TARGET", "HIGHRES_IMU", "RAW_IMU", "SERVO_OUTPUT_RAW", "RC_CHANNELS", "VFR_HUD", "ALTITUDE",
    "POSITION_TARGET_LOCAL_NED", "POSITION_TARGET_GLOBAL_INT",
)  # fmt: skip
"""What autopilots send by default, ten times a second or more, and what nobody here reads unless asked for."""


async def choose_streams(
    autopilot: AutopilotAddress,
    wanted: Mapping[str, float],
    wishes: Mapping[tuple[str, ...], float],
    see_through: Callable[[Handshake], Awaitable[None]],
    *,
    quiet: bool,
) -> None:
    """Have the messages in ``wanted`` sent (name → rate [Hz]), and with ``quiet`` no others that come often.

    Asked for, too, but not needed: what its estimator knows of itself, and of each of ``wishes`` (names → rate [Hz])
    the first message that it is willing to send, unless one of them is wanted anyhow.

    Raises:
        LinkRejected: the autopilot refuses to send one of them.
        LinkLost: it does not answer.
    """
    wishes = {names: rate for names, rate in wishes.items() if not any(name in wanted for name in names)}
    spoken = {*wanted, *(names[0] for names in wishes)}
    spare = [[silence(autopilot, name)] for name in QUIETENED if quiet and name not in spoken]
    if autopilot.kind in ESTIMATE and ESTIMATE[autopilot.kind] not in wanted:
        spare.append([stream(autopilot, ESTIMATE[autopilot.kind], ESTIMATE_HZ)])
    spare += [[stream(autopilot, name, rate) for name in names] for names, rate in wishes.items()]
    with suppress(LinkLost):  # it takes no such commands; a link with idle talk on it works too
        for steps in spare:
            for step in steps:
                try:
                    await see_through(step)
                    break
                except LinkLost:
                    raise
                except LinkError:
                    continue
    for name, rate in wanted.items():
        await see_through(stream(autopilot, name, rate))
