"""Parameters of the simulated autopilots: their tables, and the messages that read and change them.
Sans-IO.

The first group of each table changes what the simulated autopilot does. All others are only read
and set, by `groundstation doctor` and by checks before arming; groundstation/lab/doctor_advice.py
says what each means, and what it should be.
"""

import math
from collections.abc import Mapping

from links.mavlink.protocol import (
    INTEGER_BITS,
    PX4,
    MavParamType,
    Message,
    decode_parameter,
    encode_parameter,
)

PX4_PARAMETERS: Mapping[str, tuple[float, int]] = {
    # What the simulated one does.
    "COM_OF_LOSS_T": (0.4, MavParamType.REAL32),
    "MPC_THR_HOVER": (0.5, MavParamType.REAL32),
    # Flight from outside, without a remote control: it lands where set-points stop.
    "COM_OBL_RC_ACT": (4.0, MavParamType.INT32),
    "COM_RCL_EXCEPT": (4.0, MavParamType.INT32),
    "COM_RC_IN_MODE": (4.0, MavParamType.INT32),
    "COM_RC_OVERRIDE": (1.0, MavParamType.INT32),
    "COM_DISARM_PRFLT": (10.0, MavParamType.REAL32),
    "MAV_FWDEXTSP": (1.0, MavParamType.INT32),
    "MAV_SYS_ID": (1.0, MavParamType.INT32),
    "MAV_TYPE": (2.0, MavParamType.INT32),
    "THR_MDL_FAC": (0.0, MavParamType.REAL32),
    # Its own estimator, as delivered but for EKF2_EV_CTRL.
    "EKF2_EV_CTRL": (15.0, MavParamType.INT32),
    "EKF2_EVA_NOISE": (0.1, MavParamType.REAL32),
    "EKF2_EVP_NOISE": (0.1, MavParamType.REAL32),
    "EKF2_EV_DELAY": (0.0, MavParamType.REAL32),
    "EKF2_GPS_CTRL": (7.0, MavParamType.INT32),
    "EKF2_HGT_REF": (1.0, MavParamType.INT32),
    "EKF2_MAG_TYPE": (0.0, MavParamType.INT32),
    "SYS_HAS_GPS": (1.0, MavParamType.INT32),
}
"""PX4: name → value, MAV_PARAM_TYPE."""

ARDUPILOT_PARAMETERS: Mapping[str, tuple[float, int]] = {
    # What the simulated one does.
    "EK3_SRC1_POSXY": (3.0, MavParamType.INT8),
    "GUID_TIMEOUT": (3.0, MavParamType.REAL32),
    "MOT_SPOOL_TIME": (0.5, MavParamType.REAL32),
    "MOT_THST_HOVER": (0.5, MavParamType.REAL32),
    # Flight from outside, without a remote control: thrust means thrust.
    "ATC_ACCEL_P_MAX": (0.0, MavParamType.REAL32),
    "ATC_ACCEL_R_MAX": (0.0, MavParamType.REAL32),
    "ATC_ANGLE_BOOST": (0.0, MavParamType.INT8),
    "DISARM_DELAY": (10.0, MavParamType.INT8),
    "FRAME_CLASS": (1.0, MavParamType.INT8),
    "FS_GCS_ENABLE": (5.0, MavParamType.INT8),
    "FS_GCS_TIMEOUT": (2.0, MavParamType.REAL32),
    "FS_THR_ENABLE": (0.0, MavParamType.INT8),
    "GUID_OPTIONS": (8.0, MavParamType.INT32),
    "LAND_REPOSITION": (0.0, MavParamType.INT8),
    "MOT_SPIN_ARM": (0.1, MavParamType.REAL32),
    "MOT_SPIN_MIN": (0.15, MavParamType.REAL32),
    "MOT_THST_EXPO": (0.65, MavParamType.REAL32),
    "PILOT_Y_RATE": (0.0, MavParamType.REAL32),
    "RC_OPTIONS": (32.0, MavParamType.INT32),
    "SYSID_MYGCS": (245.0, MavParamType.INT16),
    "SYSID_THISMAV": (1.0, MavParamType.INT16),
    # Its own estimator: GPS, barometer and compass, no external pose.
    "COMPASS_ENABLE": (1.0, MavParamType.INT8),
    "EK3_SRC1_POSZ": (1.0, MavParamType.INT8),
    "EK3_SRC1_VELXY": (3.0, MavParamType.INT8),
    "EK3_SRC1_VELZ": (3.0, MavParamType.INT8),
    "EK3_SRC1_YAW": (1.0, MavParamType.INT8),
    "GPS1_TYPE": (1.0, MavParamType.INT8),
    "VISO_DELAY_MS": (10.0, MavParamType.INT16),
    "VISO_POS_M_NSE": (0.2, MavParamType.REAL32),
    "VISO_TYPE": (0.0, MavParamType.INT8),
    "VISO_VEL_M_NSE": (0.1, MavParamType.REAL32),
}
"""ArduPilot Copter: name → value, MAV_PARAM_TYPE."""


class Parameters:
    """Parameter table of one autopilot, and the messages that read and change it."""

    def __init__(
        self, autopilot: int, table: Mapping[str, tuple[float, int]], changes: Mapping[str, float]
    ) -> None:
        """Begin with ``table`` and ``changes``, for an ``autopilot`` (HEARTBEAT.autopilot).

        Raises:
            KeyError: a changed parameter is not in the table.
            ValueError: the parameter can't have the changed value.
        """
        self._autopilot = autopilot
        self._table = dict(table)
        for name, value in changes.items():
            kind = self._table[name][1]
            encode_parameter(autopilot, value, kind)
            self._table[name] = (value, kind)

    def __getitem__(self, name: str) -> float:
        return self._table[name][0]

    def read(self, request: Message, dialect: Message) -> list[Message]:
        """Return the answers to a PARAM_REQUEST_READ: none to an unknown parameter."""
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
        """Return the answers to a PARAM_REQUEST_LIST."""
        return [self._make_value_message(name, dialect) for name in self._table]

    def set(self, request: Message, dialect: Message) -> list[Message]:
        """Take a PARAM_SET; return the answer with the value from now on, changed or not."""
        name = request.param_id
        if name not in self._table:
            return []
        kind = self._table[name][1]
        value = decode_parameter(self._autopilot, request.param_value, kind)
        if math.isfinite(value) and (self._autopilot != PX4 or request.param_type == kind):
            self._table[name] = (_fitting(value, kind), kind)
        return [self._make_value_message(name, dialect)]

    def _make_value_message(self, name: str, dialect: Message) -> Message:
        value, kind = self._table[name]
        number = encode_parameter(self._autopilot, value, kind)
        index = list(self._table).index(name)
        return dialect.MAVLink_param_value_message(
            name.encode("ascii"), number, kind, len(self._table), index
        )


def _fitting(value: float, kind: int) -> float:
    """Return ``value`` as a parameter of ``kind`` (MAV_PARAM_TYPE) holds it: whole, in its
    range.
    """
    if kind not in INTEGER_BITS:
        return value
    bits, signed = INTEGER_BITS[kind]
    low = -(1 << bits - 1) if signed else 0
    return float(min(max(int(value), low), low + (1 << bits) - 1))
