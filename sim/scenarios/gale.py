"""Gale: the fan array, the 2.6 kg quadrotor and the course of O'Connell et al., Neural-Fly.

Science Robotics 7 (2022), doi 10.1126/scirobotics.abm6597. Unless a constant says "chosen", its
value was derived from the published logs of those flights. The logs, and the study that derived the
values, are not part of this project; docs/evidence.md compares flights in this tunnel with the
published ones. No value was fitted to the RMS errors.

Axes here: x into the wind, y to the left of it, z up. The vehicle leans towards +x.
"""

import math
from typing import NamedTuple

from groundstation.core.geometry import Vec3
from groundstation.core.vehicle import GRAVITY


class GaleVehicle(NamedTuple):
    """The quadrotor, and the poses of its room."""

    mass_kg: float = 2.6
    """Mass of the vehicle [kg]."""
    hover: float = 0.48
    """Thrust signal at hover, as a share of the full signal [-]."""
    thrust_curve: float = 0.55
    """f of thrust = f u² + (1 - f) u, u the signal [-].

    With it, at hover, 1 % more signal gives 1.37 % more thrust (logs: 1.33 to 1.43). The published
    flights assumed f = 0.
    """
    thrust_delay_s: float = 0.06
    """Dead time of the thrust [s]."""
    thrust_lag_s: float = 0.04
    """Time constant of the thrust [s]."""
    attitude_rad_s: float = 7.0
    """Natural frequency of the attitude loop, which has damping 0.5 [rad/s].

    On a vehicle that takes body rates the same loop is a rate lag of 1/7 s and an attitude gain of
    7 1/s.
    """
    pitch_per_m_s: float = 0.02
    """Pitch, nose down, per upward speed in wind [rad s/m]."""
    drag: float = 0.80
    """Drag in the rotors' plane per speed of the air in it [N s/m]."""
    drag_inflow: float = 0.035
    """Growth of ``drag`` per speed of the air in the rotors' plane [N s²/m²]."""
    sink_drag: float = 0.85
    """Drag along the thrust per speed of the air along it [N s/m]."""
    sink_inflow: float = 0.19
    """Growth of ``sink_drag`` per speed of the air in the rotors' plane [N s²/m²]."""
    lift: float = 0.035
    """Lift per squared speed of the air in the rotors' plane [N s²/m²]."""
    rest_n: Vec3 = (0.3, 0.15, 0.5)
    """Standard deviation, per axis, of the force that differs from lap to lap [N]: an
    Ornstein-Uhlenbeck noise."""
    rest_s: float = 0.6
    """Correlation time of that noise [s]."""
    bias_n: Vec3 = (1.2, -0.43, 0.0)
    """Constant force, in the axes of this file [N]."""
    pose_latency_s: float = 0.010
    """Latency of the poses [s]. Chosen, as of a usual tracking room: the logs have none."""
    attitude_noise_rad: float = 0.001
    """Attitude noise of the poses, 1σ [rad]. Chosen, as of a tracking room with a large body: the
    logs have none."""
    pose_hz: float = 50.0
    """Rate of the poses in the logs [Hz]."""
    pose_noise_m: float = 2e-5
    """Position noise of the poses, 1σ [m]."""

    @property
    def full_n(self) -> float:
        """Thrust of the full signal [N]."""
        curve, hover = self.thrust_curve, self.hover
        return self.mass_kg * GRAVITY / (curve * hover**2 + (1.0 - curve) * hover)


VEHICLE = GaleVehicle()
RISE_S = 12.55
"""Time in which the phase rate of the course rises from 0 to 1 rad/s [s]: the first lap."""
MIDDLE_X_M = 0.25
"""Middle of the course, x [m]."""
MIDDLE_Z_M = 2.15
"""Middle of the course, z [m]."""
REACH_X_M = 1.25
"""Reach of the course from its middle along x, once per lap [m]."""
REACH_Z_M = 0.75
"""Reach of the course from its middle along z, twice per lap [m]: the course is an upright figure
eight."""
TRIM_ROUNDS = 100
"""Rounds of the iteration for the trim [-]: far more than it needs to converge. Chosen."""
GUST_PHASE = 5.0
"""Phase of the swinging wind at the start [rad]."""


class GaleWind(NamedTuple):
    """One setting of the fans: the wind is ``speed_m_s`` + ``gust_m_s`` sin(t + ``GUST_PHASE``), t
    in seconds.
    """

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
    """Position [m], velocity [m/s] and acceleration [m/s²] of the course, in the axes of this
    file.
    """
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
    """Pitch towards the wind [rad] and thrust over weight [-] at which the vehicle hovers in wind
    of that speed.
    """
    v, pitch, forward, upward = VEHICLE, 0.0, 0.0, 1.0
    for _ in range(TRIM_ROUNDS):
        s, c = math.sin(pitch), math.cos(pitch)
        inflow, sink = (
            speed_m_s * c,
            speed_m_s * s,
        )  # the air's speed in the rotors' plane, and along the thrust
        plane = -(v.drag + v.drag_inflow * inflow) * inflow
        along = -(v.sink_drag + v.sink_inflow * inflow) * sink + v.lift * inflow**2
        # The thrust must balance the air's force, the constant force and the weight, in x and in z.
        forward = -(plane * c + along * s + v.bias_n[0]) / (v.mass_kg * GRAVITY)
        upward = 1.0 - (along * c - plane * s) / (v.mass_kg * GRAVITY)
        pitch = math.atan2(forward, upward)
    return pitch, math.hypot(forward, upward)
