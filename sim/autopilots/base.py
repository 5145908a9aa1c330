"""Base of the simulated autopilots: what every one does towards a ground station; the dialects say the rest. Sans-IO.

Here: telemetry, COMMAND_LONG and its answers, parameters, TIMESYNC, arming and disarming as such, and its own
control loop; and what its estimator would fuse of ODOMETRY that it is sent, as in PX4 v1.15 (mavlink_receiver.cpp) and
ArduPilot 4.6-dev (GCS_Common.cpp). In a dialect (dialect.py; px4.py, ardupilot.py): modes, what it refuses, what it
makes of a set-point, and what it does when they stop.
"""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence

import msgspec

from groundstation.core.geometry import Quat, Vec3
from links.mavlink.protocol import (
    ARDUPILOT,
    ARM_DISARM,
    ARMED,
    DO_SET_MODE,
    FORCE,
    NAV_LAND,
    REQUEST_MESSAGE,
    SET_MESSAGE_INTERVAL,
    MavlinkCodec,
    Message,
)
from sim.autopilots.dialect import ACCEPTED, CRITICAL, INFO, TEMPORARILY_REJECTED, UNSUPPORTED, Dialect, SetPoint
from sim.autopilots.parameters import Parameters
from sim.autopilots.pilot import Pilot
from sim.autopilots.streams import SAME_INSTANT_S, Streams, builders, statustext
from sim.world import Airframe

NED, BODY_FRD, LOCAL_FRD = 1, 12, 20
UNKNOWN, VISION, VIO = 0, 2, 3


class Fused(msgspec.Struct, frozen=True):
    """One pose that the estimator has taken."""

    arrival_s: float
    stamp_s: float
    """By the sender's clock [s]."""
    position: Vec3
    attitude: Quat
    velocity_body: Vec3 | None
    variance: tuple[float, float]
    """Of position [m²] and attitude [rad²], the first axis of each."""
    resets: int


class ExternalPoses:
    """Those of one autopilot."""

    def __init__(self, kind: int) -> None:
        """Of the autopilot ``kind`` (HEARTBEAT.autopilot)."""
        self._kind = kind
        self.fused: list[Fused] = []
        self.left: Counter[str] = Counter()
        """By reason: frame, estimator, not_finite."""

    def take(self, m: Message, now_s: float) -> None:
        """One message."""
        velocity: Vec3 | None = (m.vx, m.vy, m.vz)
        if self._kind == ARDUPILOT:
            if (m.frame_id, m.child_frame_id) != (LOCAL_FRD, BODY_FRD):
                self.left["frame"] += 1
                return
        elif m.estimator_type not in (UNKNOWN, VISION, VIO):
            self.left["estimator"] += 1
            return
        elif m.frame_id not in (NED, LOCAL_FRD):
            self.left["frame"] += 1
            return
        elif not all(map(math.isfinite, (m.vx, m.vy, m.vz))):
            velocity = None
        if not all(map(math.isfinite, (m.x, m.y, m.z, *m.q, *(velocity or ())))):
            self.left["not_finite"] += 1  # ArduPilot would not notice
            return
        variance = m.pose_covariance[0], m.pose_covariance[15]
        pose = (m.x, m.y, m.z), tuple(m.q)
        self.fused.append(Fused(now_s, m.time_usec * 1e-6, *pose, velocity, variance, m.reset_counter))


LANDED_S = 1.0
"""How long it must stand on the ground to believe it [s]; it looks once a second."""
CONTROL_S = 0.01
"""Period of its own control loop [s]."""

FIRMWARE, COMMIT = 0x01_10_00_FF, b"simulate"
"""The version that it says it runs, 1.16.0, and the first bytes of its commit."""

_CUSTOM_MODE_ENABLED = 1
_PREARM_CHECK = 0x10000000  # MAV_SYS_STATUS_PREARM_CHECK
_QUADROTOR = 2
_STANDBY, _ACTIVE, _CRITICAL = 3, 4, 5


