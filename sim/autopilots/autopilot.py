"""Simulated autopilot: behaviour towards a ground station that PX4 and ArduPilot have in common.
Sans-IO.

Here: telemetry, COMMAND_LONG and its answers, TIMESYNC, arming and disarming as such. In
parameters.py: parameters. In onboard_pilots.py: its own control loops. In a dialect (dialects.py):
modes, refusals, the effect of a set-point, and what follows when set-points stop.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar

from groundstation.core.geometry import Quat, Vec3
from groundstation.core.messages import ROUNDING_S
from links.mavlink.protocol import (
    ARMED,
    FORCE,
    AttitudeTargetMask,
    EstimatorFlag,
    EstimatorKind,
    MavCommand,
    MavFrame,
    MavlinkCodec,
    MavResult,
    MavSeverity,
    Message,
)
from sim.autopilots.onboard_pilots import OnboardPilot
from sim.autopilots.parameters import Parameters
from sim.world import Airframe


class SetPoint:
    """One SET_ATTITUDE_TARGET; masked parts are None."""

    def __init__(self, message: Message) -> None:
        mask = AttitudeTargetMask(message.type_mask)
        self.thrust: float | None = (
            None if AttitudeTargetMask.IGNORE_THRUST in mask else message.thrust
        )
        self.rates: tuple[float | None, float | None, float | None] = (
            None if AttitudeTargetMask.IGNORE_ROLL_RATE in mask else message.body_roll_rate,
            None if AttitudeTargetMask.IGNORE_PITCH_RATE in mask else message.body_pitch_rate,
            None if AttitudeTargetMask.IGNORE_YAW_RATE in mask else message.body_yaw_rate,
        )
        self.attitude: Quat | None = (
            None if AttitudeTargetMask.IGNORE_ATTITUDE in mask else tuple(message.q)
        )

    @property
    def is_finite(self) -> bool:
        """Whether all its numbers are finite."""
        return all(
            map(math.isfinite, filter(None, (self.thrust, *self.rates, *(self.attitude or ()))))
        )


def rates_or_zero(set_point: SetPoint) -> Vec3:
    """Return the body rates of ``set_point`` [rad/s, FRD], with zeros for masked ones."""
    p, q, r = set_point.rates
    return p or 0.0, q or 0.0, r or 0.0


class Dialect(ABC):
    """Behaviour of PX4 or of ArduPilot. All times are on the event loop's clock [s]."""

    kind: ClassVar[int]
    """Its HEARTBEAT.autopilot."""
    table: ClassVar[Mapping[str, tuple[float, int]]]
    """Its parameters: name → value, MAV_PARAM_TYPE."""
    hover_parameter: ClassVar[str]
    """Its parameter for the hover thrust (0..1)."""
    land_mode: ClassVar[tuple[int, int]]
    """Main and sub mode that lands by itself."""
    rates_hz: ClassVar[Mapping[str, float]]
    """Default rate of each message [Hz]; 0: sent on request only."""
    reports_prearm_enabled: ClassVar[bool] = True
    """Whether SYS_STATUS says that there are pre-arm checks, beside whether they pass."""

    lacks: str
    """Failure of the autopilot's own pre-arm checks, in its words; it reports it and refuses to
    arm."""

    @property
    @abstractmethod
    def custom_mode(self) -> int:
        """HEARTBEAT.custom_mode of its present mode."""

    @property
    @abstractmethod
    def _silence_due_s(self) -> float:
        """Instant at which set-points count as stopped; infinite where it does not wait for any."""

    @abstractmethod
    def _on_silence(self, now_s: float) -> list[bytes]:
        """Act because set-points stopped; return frames to send."""

    @abstractmethod
    def _follow(self, set_point: SetPoint, now_s: float) -> list[bytes]:
        """Follow a finite set-point; return frames to send."""

    @abstractmethod
    def _set_mode(self, mode: tuple[int, int], now_s: float) -> tuple[int, list[bytes]]:
        """Take main and sub mode of a DO_SET_MODE; return its MAV_RESULT, and frames to send
        first.
        """

    @abstractmethod
    def _answer_arming(self, now_s: float) -> tuple[int, str]:
        """Return MAV_RESULT and text of an arming; the text tells why it is denied."""

    def _passes_checks(self, now_s: float) -> bool:
        """Return whether its own pre-arm checks pass in its present mode."""
        return not self.lacks

    @abstractmethod
    def _answer_disarming(self, now_s: float) -> tuple[int, str]:
        """Return MAV_RESULT and text of a disarming; the text tells why it is denied."""

    @abstractmethod
    def _set_interval(
        self, number: int, interval_us: float, now_s: float
    ) -> tuple[int, list[bytes]]:
        """Take a SET_MESSAGE_INTERVAL; return its MAV_RESULT, and frames to send first."""

    @property
    @abstractmethod
    def _disarms_by_landing(self) -> bool:
        """Whether it is in a mode that ends with the motors off on the ground."""


