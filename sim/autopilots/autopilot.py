"""Simulated autopilot: what every one does towards a ground station; the dialects say the rest.

Sans-IO.

Here: telemetry, COMMAND_LONG and its answers, parameters, TIMESYNC, arming and disarming as such,
and its own control loop. By itself it flies an attitude, a climb and a level descent, by plain P
and PI loops. In a dialect (dialects.py): modes, what it refuses, what it makes of a set-point, and
what it does when they stop.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, Protocol

from groundstation.core.geometry import Quat, Vec3, so3
from groundstation.core.messages import ROUNDING_S
from groundstation.core.vehicle import GRAVITY
from links.mavlink.protocol import (
    ARMED,
    FORCE,
    PX4,
    WHOLE_BITS,
    AttitudeTargetMask,
    EstimatorFlag,
    EstimatorKind,
    MavCommand,
    MavFrame,
    MavlinkCodec,
    MavParamType,
    MavResult,
    MavSeverity,
    Message,
    decode,
    encode,
)
from sim.world import Airframe, TrueState


class SetPoint:
    """One SET_ATTITUDE_TARGET; what its mask takes out is None."""

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
        """No number in it is infinite or none at all."""
        return all(
            map(math.isfinite, filter(None, (self.thrust, *self.rates, *(self.attitude or ()))))
        )


def rates_or_zero(set_point: SetPoint) -> Vec3:
    """The body rates of ``set_point`` [rad/s], those that are masked out being zero."""
    p, q, r = set_point.rates
    return p or 0.0, q or 0.0, r or 0.0


class Dialect(ABC):
    """PX4's or ArduPilot's. All times are on the event loop's clock [s]."""

    kind: ClassVar[int]
    """Its HEARTBEAT.autopilot."""
    table: ClassVar[Mapping[str, tuple[float, int]]]
    """Its parameters: name → value, MAV_PARAM_TYPE."""
    hover_parameter: ClassVar[str]
    """Its parameter for the thrust that it believes to hover with."""
    land_mode: ClassVar[tuple[int, int]]
    """Main and sub mode that comes down by itself."""
    rates_hz: ClassVar[Mapping[str, float]]
    """Default rate of each message [Hz]; 0: sent on request only."""
    tells_prearm_enabled: ClassVar[bool] = True
    """Whether SYS_STATUS says that there are pre-arm checks, beside whether they pass."""

    lacks: str
    """Failure of the autopilot's own pre-arm checks, in its words; it reports it and refuses to
    arm."""

    @property
    @abstractmethod
    def custom_mode(self) -> int:
        """HEARTBEAT.custom_mode of the mode that it is in."""

    @property
    @abstractmethod
    def _silence_due_s(self) -> float:
        """When it acts if no further set-point comes; infinite where it does not wait for any."""

    @abstractmethod
    def _fall_silent(self, now_s: float) -> list[bytes]:
        """Act because set-points stopped; returns frames to send."""

    @abstractmethod
    def _obey(self, set_point: SetPoint, now_s: float) -> list[bytes]:
        """Take a finite set-point; returns frames to send."""

    @abstractmethod
    def _set_mode(self, mode: tuple[int, int], now_s: float) -> tuple[int, list[bytes]]:
        """Answer the main and sub mode of a MavCommand.DO_SET_MODE, and frames to send first."""

    @abstractmethod
    def _answer_arming(self, now_s: float) -> tuple[int, str]:
        """The result and the words that deny arming; ACCEPTED where nothing does."""

    def _passes_checks(self, now_s: float) -> bool:
        """Whether its own pre-arm checks pass in the mode that it is in."""
        return not self.lacks

    @abstractmethod
    def _answer_disarming(self, now_s: float) -> tuple[int, str]:
        """The result and the words that deny disarming; ACCEPTED where nothing does."""

    @abstractmethod
    def _set_interval(
        self, number: int, interval_us: float, now_s: float
    ) -> tuple[int, list[bytes]]:
        """Answer a MavCommand.SET_MESSAGE_INTERVAL."""

    @property
    @abstractmethod
    def _disarms_by_landing(self) -> bool:
        """Whether it is in a mode that ends with the motors off on the ground."""