class SimulatedAutopilot(Dialect):
    """The autopilot of one ``airframe``. All times are on the event loop's clock [s] and never go backwards."""

    channels: Sequence[int] = ()
    """What its receiver hears of a transmitter, one pulse a channel [µs]; none without one, as it boots."""

    def __init__(
        self,
        airframe: Airframe,
        *,
        lose: Callable[[], bool] = lambda: False,
        hover: float = 0.5,
        system_id: int = 1,
        parameters: Mapping[str, float] | None = None,
        own_estimate: bool = False,
    ) -> None:
        """Disarmed, booting at the first poll.

        ``lose`` tells of each set-point whether it got lost on the air; ``hover`` is the thrust (0..1) that it
        believes to hover with (a parameter too); ``parameters`` differ from its ``table``; with ``own_estimate`` it
        says that it knows its position and speed, and brakes when it lands.

        Raises:
            KeyError: it has no such parameter.
            ValueError: the parameter can't have that value.
        """
        self.codec = MavlinkCodec(system_id, 1)
        self.parameters = Parameters(self.kind, self.table, {self.hover_parameter: hover} | dict(parameters or {}))
        self.armed = False
        self.failsafe = False
        """True while it says that it acts because set-points stopped."""
        self.battery: tuple[float, float] | None = None
        """Its voltage [V] and charge [0..1], told by SYS_STATUS; None where it has no way to measure them."""
        self.lacks = ""
        self.has_estimate = True
        """False while its estimator knows no position yet, as for some 40 s after a boot: it tells none."""
        self.external = ExternalPoses(self.kind)
        """The poses that it is sent."""
        self._knows = own_estimate
        self._airframe = airframe
        self._lose = lose
        self._streams = Streams({}, 0.0)
        self._build = builders(self.codec, airframe, own_estimate)
        d = self.codec.dialect
        self._places = (d.MAVLINK_MSG_ID_ODOMETRY, d.MAVLINK_MSG_ID_LOCAL_POSITION_NED)
        self._version_number: int = d.MAVLINK_MSG_ID_AUTOPILOT_VERSION
        self._heartbeat_number: int = d.MAVLINK_MSG_ID_HEARTBEAT
        self._build[self._heartbeat_number] = lambda now_s, boot_s: self._heartbeat()
        self._build[self.codec.dialect.MAVLINK_MSG_ID_SYS_STATUS] = lambda now_s, boot_s: self._sys_status(now_s)
        self._build[self.codec.dialect.MAVLINK_MSG_ID_RC_CHANNELS] = lambda now_s, boot_s: self._rc_channels(boot_s)
        self._boot_s = -math.inf
        self._ground_since_s: float | None = None
        self._pilot: Pilot | None = None
        self._pilot_due_s = math.inf
        self._said = 0

    # ---- time and datagrams

    @property
    def next_due_s(self) -> float:
        """When ``poll`` has something to do, if nothing is received before."""
        due = min(self._streams.next_due_s, self._pilot_due_s, self._silence_due_s)
        return due if self._boot_s > -math.inf else -math.inf

    def poll(self, now_s: float) -> list[bytes]:
        """Do what is due by ``now_s``; returns frames to send."""
        if self._boot_s == -math.inf:
            self._boot(now_s)
        frames: list[bytes] = []
        by_now = now_s + SAME_INSTANT_S
        if by_now >= self._silence_due_s:
            frames += self._fall_silent(now_s)
        if self._pilot is not None and by_now >= self._pilot_due_s:
            frames += self._control(self._pilot, now_s)
        for number in self._streams.take(now_s):
            if number in self._places and not self.has_estimate:
                continue
            frames.append(self.codec.pack(self._build[number](now_s, now_s - self._boot_s)))
            if number == self._heartbeat_number:
                self._has_landed(now_s)
        return frames

    def reboot(self, now_s: float) -> None:
        """Begin anew, as after a brown-out: the motors stop, and nothing is remembered."""
        self._disarm(now_s, "")
        self._boot_s = -math.inf

    def receive(self, datagram: bytes, now_s: float) -> list[bytes]:
        """Take one datagram; returns frames to send back."""
        frames: list[bytes] = []
        for message in self.codec.feed_datagram(datagram):
            frames += self._take(message, now_s)
        return frames

    def _take(self, message: Message, now_s: float) -> list[bytes]:
        name, dialect = message.get_type(), self.codec.dialect
        if name == "TIMESYNC":
            asked = message.tc1 == 0
            return [self.codec.timesync_reply(message, now_s - self._boot_s)] if asked else []
        if name == "ODOMETRY":
            self.external.take(message, now_s)
        if not self._is_for_us(message):
            return []
        match name:
            case "SET_ATTITUDE_TARGET":
                set_point = SetPoint(message)
                return self._obey(set_point, now_s) if not self._lose() and set_point.is_finite else []
            case "COMMAND_LONG":
                return self._command(message, now_s)
            case "PARAM_REQUEST_READ":
                answers = self.parameters.read(message, dialect)
            case "PARAM_REQUEST_LIST":
                answers = self.parameters.all(dialect)
            case "PARAM_SET":
                answers = self.parameters.set(message, dialect)
            case _:
                answers = []
        return [self.codec.pack(answer) for answer in answers]

    def _is_for_us(self, message: Message) -> bool:
        system, component = getattr(message, "target_system", -1), getattr(message, "target_component", -1)
        return system in (0, self.codec.system_id) and component in (0, 1)

    # ---- flying

    @property
    def _hover(self) -> float:
        return self.parameters[self.hover_parameter]

    def _fly_by(self, pilot: Pilot | None, now_s: float) -> None:
        self._pilot = pilot
        self._pilot_due_s = now_s if pilot is not None else math.inf

    def _control(self, pilot: Pilot, now_s: float) -> list[bytes]:
        """One turn of its own control loop."""
        self._pilot_due_s = now_s + CONTROL_S
        self._airframe.act(now_s, *pilot.fly(self._airframe.truth(now_s)))
        if self._disarms_by_landing and self._has_landed(now_s):
            return self._disarm(now_s, "Disarmed by landing")
        return []

    def _has_landed(self, now_s: float) -> bool:
        """The land detector; it looks once a second, more often while landing by itself."""
        if not self._airframe.truth(now_s).on_ground:
            self._ground_since_s = None
            return False
        if self._ground_since_s is None:
            self._ground_since_s = now_s
        return now_s - self._ground_since_s >= LANDED_S

    # ---- commands

    def _command(self, message: Message, now_s: float) -> list[bytes]:
        said: list[bytes] = []
        match message.command:
            case c if c == DO_SET_MODE:
                result, said = self._set_mode((whole(message.param2), whole(message.param3)), now_s)
            case c if c == NAV_LAND:
                result, said = self._set_mode(self.land_mode, now_s)
            case c if c == ARM_DISARM:
                result, said = self._arm(now_s) if message.param1 == 1.0 else self._try_to_disarm(message, now_s)
            case c if c == SET_MESSAGE_INTERVAL:
                result, said = self._set_interval(whole(message.param1), message.param2, now_s)
            case c if c == REQUEST_MESSAGE and whole(message.param1) == self._version_number:
                result, said = ACCEPTED, [self.codec.pack(self._version())]
            case c if c == REQUEST_MESSAGE and whole(message.param1) == self._heartbeat_number:
                result, said = ACCEPTED, [self.codec.pack(self._heartbeat())]
            case _:
                result = UNSUPPORTED
        ack = self.codec.dialect.MAVLink_command_ack_message(
            message.command, result, 0, 0, message.get_srcSystem(), message.get_srcComponent()
        )
        return [*said, self.codec.pack(ack)]

    def _arm(self, now_s: float) -> tuple[int, list[bytes]]:
        if self.armed:
            return ACCEPTED, []
        result, words = (TEMPORARILY_REJECTED, self.lacks) if self.lacks else self._refuses_to_arm(now_s)
        if result != ACCEPTED:
            return result, self._say(CRITICAL, words)
        self.armed = True
        self._ground_since_s = None
        self._airframe.power(now_s, True)
        return ACCEPTED, self._say(INFO, "Armed by external command")

    def _try_to_disarm(self, message: Message, now_s: float) -> tuple[int, list[bytes]]:
        if not self.armed:
            return ACCEPTED, []
        result, words = self._refuses_to_disarm(now_s)
        if message.param2 != FORCE and result != ACCEPTED:
            return result, self._say(CRITICAL, words) if words else []
        return ACCEPTED, self._disarm(now_s, "Disarmed by external command")

    def _disarm(self, now_s: float, words: str) -> list[bytes]:
        self.armed = False
        self.failsafe = False
        self._fly_by(None, now_s)
        self._airframe.power(now_s, False)
        return self._say(INFO, words)

    # ---- what it says

    def _boot(self, now_s: float) -> None:
        self._boot_s = now_s
        rates_hz = {**self.rates_hz, **({"RC_CHANNELS": 0.0} if self.channels else {})}
        self._streams = Streams({self.codec.message_number(n): rate for n, rate in rates_hz.items()}, now_s)

    def _heartbeat(self) -> Message:
        base = _CUSTOM_MODE_ENABLED | (ARMED if self.armed else 0)
        status = _CRITICAL if self.failsafe else _ACTIVE if self.armed else _STANDBY
        return self.codec.dialect.MAVLink_heartbeat_message(_QUADROTOR, self.kind, base, self.custom_mode, status, 3)

    def _version(self) -> Message:
        d, none = self.codec.dialect, bytes(8)
        return d.MAVLink_autopilot_version_message(0, FIRMWARE, 0, 0, 0, list(COMMIT), list(none), list(none), 0, 0, 0)

    def _sys_status(self, now_s: float) -> Message:
        d, battery = self.codec.dialect, self.battery
        told = _PREARM_CHECK if self.tells_prearm_enabled else 0
        health = _PREARM_CHECK if self.armed or self._passes_checks(now_s) else 0
        millivolts, percent = (0xFFFF, -1) if battery is None else (round(1e3 * battery[0]), round(100.0 * battery[1]))
        return d.MAVLink_sys_status_message(told, told, health, 0, millivolts, -1, percent, 0, 0, 0, 0, 0, 0)

    def _rc_channels(self, boot_s: float) -> Message:
        pulses = (*self.channels, *[0xFFFF] * 18)[:18]
        return self.codec.dialect.MAVLink_rc_channels_message(int(1e3 * boot_s), len(self.channels), *pulses, 255)

    def _say(self, severity: int, text: str) -> list[bytes]:
        self._said += 1
        return [self.codec.pack(piece) for piece in statustext(self.codec, self._said, severity, text)]


def whole(number: float) -> int:
    """A parameter that stands for a whole number; -1 where it does not."""
    return int(number) if math.isfinite(number) else -1