_MOVES = (
    EstimatorFlag.ATTITUDE | EstimatorFlag.VELOCITY_HORIZONTAL | EstimatorFlag.VELOCITY_VERTICAL
)
KNOWN = (
    _MOVES
    | EstimatorFlag.POSITION_RELATIVE
    | EstimatorFlag.POSITION_ABSOLUTE
    | EstimatorFlag.HEIGHT_ABSOLUTE
    | EstimatorFlag.PREDICTED_RELATIVE
    | EstimatorFlag.PREDICTED_ABSOLUTE
)
"""Flags of ESTIMATOR_STATUS and EKF_STATUS_REPORT of a real autopilot with GPS."""
STILL = _MOVES | EstimatorFlag.HEIGHT_ABSOLUTE | EstimatorFlag.CONSTANT_POSITION
"""ESTIMATOR_STATUS flags of a real autopilot without GPS: its position counts as constant."""
SHORTEST_S = 0.001
"""Shortest interval of a message [s]."""

_UNKNOWN = (math.nan,) * 21
"""Covariance that is not sent."""


class Streams:
    """Schedule of the messages; SET_MESSAGE_INTERVAL changes their intervals."""

    def __init__(self, rates_hz: Mapping[int, float], start_s: float) -> None:
        """Begin with default rates [Hz] by message number (0: off), the first of each at
        ``start_s`` [s].
        """
        self._defaults = {
            number: 1.0 / rate if rate else math.inf for number, rate in rates_hz.items()
        }
        self._intervals = dict(self._defaults)
        self._due = {
            number: start_s for number, interval in self._intervals.items() if interval < math.inf
        }
        self.next_due_s = start_s if self._due else math.inf
        """When the next message is due [s]."""

    def set(self, number: int, interval_us: float, now_s: float) -> bool:
        """Send message ``number`` every ``interval_us`` from ``now_s`` on; -1 stops it, 0 is its
        default.

        Returns False where there is no such message.
        """
        if number not in self._defaults or not math.isfinite(interval_us):
            return False
        if interval_us == 0.0:
            interval = self._defaults[number]
        else:
            interval = max(interval_us * 1e-6, SHORTEST_S) if interval_us > 0.0 else math.inf
        self._intervals[number] = interval
        self._due.pop(number, None)
        if interval < math.inf:
            self._due[number] = now_s
        self.next_due_s = min(self._due.values(), default=math.inf)
        return True

    def take(self, now_s: float) -> list[int]:
        """Return the messages that are due at ``now_s``; each is due again one interval later."""
        limit = now_s + ROUNDING_S
        if self.next_due_s > limit:
            return []
        numbers = [number for number, due in self._due.items() if due <= limit]
        for number in numbers:
            due = self._due[number] + self._intervals[number]
            self._due[number] = due if due > limit else now_s + self._intervals[number]
        self.next_due_s = min(self._due.values())
        return numbers