PX4_PARAMETERS: Mapping[str, tuple[float, int]] = {
    "COM_OF_LOSS_T": (0.4, MavParamType.REAL32),
    "COM_OBL_RC_ACT": (4.0, MavParamType.INT32),
    "COM_RCL_EXCEPT": (4.0, MavParamType.INT32),
    "COM_RC_IN_MODE": (4.0, MavParamType.INT32),
    "COM_RC_OVERRIDE": (1.0, MavParamType.INT32),
    "COM_DISARM_PRFLT": (10.0, MavParamType.REAL32),
    "EKF2_EV_CTRL": (15.0, MavParamType.INT32),
    "EKF2_EVA_NOISE": (0.1, MavParamType.REAL32),
    "EKF2_EVP_NOISE": (0.1, MavParamType.REAL32),
    "EKF2_EV_DELAY": (0.0, MavParamType.REAL32),
    "EKF2_GPS_CTRL": (7.0, MavParamType.INT32),
    "EKF2_HGT_REF": (1.0, MavParamType.INT32),
    "EKF2_MAG_TYPE": (0.0, MavParamType.INT32),
    "MAV_FWDEXTSP": (1.0, MavParamType.INT32),
    "MAV_SYS_ID": (1.0, MavParamType.INT32),
    "MAV_TYPE": (2.0, MavParamType.INT32),
    "MPC_THR_HOVER": (0.5, MavParamType.REAL32),
    "SYS_HAS_GPS": (1.0, MavParamType.INT32),
    "THR_MDL_FAC": (0.0, MavParamType.REAL32),
}
"""Name → value, MAV_PARAM_TYPE. A vehicle that is set up to be flown from outside, without a remote
control."""

ARDUPILOT_PARAMETERS: Mapping[str, tuple[float, int]] = {
    "ATC_ACCEL_P_MAX": (0.0, MavParamType.REAL32),
    "ATC_ACCEL_R_MAX": (0.0, MavParamType.REAL32),
    "ATC_ANGLE_BOOST": (0.0, MavParamType.INT8),
    "COMPASS_ENABLE": (1.0, MavParamType.INT8),
    "DISARM_DELAY": (10.0, MavParamType.INT8),
    "EK3_SRC1_POSXY": (3.0, MavParamType.INT8),
    "EK3_SRC1_POSZ": (1.0, MavParamType.INT8),
    "EK3_SRC1_VELXY": (3.0, MavParamType.INT8),
    "EK3_SRC1_VELZ": (3.0, MavParamType.INT8),
    "EK3_SRC1_YAW": (1.0, MavParamType.INT8),
    "FRAME_CLASS": (1.0, MavParamType.INT8),
    "FS_GCS_ENABLE": (5.0, MavParamType.INT8),
    "FS_GCS_TIMEOUT": (2.0, MavParamType.REAL32),
    "FS_THR_ENABLE": (0.0, MavParamType.INT8),
    "GPS1_TYPE": (1.0, MavParamType.INT8),
    "GUID_OPTIONS": (8.0, MavParamType.INT32),
    "GUID_TIMEOUT": (3.0, MavParamType.REAL32),
    "LAND_REPOSITION": (0.0, MavParamType.INT8),
    "MOT_SPIN_ARM": (0.1, MavParamType.REAL32),
    "MOT_SPIN_MIN": (0.15, MavParamType.REAL32),
    "MOT_SPOOL_TIME": (0.5, MavParamType.REAL32),
    "MOT_THST_EXPO": (0.65, MavParamType.REAL32),
    "MOT_THST_HOVER": (0.5, MavParamType.REAL32),
    "PILOT_Y_RATE": (0.0, MavParamType.REAL32),
    "RC_OPTIONS": (32.0, MavParamType.INT32),
    "SYSID_MYGCS": (245.0, MavParamType.INT16),
    "SYSID_THISMAV": (1.0, MavParamType.INT16),
    "VISO_DELAY_MS": (10.0, MavParamType.INT16),
    "VISO_POS_M_NSE": (0.2, MavParamType.REAL32),
    "VISO_TYPE": (0.0, MavParamType.INT8),
    "VISO_VEL_M_NSE": (0.1, MavParamType.REAL32),
}
"""Parameters of ArduPilot Copter; MOT_THST_EXPO straightens what the motors do, so thrust is what
we ask for."""


