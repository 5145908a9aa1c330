"""ODOMETRY of our poses for the estimators of PX4 and ArduPilot. Sans-IO."""

import math
from typing import NamedTuple

from links.mavlink.protocol.codec import ARDUPILOT, EstimatorKind, MavFrame, MavlinkCodec

BEST_QUALITY = 100
"""ODOMETRY.quality of a pose without known faults [%]."""
ORIGIN_DEG = (47.397742, 8.545594)
"""Latitude and longitude of a room for ArduPilot [deg]: those of PX4's simulators. ArduPilot needs
an origin before it believes its position; nothing else uses it."""
ORIGIN_M = 488.0
"""Its height above the sea [m]: that of PX4's simulators."""

_UNKNOWN = (math.nan,) * 3
"""Velocity or body rates that are not known."""


class Odometry(NamedTuple):
    """State of the vehicle for the autopilot's own estimator."""

    time_s: float
    """Instant of the state, on the clock that answers TIMESYNC [s]."""
    position: tuple[float, float, float]
    """[m], world NED, or the same turned about its down axis."""
    attitude: tuple[float, float, float, float]
    """Unit quaternion w, x, y, z, body FRD to that frame."""
    velocity: tuple[float, float, float]
    """[m/s], body FRD."""
    measured_velocity: bool
    """Whether the velocity is measured; else it is a difference of positions, which the autopilot
    knows already."""
    resets: int
    """Changes whenever the frame moved; only the lowest byte leaves."""
    noise_m: float
    """1σ of the position per axis [m]."""
    noise_rad: float
    """1σ of the attitude per axis [rad]."""
    noise_m_s: float
    """1σ of the velocity per axis [m/s]."""


def encode_odometry(codec: MavlinkCodec, kind: int, state: Odometry) -> bytes:
    """Encode an ODOMETRY for the own estimator of an autopilot of ``kind`` (HEARTBEAT.autopilot).

    PX4 fuses frames NED, ENU, LOCAL_FRD and LOCAL_FLU, but turns no quaternion of the last; and
    only estimator types UNKNOWN, VISION and VIO: MOCAP goes where its EKF2 does not look, NAIVE
    loses the covariance. In LOCAL_FRD its yaw counts as not aligned, and it does not arm ("heading
    estimate not stable"): so it gets LOCAL_NED. It leaves out a velocity that is NaN, and turns
    stamps into its own clock by TIMESYNC, which it asks of us. ArduPilot takes LOCAL_FRD with
    BODY_FRD only, ignores the type, and always uses the velocity: NaN in it would reach the filter.
    It finds its own clock from the arrivals. Body rates are NaN: neither needs them, and some
    versions of ArduPilot take finite ones for a message of another kind. Source: PX4 v1.15
    mavlink_receiver.cpp, handle_message_odometry; ArduPilot 4.6-dev GCS_Common.cpp,
    handle_odometry; mavlink common.xml (pymavlink 2.4.50).
    """
    velocity = state.velocity if kind == ARDUPILOT or state.measured_velocity else _UNKNOWN
    message = codec.dialect.MAVLink_odometry_message(
        max(round(state.time_s * 1e6), 0),
        MavFrame.LOCAL_FRD if kind == ARDUPILOT else MavFrame.LOCAL_NED,
        MavFrame.BODY_FRD,
        *state.position,
        state.attitude,
        *velocity,
        *_UNKNOWN,
        _covariance(state.noise_m, state.noise_rad),
        _covariance(state.noise_m_s, math.nan),
        state.resets & 0xFF,
        EstimatorKind.VISION,
        BEST_QUALITY,
    )
    return codec.pack(message)


def encode_origin(codec: MavlinkCodec) -> bytes:
    """Encode a SET_GPS_GLOBAL_ORIGIN to every autopilot: the place on earth of ODOMETRY's origin.

    An autopilot that has one keeps it.

    Source: ArduPilot 4.7-dev GCS_Common.cpp, set_ekf_origin; its EKF3 refuses GUIDED and home
        without.
    """
    latitude, longitude = (round(1e7 * angle) for angle in ORIGIN_DEG)
    height_mm = round(1e3 * ORIGIN_M)
    message = codec.dialect.MAVLink_set_gps_global_origin_message(
        0, latitude, longitude, height_mm, 0
    )
    return codec.pack(message)


def _covariance(first: float, second: float) -> list[float]:
    """Return the upper triangle of a 6 x 6 matrix, row by row, with ``first``² three times and then
    ``second``² on its diagonal.
    """
    sigmas = (first,) * 3 + (second,) * 3
    return [
        sigmas[row] * sigmas[row] if row == column else 0.0
        for row in range(6)
        for column in range(row, 6)
    ]