def builders(
    codec: MavlinkCodec, airframe: Airframe, own_estimate: bool
) -> dict[int, Callable[[float, float], Message]]:
    """Return builders of the messages on the vehicle's motion: (now, time since boot) [s] →
    message, by message number.
    """
    d = codec.dialect
    flags = KNOWN if own_estimate else STILL

    def odometry(now_s: float, boot_s: float) -> Message:
        seen = airframe.measure(now_s)
        return d.MAVLink_odometry_message(
            int(boot_s * 1e6), MavFrame.LOCAL_NED, MavFrame.LOCAL_NED, *seen.position_ned,
            seen.attitude, *seen.velocity_ned, *seen.rates_rad_s, _UNKNOWN, _UNKNOWN,
            seen.resets, EstimatorKind.AUTOPILOT, 0,
        )  # fmt: skip

    def local_position(now_s: float, boot_s: float) -> Message:
        seen = airframe.measure(now_s)
        return d.MAVLink_local_position_ned_message(
            int(boot_s * 1e3), *seen.position_ned, *seen.velocity_ned
        )

    def attitude(now_s: float, boot_s: float) -> Message:
        turned, rates = airframe.estimate_attitude(now_s)
        return d.MAVLink_attitude_quaternion_message(int(boot_s * 1e3), *turned, *rates)

    def timesync(now_s: float, boot_s: float) -> Message:
        return d.MAVLink_timesync_message(0, int(boot_s * 1e9))

    def px4_estimator(now_s: float, boot_s: float) -> Message:
        ratios = (0.1, 0.1, 0.1, 0.1, 0.0, 0.0)
        return d.MAVLink_estimator_status_message(int(boot_s * 1e6), flags, *ratios, 0.1, 0.1)

    def ardupilot_estimator(now_s: float, boot_s: float) -> Message:
        return d.MAVLink_ekf_status_report_message(flags, 0.1, 0.1, 0.1, 0.1, 0.0)

    return {
        d.MAVLINK_MSG_ID_ESTIMATOR_STATUS: px4_estimator,
        d.MAVLINK_MSG_ID_EKF_STATUS_REPORT: ardupilot_estimator,
        d.MAVLINK_MSG_ID_ODOMETRY: odometry,
        d.MAVLINK_MSG_ID_LOCAL_POSITION_NED: local_position,
        d.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: attitude,
        d.MAVLINK_MSG_ID_TIMESYNC: timesync,
    }


def statustext(codec: MavlinkCodec, number: int, severity: int, text: str) -> list[Message]:
    """Return the ``number``-th STATUSTEXT: a long ``text`` in pieces, the last of them not full."""
    message = codec.dialect.MAVLink_statustext_message
    size = max(message.array_lengths)
    pieces = [text[i : i + size] for i in range(0, len(text) + 1, size)] if text else []
    return [
        message(severity, piece.encode("ascii"), number & 0xFFFF, n)
        for n, piece in enumerate(pieces)
    ]


LANDED_S = 1.0
"""Time on the ground after which it counts as landed [s]; it is checked with each HEARTBEAT: 1 to
2 s in all, as PX4's."""
CONTROL_S = 0.01
"""Period of its own control loop [s]. Chosen: short against the lags of the vehicle."""

FIRMWARE, COMMIT = 0x01_10_00_FF, b"simulate"
"""Reported version, 1.16.0, and the first bytes of its commit."""