class Parameters:
    """Parameter table of one autopilot, and the rules by which it may be changed."""

    def __init__(
        self, autopilot: int, table: Mapping[str, tuple[float, int]], changes: Mapping[str, float]
    ) -> None:
        """``table`` with ``changes``, for an ``autopilot`` (HEARTBEAT.autopilot).

        Raises:
            KeyError: a change is to a parameter that it does not have.
            ValueError: a change is to a value that the parameter can't have.
        """
        self._autopilot = autopilot
        self._table = dict(table)
        for name, value in changes.items():
            kind = self._table[name][1]
            encode(autopilot, value, kind)
            self._table[name] = (value, kind)

    def __getitem__(self, name: str) -> float:
        return self._table[name][0]

    def read(self, request: Message, dialect: Message) -> list[Message]:
        """The answers to a PARAM_REQUEST_READ: silence where it does not have the parameter."""
        names = list(self._table)
        if request.param_index >= 0:
            return [
                self._make_value_message(name, dialect)
                for name in names[request.param_index : request.param_index + 1]
            ]
        return (
            [self._make_value_message(request.param_id, dialect)]
            if request.param_id in self._table
            else []
        )

    def all(self, dialect: Message) -> list[Message]:
        """The answers to a PARAM_REQUEST_LIST."""
        return [self._make_value_message(name, dialect) for name in self._table]

    def set(self, request: Message, dialect: Message) -> list[Message]:
        """Take a PARAM_SET; the answer tells what the parameter is now, changed or not."""
        name = request.param_id
        if name not in self._table:
            return []
        kind = self._table[name][1]
        value = decode(self._autopilot, request.param_value, kind)
        if math.isfinite(value) and (self._autopilot != PX4 or request.param_type == kind):
            self._table[name] = (_fitting(value, kind), kind)
        return [self._make_value_message(name, dialect)]

    def _make_value_message(self, name: str, dialect: Message) -> Message:
        value, kind = self._table[name]
        number = encode(self._autopilot, value, kind)
        index = list(self._table).index(name)
        return dialect.MAVLink_param_value_message(
            name.encode("ascii"), number, kind, len(self._table), index
        )


def _fitting(value: float, kind: int) -> float:
    """``value`` as a parameter of ``kind`` can hold it: whole, and in its range."""
    if kind not in WHOLE_BITS:
        return value
    bits, signed = WHOLE_BITS[kind]
    low = -(1 << bits - 1) if signed else 0
    return float(min(max(int(value), low), low + (1 << bits) - 1))


ATTITUDE_GAIN = 5.0
"""Body rate per attitude error [1/s]."""
DESCENT_M_S = 0.5
"""Speed of the descent [m/s]."""
SPEED_GAIN = 4.0
"""Acceleration per error of the climb rate [1/s]: PX4's MPC_Z_VEL_P_ACC."""
SPEED_INTEGRAL_GAIN = 2.0
"""Acceleration per integral of that error [1/s²]: PX4's MPC_Z_VEL_I_ACC."""
INTEGRAL_LIMIT = 5.0
"""Largest acceleration by the integral [m/s²]."""
BRAKING_GAIN = 1.8
"""Acceleration per horizontal speed [1/s]: PX4's MPC_XY_VEL_P_ACC."""
BRAKING_LEAN = math.radians(15.0)
"""Largest tilt of that braking [rad]."""


class OnboardPilot(Protocol):
    """A control loop on board."""

    def fly(self, truth: TrueState) -> tuple[float, Vec3]:
        """Thrust 0..1 and body rates [rad/s] for the state ``truth``."""


class HoldAttitude:
    """Turn to an attitude and stay there, at a given thrust."""

    def __init__(self, attitude: Quat, thrust: float) -> None:
        """``attitude`` is body FRD to world NED; ``thrust`` 0..1."""
        self._attitude = so3.normalize(attitude)
        self._thrust = thrust

    def fly(self, truth: TrueState) -> tuple[float, Vec3]:
        """Rates along the shortest turn."""
        x, y, z = so3.rotation_vector(so3.multiply(so3.conjugate(truth.attitude), self._attitude))
        return self._thrust, (ATTITUDE_GAIN * x, ATTITUDE_GAIN * y, ATTITUDE_GAIN * z)


class Climb:
    """Level out, and keep a vertical speed."""

    def __init__(self, hover: float, climb_m_s: float, begin_s: float) -> None:
        """``hover`` is the thrust 0..1 that about holds the vehicle (PX4: MPC_THR_HOVER)."""
        self._hover = hover
        self._climb = climb_m_s
        self._time_s = begin_s
        self._integral = 0.0

    def fly(self, truth: TrueState) -> tuple[float, Vec3]:
        """Thrust towards the vertical speed, and the rates to level."""
        elapsed, self._time_s = truth.time_s - self._time_s, truth.time_s
        if truth.on_ground:
            return 0.0, (0.0, 0.0, 0.0)
        too_fast = truth.velocity_ned[2] + self._climb
        integral = self._integral + SPEED_INTEGRAL_GAIN * too_fast * elapsed
        self._integral = min(max(integral, -INTEGRAL_LIMIT), INTEGRAL_LIMIT)
        upward = SPEED_GAIN * too_fast + self._integral
        down = so3.to_body(truth.attitude, (0.0, 0.0, 1.0))
        thrust = self._hover * (1.0 + upward / GRAVITY) / max(down[2], 0.5)
        level = (-ATTITUDE_GAIN * down[1], ATTITUDE_GAIN * down[0], 0.0)
        return min(max(thrust, 0.0), 1.0), level


