"""Dialect of a simulated autopilot: what it says beside what all of them do, and its parameters. Sans-IO."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

from groundstation.core.geometry import Quat, Vec3
from links.mavlink.protocol import PX4, REAL32, WHOLE_BITS, Message, decode, encode

ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED = range(5)
"""MAV_RESULT."""
CRITICAL, WARNING, INFO = 2, 4, 6
"""MAV_SEVERITY."""

_IGNORE_THRUST, _IGNORE_ATTITUDE = 64, 128


class SetPoint:
    """One SET_ATTITUDE_TARGET; what its mask takes out is None."""

    def __init__(self, message: Message) -> None:
        """Of a ``message``."""
        mask = message.type_mask
        self.thrust: float | None = None if mask & _IGNORE_THRUST else message.thrust
        self.rates: tuple[float | None, float | None, float | None] = (
            None if mask & 1 else message.body_roll_rate,
            None if mask & 2 else message.body_pitch_rate,
            None if mask & 4 else message.body_yaw_rate,
        )
        self.attitude: Quat | None = None if mask & _IGNORE_ATTITUDE else tuple(message.q)

    @property
    def is_finite(self) -> bool:
        """No number in it is infinite or none at all."""
        return all(map(math.isfinite, filter(None, (self.thrust, *self.rates, *(self.attitude or ())))))


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
    """What it sends by default [Hz]; 0: what it could send."""
    tells_prearm_enabled: ClassVar[bool] = True
    """Whether SYS_STATUS says that there are pre-arm checks, beside whether they pass."""

    lacks: str
    """What its own pre-arm checks find missing, in its words: it tells that they fail, and does not arm."""

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
        """Answer the main and sub mode of a DO_SET_MODE, and frames to send first."""

    @abstractmethod
    def _refuses_to_arm(self, now_s: float) -> tuple[int, str]:
        """The result and the words that deny arming; ACCEPTED where nothing does."""

    def _passes_checks(self, now_s: float) -> bool:
        """Whether its own pre-arm checks pass in the mode that it is in."""
        return not self.lacks

    @abstractmethod
    def _refuses_to_disarm(self, now_s: float) -> tuple[int, str]:
        """The result and the words that deny disarming; ACCEPTED where nothing does."""

    @abstractmethod
    def _set_interval(self, number: int, interval_us: float, now_s: float) -> tuple[int, list[bytes]]:
        """Answer a SET_MESSAGE_INTERVAL."""

    @property
    @abstractmethod
    def _disarms_by_landing(self) -> bool:
        """Whether it is in a mode that ends with the motors off on the ground."""


INT8, INT16, INT32 = 2, 4, 6
"""MAV_PARAM_TYPE."""

PX4_PARAMETERS: Mapping[str, tuple[float, int]] = {
    "COM_OF_LOSS_T": (0.4, REAL32),
    "COM_OBL_RC_ACT": (4.0, INT32),
    "COM_RCL_EXCEPT": (4.0, INT32),
    "COM_RC_IN_MODE": (4.0, INT32),
    "COM_RC_OVERRIDE": (1.0, INT32),
    "COM_DISARM_PRFLT": (10.0, REAL32),
    "EKF2_EV_CTRL": (15.0, INT32),
    "EKF2_EV_DELAY": (0.0, REAL32),
    "EKF2_HGT_REF": (1.0, INT32),
    "MAV_FWDEXTSP": (1.0, INT32),
    "MAV_SYS_ID": (1.0, INT32),
    "MAV_TYPE": (2.0, INT32),
    "MPC_THR_HOVER": (0.5, REAL32),
    "THR_MDL_FAC": (0.0, REAL32),
}
"""Name → value, MAV_PARAM_TYPE. A vehicle that is set up to be flown from outside, without a remote control."""

ARDUPILOT_PARAMETERS: Mapping[str, tuple[float, int]] = {
    "ATC_ANGLE_BOOST": (0.0, INT8),
    "DISARM_DELAY": (10.0, INT8),
    "EK3_SRC1_POSXY": (3.0, INT8),
    "EK3_SRC1_POSZ": (1.0, INT8),
    "EK3_SRC1_VELXY": (3.0, INT8),
    "EK3_SRC1_VELZ": (3.0, INT8),
    "EK3_SRC1_YAW": (1.0, INT8),
    "FRAME_CLASS": (1.0, INT8),
    "FS_GCS_ENABLE": (5.0, INT8),
    "FS_GCS_TIMEOUT": (2.0, REAL32),
    "FS_THR_ENABLE": (0.0, INT8),
    "GUID_OPTIONS": (8.0, INT32),
    "GUID_TIMEOUT": (3.0, REAL32),
    "MOT_SPIN_ARM": (0.1, REAL32),
    "MOT_SPIN_MIN": (0.15, REAL32),
    "MOT_THST_EXPO": (0.65, REAL32),
    "MOT_THST_HOVER": (0.5, REAL32),
    "RC_OPTIONS": (32.0, INT32),
    "SYSID_MYGCS": (245.0, INT16),
    "SYSID_THISMAV": (1.0, INT16),
    "VISO_TYPE": (0.0, INT8),
}
"""The same for ArduPilot Copter; MOT_THST_EXPO straightens what the motors do, so thrust is what we ask for."""


class Parameters:
    """What it has, and who may change it."""

    def __init__(self, autopilot: int, table: Mapping[str, tuple[float, int]], changes: Mapping[str, float]) -> None:
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
        """The value of the parameter ``name``."""
        return self._table[name][0]

    def read(self, request: Message, dialect: Message) -> list[Message]:
        """The answers to a PARAM_REQUEST_READ: silence where it does not have the parameter."""
        names = list(self._table)
        if request.param_index >= 0:
            return [
                self._make_value_message(name, dialect) for name in names[request.param_index : request.param_index + 1]
            ]
        return [self._make_value_message(request.param_id, dialect)] if request.param_id in self._table else []

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
        return dialect.MAVLink_param_value_message(name.encode("ascii"), number, kind, len(self._table), index)


def _fitting(value: float, kind: int) -> float:
    """``value`` as a parameter of ``kind`` can hold it: whole, and in its range."""
    if kind not in WHOLE_BITS:
        return value
    bits, signed = WHOLE_BITS[kind]
    low = -(1 << bits - 1) if signed else 0
    return float(min(max(int(value), low), low + (1 << bits) - 1))