class SimulatedAutopilot(Dialect):
    """The autopilot of one ``airframe``.

    All times are on the event loop's clock [s] and never go backwards.
    """

    channels: Sequence[int] = ()
    """Pulses of the transmitter, one a channel [µs]; empty without one, as at boot."""
    answers_timesync = True
    """False where a router on the way keeps the answers."""

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
        """Begin disarmed; it boots at the first poll.

        Args:
            airframe: vehicle that it flies.
            lose: called for each set-point; returns whether it got lost on the air.
            hover: its hover thrust, 0..1, which is a parameter, too.
            system_id: its MAVLink system.
            parameters: values that differ from its ``table``, by name.
            own_estimate: whether it knows its position and speed: it reports so, and brakes when it
                lands.

        Raises:
            KeyError: it has no such parameter.
            ValueError: the parameter can't have that value.
        """
        self.codec = MavlinkCodec(system_id, 1)
        self.parameters = Parameters(
            self.kind, self.table, {self.hover_parameter: hover} | dict(parameters or {})
        )
        self.armed = False
        self.failsafe = False
        """Whether it reports that it acts because set-points stopped."""
        self.battery_share: float | None = None
        """Charge of its battery, 0..1, in SYS_STATUS; None where it can't measure it."""
        self.lacks = ""
        self.has_estimate = True
        """Whether its estimator knows a position; for some 40 s after a boot it sends none."""
        self.uid = 0
        """Id of its hardware in AUTOPILOT_VERSION; 0: none."""
        self._has_own_estimate = own_estimate
        self._airframe = airframe
        self._lose = lose
        self._streams = Streams({}, 0.0)
        self._build = builders(self.codec, airframe, own_estimate) | self._own_builders()
        self._boot_s = -math.inf
        self._ground_since_s: float | None = None
        self._pilot: OnboardPilot | None = None
        self._pilot_due_s = math.inf
        self._said = 0

    # ---- time and datagrams

    @property
    def next_due_s(self) -> float:
        """Instant at which ``poll`` has something to do, if nothing is received before."""
        due = min(self._streams.next_due_s, self._pilot_due_s, self._silence_due_s)
        return due if self._boot_s > -math.inf else -math.inf

    def poll(self, now_s: float) -> list[bytes]:
        """Do what is due by ``now_s``; return frames to send."""
        if self._boot_s == -math.inf:
            self._boot(now_s)
        frames: list[bytes] = []
        by_now = now_s + ROUNDING_S
        if by_now >= self._silence_due_s:
            frames += self._on_silence(now_s)
        if self._pilot is not None and by_now >= self._pilot_due_s:
            frames += self._control(self._pilot, now_s)
        d = self.codec.dialect
        withheld = (
            ()
            if self.has_estimate
            else (d.MAVLINK_MSG_ID_ODOMETRY, d.MAVLINK_MSG_ID_LOCAL_POSITION_NED)
        )
        for number in self._streams.take(now_s):
            if number in withheld:
                continue
            frames.append(self.codec.pack(self._build[number](now_s, now_s - self._boot_s)))
            if number == d.MAVLINK_MSG_ID_HEARTBEAT:
                self._has_landed(now_s)
        return frames

    def reboot(self, now_s: float) -> None:
        """Boot again, as after a brown-out: the motors stop. Its mode and parameters stay."""
        self._disarm(now_s, "")
        self._boot_s = -math.inf

    def receive(self, datagram: bytes, now_s: float) -> list[bytes]:
        """Take one datagram; return frames to send back."""
        frames: list[bytes] = []
        for message in self.codec.feed(datagram, "station"):
            frames += self._take(message, now_s)
        return frames

    def _take(self, message: Message, now_s: float) -> list[bytes]:
        name, dialect = message.get_type(), self.codec.dialect
        if name == "TIMESYNC":
            asked = message.tc1 == 0 and self.answers_timesync
            return [self.codec.timesync_reply(message, now_s - self._boot_s)] if asked else []
        if not self._is_for_us(message):
            return []
        match name:
            case "SET_ATTITUDE_TARGET":
                set_point = SetPoint(message)
                return (
                    self._follow(set_point, now_s)
                    if not self._lose() and set_point.is_finite
                    else []
                )
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
        system = getattr(message, "target_system", -1)
        component = getattr(message, "target_component", -1)
        return system in (0, self.codec.system_id) and component in (0, 1)

    # ---- flying

    @property
    def _hover(self) -> float:
        return self.parameters[self.hover_parameter]

    def _fly_by(self, pilot: OnboardPilot | None, now_s: float) -> None:
        self._pilot = pilot
        self._pilot_due_s = now_s if pilot is not None else math.inf

    def _control(self, pilot: OnboardPilot, now_s: float) -> list[bytes]:
        """Make one step of its own control loop; return frames to send."""
        self._pilot_due_s = now_s + CONTROL_S
        self._airframe.act(now_s, *pilot.fly(self._airframe.truth(now_s)))
        if self._disarms_by_landing and self._has_landed(now_s):
            return self._disarm(now_s, "Disarmed by landing")
        return []

    def _has_landed(self, now_s: float) -> bool:
        """Return whether it has stood on the ground for ``LANDED_S``.

        It is asked once a second, more often while it lands by itself.
        """
        if not self._airframe.truth(now_s).on_ground:
            self._ground_since_s = None
            return False
        if self._ground_since_s is None:
            self._ground_since_s = now_s
        return now_s - self._ground_since_s >= LANDED_S

    # ---- commands

    def _command(self, message: Message, now_s: float) -> list[bytes]:
        said: list[bytes] = []
        d = self.codec.dialect
        match message.command:
            case c if c == MavCommand.DO_SET_MODE:
                result, said = self._set_mode((whole(message.param2), whole(message.param3)), now_s)
            case c if c == MavCommand.NAV_LAND:
                result, said = self._set_mode(self.land_mode, now_s)
            case c if c == MavCommand.ARM_DISARM:
                result, said = (
                    self._arm(now_s)
                    if message.param1 == 1.0
                    else self._try_to_disarm(message, now_s)
                )
            case c if c == MavCommand.SET_MESSAGE_INTERVAL:
                result, said = self._set_interval(whole(message.param1), message.param2, now_s)
            case c if (
                c == MavCommand.REQUEST_MESSAGE
                and whole(message.param1) == d.MAVLINK_MSG_ID_AUTOPILOT_VERSION
            ):
                result, said = MavResult.ACCEPTED, [self.codec.pack(self._version())]
            case c if (
                c == MavCommand.REQUEST_MESSAGE
                and whole(message.param1) == d.MAVLINK_MSG_ID_HEARTBEAT
            ):
                result, said = MavResult.ACCEPTED, [self.codec.pack(self._heartbeat())]
            case _:
                result = MavResult.UNSUPPORTED
        ack = d.MAVLink_command_ack_message(
            message.command, result, 0, 0, message.get_srcSystem(), message.get_srcComponent()
        )
        return [*said, self.codec.pack(ack)]

    def _arm(self, now_s: float) -> tuple[int, list[bytes]]:
        if self.armed:
            return MavResult.ACCEPTED, []
        result, words = (
            (MavResult.TEMPORARILY_REJECTED, self.lacks)
            if self.lacks
            else self._answer_arming(now_s)
        )
        if result != MavResult.ACCEPTED:
            return result, self._say(MavSeverity.CRITICAL, words)
        self.armed = True
        self._ground_since_s = None
        self._airframe.power(now_s, True)
        return MavResult.ACCEPTED, self._say(MavSeverity.INFO, "Armed by external command")

    def _try_to_disarm(self, message: Message, now_s: float) -> tuple[int, list[bytes]]:
        if not self.armed:
            return MavResult.ACCEPTED, []
        result, words = self._answer_disarming(now_s)
        if message.param2 != FORCE and result != MavResult.ACCEPTED:
            return result, self._say(MavSeverity.CRITICAL, words) if words else []
        return MavResult.ACCEPTED, self._disarm(now_s, "Disarmed by external command")

    def _disarm(self, now_s: float, words: str) -> list[bytes]:
        self.armed = False
        self.failsafe = False
        self._fly_by(None, now_s)
        self._airframe.power(now_s, False)
        return self._say(MavSeverity.INFO, words)

    # ---- messages

    def _own_builders(self) -> dict[int, Callable[[float, float], Message]]:
        """Return builders of the messages on the autopilot itself, as :func:`builders` does."""
        d = self.codec.dialect
        return {
            d.MAVLINK_MSG_ID_HEARTBEAT: lambda now_s, boot_s: self._heartbeat(),
            d.MAVLINK_MSG_ID_SYS_STATUS: lambda now_s, boot_s: self._sys_status(now_s),
            d.MAVLINK_MSG_ID_RC_CHANNELS: lambda now_s, boot_s: self._rc_channels(boot_s),
        }

    def _boot(self, now_s: float) -> None:
        self._boot_s = now_s
        rates_hz = {**self.rates_hz, **({"RC_CHANNELS": 0.0} if self.channels else {})}
        self._streams = Streams(
            {self.codec.message_number(n): rate for n, rate in rates_hz.items()}, now_s
        )

    def _heartbeat(self) -> Message:
        d = self.codec.dialect
        base = d.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (ARMED if self.armed else 0)
        status = (
            d.MAV_STATE_CRITICAL
            if self.failsafe
            else d.MAV_STATE_ACTIVE
            if self.armed
            else d.MAV_STATE_STANDBY
        )
        return d.MAVLink_heartbeat_message(
            d.MAV_TYPE_QUADROTOR, self.kind, base, self.custom_mode, status, 3
        )

    def _version(self) -> Message:
        d, none = self.codec.dialect, bytes(8)
        commits = list(COMMIT), list(none), list(none)
        return d.MAVLink_autopilot_version_message(0, FIRMWARE, 0, 0, 0, *commits, 0, 0, self.uid)

    def _sys_status(self, now_s: float) -> Message:
        d, share = self.codec.dialect, self.battery_share
        told = d.MAV_SYS_STATUS_PREARM_CHECK if self.reports_prearm_enabled else 0
        health = d.MAV_SYS_STATUS_PREARM_CHECK if self.armed or self._passes_checks(now_s) else 0
        percent = -1 if share is None else round(100.0 * share)
        return d.MAVLink_sys_status_message(
            told, told, health, 0, 0xFFFF, -1, percent, 0, 0, 0, 0, 0, 0
        )

    def _rc_channels(self, boot_s: float) -> Message:
        pulses = (*self.channels, *[0xFFFF] * 18)[:18]
        return self.codec.dialect.MAVLink_rc_channels_message(
            int(1e3 * boot_s), len(self.channels), *pulses, 255
        )

    def _say(self, severity: int, text: str) -> list[bytes]:
        self._said += 1
        return [
            self.codec.pack(piece) for piece in statustext(self.codec, self._said, severity, text)
        ]


def whole(number: float) -> int:
    """Return the whole part of a parameter; -1 where it is not finite."""
    return int(number) if math.isfinite(number) else -1