class Descend(Climb):
    """Level out, come down slowly, stop the rotors on the ground."""

    def __init__(self, hover: float, begin_s: float, *, brakes: bool = False) -> None:
        """``hover``: see the base; one that ``brakes`` knows its speed, and leans against it."""
        super().__init__(hover, -DESCENT_M_S, begin_s)
        self._brakes = brakes

    def fly(self, truth: TrueState) -> tuple[float, Vec3]:
        """Thrust towards the vertical speed, and the rates."""
        thrust, rates = super().fly(truth)
        if not self._brakes or truth.on_ground:
            return thrust, rates
        north, east, _ = truth.velocity_ned
        most = math.tan(BRAKING_LEAN)
        push = math.hypot(north, east) * BRAKING_GAIN / GRAVITY
        share = BRAKING_GAIN / GRAVITY * (1.0 if push <= most else most / push)
        # Where the body's z axis shall point: its thrust, along -z, against the speed.
        x, y, z = so3.to_body(truth.attitude, (share * north, share * east, 1.0))
        # Position controllers ask for the thrust that the wanted attitude needs, not for more while
        # it leans farther.
        thrust *= max(so3.third_column(truth.attitude)[2], 0.5)
        n = 1.0 / math.sqrt(x * x + y * y + z * z)
        return thrust, (-ATTITUDE_GAIN * y * n, ATTITUDE_GAIN * x * n, 0.0)


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
"""Nothing is sent more often [s]."""

_UNKNOWN = (math.nan,) * 21
"""Covariance that is not sent."""


class Streams:
    """When each message is due; intervals change by MavCommand.SET_MESSAGE_INTERVAL."""

    def __init__(self, rates_hz: Mapping[int, float], start_s: float) -> None:
        """Messages by number with their default rates [Hz] (0: off), the first of each at
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
        """The messages that are due at ``now_s``; each is then due again one interval later."""
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
    """For each message number that tells of the vehicle's motion: (now, time since boot) [s] →
    message.
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
    """The ``number``-th STATUSTEXT.

    A ``text`` that does not fit comes in pieces, the last of them not full.
    """
    message = codec.dialect.MAVLink_statustext_message
    size = max(message.array_lengths)
    pieces = [text[i : i + size] for i in range(0, len(text) + 1, size)] if text else []
    return [
        message(severity, piece.encode("ascii"), number & 0xFFFF, n)
        for n, piece in enumerate(pieces)
    ]


LANDED_S = 1.0
"""Time on the ground after which it counts as landed [s]; it looks with each HEARTBEAT."""
CONTROL_S = 0.01
"""Period of its own control loop [s]."""

FIRMWARE, COMMIT = 0x01_10_00_FF, b"simulate"
"""The version that it says it runs, 1.16.0, and the first bytes of its commit."""


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
        """Disarmed, booting at the first poll.

        ``lose`` tells of each set-point whether it got lost on the air; ``hover`` is the thrust
        (0..1) that it believes to hover with (a parameter too); ``parameters`` differ from its
        ``table``; with ``own_estimate`` it says that it knows its position and speed, and brakes
        when it lands.

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
        """True while it says that it acts because set-points stopped."""
        self.battery_share: float | None = None
        """Charge of its battery [0..1], told by SYS_STATUS; None where it can't measure it."""
        self.lacks = ""
        self.has_estimate = True
        """False while its estimator knows no position yet, as for some 40 s after a boot: it tells
        none."""
        self.uid = 0
        """Id of its hardware in AUTOPILOT_VERSION; 0: it tells none."""
        self._knows = own_estimate
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
        """When ``poll`` has something to do, if nothing is received before."""
        due = min(self._streams.next_due_s, self._pilot_due_s, self._silence_due_s)
        return due if self._boot_s > -math.inf else -math.inf

    def poll(self, now_s: float) -> list[bytes]:
        """Do what is due by ``now_s``; returns frames to send."""
        if self._boot_s == -math.inf:
            self._boot(now_s)
        frames: list[bytes] = []
        by_now = now_s + ROUNDING_S
        if by_now >= self._silence_due_s:
            frames += self._fall_silent(now_s)
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
        """Take one datagram; returns frames to send back."""
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
                    self._obey(set_point, now_s) if not self._lose() and set_point.is_finite else []
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

    # ---- what it says

    def _own_builders(self) -> dict[int, Callable[[float, float], Message]]:
        """For each message number that tells of the autopilot itself: (now, time since boot) [s] →
        message.
        """
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
        told = d.MAV_SYS_STATUS_PREARM_CHECK if self.tells_prearm_enabled else 0
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
    """The whole part of a parameter; -1 where it is no number, or infinite."""
    return int(number) if math.isfinite(number) else -1
