"""Gale: the fan array, the 2.6 kg quadrotor and the course of O'Connell et al., Neural-Fly.

Science Robotics 7 (2022), doi 10.1126/scirobotics.abm6597. Unless a constant says "chosen", its value was derived from
the published logs of those flights. The logs, and the study that derived the values, are not part of this project;
docs/evidence.md compares flights in this tunnel with the published ones. No value was fitted to the RMS errors.

Axes here: x into the wind, y to the left of it, z up. The vehicle leans towards +x.
"""

import math
from typing import NamedTuple

from groundstation.core.geometry import Vec3
from groundstation.core.vehicle import GRAVITY

MASS_KG = 2.6
"""Mass of the vehicle [kg]."""
HOVER = 0.48
"""Thrust signal at hover, as a share of the full signal [-]."""
THRUST_CURVE = 0.55
"""f of thrust = f u² + (1 - f) u, u the signal [-].

With it, at hover, 1 % more signal gives 1.37 % more thrust (logs: 1.33 to 1.43). The published flights assumed f = 0.
"""
THRUST_DELAY_S = 0.06
"""Dead time of the thrust [s]."""
THRUST_LAG_S = 0.04
"""Time constant of the thrust [s]."""
ATTITUDE_RAD_S = 7.0
"""Natural frequency of the attitude loop, which has damping 0.5 [rad/s].

On a vehicle that takes body rates the same loop is a rate lag of 1/7 s and an attitude gain of 7 1/s.
"""
PITCH_PER_M_S = 0.02
"""Pitch, nose down, per upward speed in wind [rad s/m]."""
DRAG = 0.80
"""Drag in the rotors' plane per speed of the air in it [N s/m]."""
DRAG_INFLOW = 0.035
"""Growth of DRAG per speed of the air in the rotors' plane [N s²/m²]."""
SINK_DRAG = 0.85
"""Drag along the thrust per speed of the air along it [N s/m]."""
SINK_INFLOW = 0.19
"""Growth of SINK_DRAG per speed of the air in the rotors' plane [N s²/m²]."""
LIFT = 0.035
"""Lift per squared speed of the air in the rotors' plane [N s²/m²]."""
REST_N: Vec3 = (0.3, 0.15, 0.5)
"""Standard deviation, per axis, of the force that differs from lap to lap [N]: an Ornstein-Uhlenbeck noise."""
REST_S = 0.6
"""Correlation time of that noise [s]."""
BIAS_N: Vec3 = (1.2, -0.43, 0.0)
"""Constant force, in the axes of this file [N]."""
FULL_N = MASS_KG * GRAVITY / (THRUST_CURVE * HOVER**2 + (1.0 - THRUST_CURVE) * HOVER)
"""Thrust of the full signal [N]."""
POSE_LATENCY_S = 0.010
"""Latency of the poses [s]. Chosen, as of a usual tracking room: the logs have none."""
ATTITUDE_NOISE_RAD = 0.001
"""Attitude noise of the poses, 1σ [rad]. Chosen, as of a tracking room with a large body: the logs have none."""
POSE_HZ = 50.0
"""Rate of the poses in the logs [Hz]."""
POSE_NOISE_M = 2e-5
"""Position noise of the poses, 1σ [m]."""
RISE_S = 12.55
"""Time in which the phase rate of the course rises from 0 to 1 rad/s [s]: the first lap."""
MIDDLE_X_M = 0.25
"""Middle of the course, x [m]."""
MIDDLE_Z_M = 2.15
"""Middle of the course, z [m]."""
REACH_X_M = 1.25
"""Reach of the course from its middle along x, once per lap [m]."""
REACH_Z_M = 0.75
"""Reach of the course from its middle along z, twice per lap [m]: the course is an upright figure eight."""
TRIM_ROUNDS = 100
"""Rounds of the iteration for the trim [-]: far more than it needs to converge. Chosen."""
GUST_PHASE = 5.0
"""Phase of the swinging wind at the start [rad]."""


class GaleWind(NamedTuple):
    """One setting of the fans: the wind is ``speed_m_s`` + ``gust_m_s`` sin(t + ``GUST_PHASE``), t in seconds."""

    speed_m_s: float
    """Mean speed [m/s]."""
    gust_m_s: float
    """Amplitude of the swinging part [m/s]."""
    gain: float
    """Achieved over commanded change of the pitch, relative to still air [-]."""
    jitter_s: float
    """Jitter of the poses' stamps, 1σ [s]."""


WINDS = {
    "gale_0": GaleWind(0.0, 0.0, 1.0, 0.9e-3),
    "gale_4": GaleWind(4.2, 0.0, 1.1, 0.1e-3),
    "gale_8": GaleWind(8.5, 0.0, 1.25, 0.1e-3),
    "gale_8s": GaleWind(8.5, 2.2, 1.3, 0.1e-3),
    "gale_12": GaleWind(12.1, 0.0, 1.35, 0.1e-3),
}


def course(time_s: float) -> tuple[Vec3, Vec3, Vec3]:
    """Position [m], velocity [m/s] and acceleration [m/s²] of the course, in the axes of this file."""
    if time_s < RISE_S:
        phase, rate, rise = 0.5 * time_s * time_s / RISE_S, time_s / RISE_S, 1.0 / RISE_S
    else:
        phase, rate, rise = time_s - 0.5 * RISE_S, 1.0, 0.0
    s, c = math.sin(phase - math.pi), math.cos(phase - math.pi)
    s2, c2 = math.sin(2.0 * (phase - math.pi)), math.cos(2.0 * (phase - math.pi))
    square = rate * rate
    climb = 2.0 * REACH_Z_M
    return (
        (MIDDLE_X_M + REACH_X_M * s, 0.0, MIDDLE_Z_M + REACH_Z_M * s2),
        (REACH_X_M * c * rate, 0.0, climb * c2 * rate),
        (REACH_X_M * (c * rise - s * square), 0.0, climb * (c2 * rise - 2.0 * s2 * square)),
    )


def trim(speed_m_s: float) -> tuple[float, float]:
    """Pitch towards the wind [rad] and thrust over weight [-] at which the vehicle hovers in wind of that speed."""
    pitch, forward, upward = 0.0, 0.0, 1.0
    for _ in range(TRIM_ROUNDS):
        s, c = math.sin(pitch), math.cos(pitch)
        inflow, sink = speed_m_s * c, speed_m_s * s  # the air's speed in the rotors' plane, and along the thrust
        plane = -(DRAG + DRAG_INFLOW * inflow) * inflow
        along = -(SINK_DRAG + SINK_INFLOW * inflow) * sink + LIFT * inflow**2
        # The thrust must balance the air's force, the constant force and the weight, in x and in z.
        forward = -(plane * c + along * s + BIAS_N[0]) / (MASS_KG * GRAVITY)
        upward = 1.0 - (along * c - plane * s) / (MASS_KG * GRAVITY)
        pitch = math.atan2(forward, upward)
    return pitch, math.hypot(forward, upward)
