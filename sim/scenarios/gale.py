"""Gale: the fan array, the quadrotor of 2.6 kg and the course of O'Connell et al., and what they measured there.

Neural-Fly (Science Robotics 7, 2022, doi 10.1126/scirobotics.abm6597). The figures were derived from the published logs
of its flights, and none is fitted to the RMS errors; the logs themselves are not part of this project. z is up here,
and x points into the wind: the vehicle leans towards +x in it.
"""

import math
from typing import NamedTuple

from groundstation.core.geometry import Vec3
from groundstation.core.vehicle import GRAVITY

MASS_KG = 2.6
"""Mass of the vehicle [kg]."""
HOVER = 0.48
"""Signal that hovers, of the full one [-]."""
THRUST_CURVE = 0.55
"""f of thrust = f u² + (1 - f) u, by which specific force over g rises by 1.36 per hover signal, about hover (logs:
1.33 to 1.43); the flights were told 0."""
THRUST_DELAY_S = 0.06
"""Dead time of the thrust [s]."""
THRUST_LAG_S = 0.04
"""Time constant of the thrust [s]."""
ATTITUDE_RAD_S = 7.0
"""Natural frequency of the attitude loop [rad/s]: as body rates a lag of 1/7 s, and P 7."""
PITCH_PER_M_S = 0.02
"""Additional pitch per upward speed, in wind [rad s/m]."""
DRAG = 0.80
"""Drag within the rotors' plane [N s/m]."""
DRAG_INFLOW = 0.035
"""Rise of that drag with the speed of the air in the plane [N s²/m²]."""
SINK_DRAG = 0.85
"""Drag along the thrust [N s/m]."""
SINK_INFLOW = 0.19
"""Rise of that drag with inflow [N s²/m²]."""
LIFT = 0.035
"""Lift of that inflow [N s²/m²]."""
REST_N: Vec3 = (0.3, 0.15, 0.5)
"""Deviation of the random push, per axis [N]."""
REST_S = 0.6
"""Correlation time of the random push that differs from lap to lap (Ornstein-Uhlenbeck noise) [s]."""
BIAS_N: Vec3 = (1.2, -0.43, 0.0)
"""Constant push, NED [N]."""
FULL_N = MASS_KG * GRAVITY / (THRUST_CURVE * HOVER**2 + (1.0 - THRUST_CURVE) * HOVER)
"""Thrust of the full signal [N]."""
POSE_LATENCY_S = 0.010
"""Latency of a tracking room [s]: the logs do not tell it."""
ATTITUDE_NOISE_RAD = 0.001
"""Attitude noise of a tracking room with a large body, 1σ [rad]: the logs do not tell it."""
POSE_HZ = 50.0
"""Rate of the poses in the logs [Hz]."""
POSE_NOISE_M = 2e-5
"""Position noise of the poses, 1σ [m]."""
RISE_S = 12.55
"""The phase rate rises from 0 to 1 rad/s in this time."""


class GaleWind(NamedTuple):
    """One setting of the fans."""

    speed_m_s: float
    gust_m_s: float
    """The wind is speed + gust sin(t + 5)."""
    gain: float
    """Answer of the pitch to its set-point, as a multiple of the answer in still air [-]."""
    jitter_s: float
    """Jitter of the poses' stamps, 1σ [s]."""


GUST_PHASE = 5.0
"""Phase of the swinging wind [rad]."""
WINDS = {
    "gale_0": GaleWind(0.0, 0.0, 1.0, 0.9e-3),
    "gale_4": GaleWind(4.2, 0.0, 1.1, 0.1e-3),
    "gale_8": GaleWind(8.5, 0.0, 1.25, 0.1e-3),
    "gale_8s": GaleWind(8.5, 2.2, 1.3, 0.1e-3),
    "gale_12": GaleWind(12.1, 0.0, 1.35, 0.1e-3),
}


def course(time_s: float) -> tuple[Vec3, Vec3, Vec3]:
    """Position [m], velocity [m/s] and acceleration [m/s²], z up."""
    if time_s < RISE_S:
        phase, rate, rise = 0.5 * time_s * time_s / RISE_S, time_s / RISE_S, 1.0 / RISE_S
    else:
        phase, rate, rise = time_s - 0.5 * RISE_S, 1.0, 0.0
    s, c, s2, c2 = *_circle(phase - math.pi), *_circle(2.0 * (phase - math.pi))
    square = rate * rate
    return (
        (0.25 + 1.25 * s, 0.0, 2.15 + 0.75 * s2),
        (1.25 * c * rate, 0.0, 1.5 * c2 * rate),
        (1.25 * (c * rise - s * square), 0.0, 1.5 * (c2 * rise - 2.0 * s2 * square)),
    )


def trim(speed_m_s: float) -> tuple[float, float]:
    """Pitch (towards the wind) [rad] and thrust over the weight at which it stands still in the wind."""
    pitch, push, lift = 0.0, 0.0, 1.0
    for _ in range(100):
        s, c = _circle(pitch)
        inflow, sink = speed_m_s * c, speed_m_s * s
        plane = -(DRAG + DRAG_INFLOW * inflow) * inflow
        along = -(SINK_DRAG + SINK_INFLOW * inflow) * sink + LIFT * inflow**2
        push = -(plane * c + along * s + BIAS_N[0]) / (MASS_KG * GRAVITY)
        lift = 1.0 - (along * c - plane * s) / (MASS_KG * GRAVITY)
        pitch = math.atan2(push, lift)
    return pitch, math.hypot(push, lift)


def _circle(angle: float) -> tuple[float, float]:
    return math.sin(angle), math.cos(angle)
