"""World: the true figures of a simulated flight, of vehicle, air, cameras and radio; and its wind.

The wind is given as an acceleration of the vehicle: mean, sine gusts, one step, and Dryden-shaped
turbulence.
"""

import math
from collections.abc import Iterator
from typing import Annotated, Literal, NamedTuple, TypeAlias

import msgspec

from groundstation.core.geometry import FLOATS, Coordinate, Ops, Real, Vec3, add_scaled
from groundstation.core.vehicle import (
    GRAVITY,
    Delay,
    Drag,
    FramePeriod,
    Lag,
    Mass,
    RateLimit,
    Thrust,
)

Positive = Annotated[float, msgspec.Meta(ge=1e-7)]
"""A quantity of a vehicle or its rotors: the smallest is the inertia of one of 5 g, 1e-6 kg m²."""
NonNegative = Annotated[float, msgspec.Meta(ge=0.0)]
Share = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
PartOfSecond = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
"""A latency or its jitter [s]; more is in milliseconds."""
Duration = Annotated[float, msgspec.Meta(ge=0.0, le=3600.0)]
"""A time within a flight [s]; more is in milliseconds."""
Period = Annotated[float, msgspec.Meta(ge=0.01, le=3600.0)]
"""Time from one event of a flight to the next [s]."""
Rate = Annotated[float, msgspec.Meta(ge=0.001, le=1000.0)]
"""Events per second [Hz]."""
Gain = Annotated[float, msgspec.Meta(ge=0.001, le=10.0)]
"""A true over a commanded value [-]; more is in percent."""
Noise = Annotated[float, msgspec.Meta(ge=0.0, le=0.1)]
"""Noise of a position [m]; more is in millimetres."""
AngleNoise = Annotated[float, msgspec.Meta(ge=0.0, le=0.2)]
"""Noise of an angle [rad]; more is in degrees."""
Speed = Annotated[float, msgspec.Meta(ge=0.001, le=50.0)]
"""A speed [m/s]; more is in millimetres per second."""
Component = Annotated[float, msgspec.Meta(ge=-100.0, le=100.0)]
"""Component of an acceleration by the air [m/s²], or of a velocity [m/s]: ten times the weight, or
a hurricane."""
Angle = Annotated[float, msgspec.Meta(ge=-360.0, le=360.0)]
"""An angle [deg]."""
Coupling = Annotated[float, msgspec.Meta(ge=-100.0, le=100.0)]
"""A body rate that comes with a speed [rad/m]: a turn within 6 cm of climb."""
Place: TypeAlias = tuple[Coordinate, Coordinate, Coordinate]
"""A point [m, NED]."""
Components: TypeAlias = tuple[Component, Component, Component]
"""An acceleration [m/s², NED] or a velocity [m/s, NED]."""
Angles: TypeAlias = tuple[Angle, Angle, Angle]
"""A rotation vector [deg]."""


class RotorConstants(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Rotors, body and rate loop of a vehicle with ``sim.plant = "rotors"``. Defaults: those of the
    vehicle of 80 g.
    """

    arm_m: Positive = 0.11
    """Distance of each rotor from the middle [m]; the rotors form an X."""
    inertia_kg_m2: tuple[Positive, Positive, Positive] = (1.2e-4, 1.2e-4, 2.0e-4)
    """Moments of inertia about roll, pitch and yaw [kg m²]."""
    torque_per_thrust_m: Positive = 0.010
    """Torque over thrust of a rotor [m]."""
    curve: Share = 0.0
    """f of thrust = f n² + (1 - f) n, from a rotor's speed n (0..1) to its share of thrust [-]; the
    autopilot on board knows it and takes it out again."""
    spin_up_s: Lag = 0.040
    """Time constant of the rotors' speed where it rises [s]."""
    spin_down_s: Lag = 0.040
    """Time constant of a rotor that slows down [s]."""
    p: NonNegative = 25.0
    """Angular acceleration demanded per error of the rate [1/s]."""
    i: NonNegative = 25.0
    """Angular acceleration demanded per integral of the rate error [1/s²]."""
    d: NonNegative = 0.4
    """Angular acceleration taken back per measured one [-]."""
    yaw_gain: Share = 0.4
    """Share of the three for yaw [-]."""
    gyro_noise_rad_s: NonNegative = 0.02
    """Gyro noise of each step, 1σ per axis [rad/s]."""
    gyro_filter_hz: Positive = 80.0
    """Edge of the gyro's filter [Hz]."""
    d_filter_hz: Positive = 60.0
    """Edge of the further filter of D [Hz]."""
    rate_filter_s: Lag = 0.0
    """Time constant of the filter of the rate set-points [s]."""
    thrust_filter_s: Lag = 0.0
    """Time constant of the filter of the thrust set-point [s]."""


class WindTunnel(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Effects of a wall of fans beside drag and the air's mean speed; none by default."""

    gust_m_s: Component = 0.0
    """The air's speed to the north gains so much times sin(``gust_rad_s`` t + ``gust_phase_rad``)
    [m/s]."""
    gust_rad_s: Positive = 1.0
    """[rad/s]"""
    gust_phase_rad: float = 0.0
    """[rad]"""
    rest_m_s2: Components = (0.0, 0.0, 0.0)
    """Random push: Ornstein-Uhlenbeck noise, RMS [m/s², NED]."""
    rest_s: Period = 0.6
    """Its correlation time [s]."""
    pitch_gain: Gain = 1.0
    """Achieved over commanded pitch [-]."""
    pitch_per_climb: Coupling = 0.0
    """Pitch rate, nose down, that comes with each m/s upwards [rad/m]."""
    start_pitch_deg: Angle = 0.0
    """Pitch at the release, nose up [deg]."""

    def turn(self, rates: Vec3, velocity: Vec3) -> Vec3:
        """Return the body rates that the vehicle follows [rad/s, FRD] where ``rates`` are commanded
        at ``velocity`` [m/s, NED].
        """
        return (rates[0], self.pitch_gain * rates[1] + self.pitch_per_climb * velocity[2], rates[2])


STILL = WindTunnel()


class World(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All figures of a scenario. The controller knows none of them, but its own configuration."""

    mass_kg: Mass = 0.080
    """[kg]"""
    thrust_max_n: Thrust = 1.37
    """Thrust at full command with a thrust gain of 1 [N]."""
    thrust_curve: Share = 0.0
    """f of thrust = f u² + (1 - f) u, from the signal that the autopilot is sent to thrust: what it
    leaves of the motors' curve [-]."""
    rate_limits_deg_s: tuple[RateLimit, RateLimit, RateLimit] = (200.0, 200.0, 300.0)
    """Largest body rates the vehicle follows [deg/s]."""
    thrust_gain: Gain = 1.0
    """True thrust over commanded thrust, at the start [-]."""
    thrust_sag: Share = 0.0
    """Share of the thrust gain lost, linearly, over the flight [-]."""
    thrust_lag_s: Lag = 1.0 / (2.0 * math.pi * 1.5)
    """First-order lag of the thrust [s]."""
    rate_lag_s: Lag = 1.0 / (2.0 * math.pi * 1.5)
    """First-order lag of each body rate [s]."""
    thrust_delay_s: Delay = 0.0
    """Dead time between a command's arrival at the vehicle and the thrust's first answer [s]; the
    lag comes on top."""
    rate_delay_s: Delay = 0.0
    """Dead time of the body rates [s], counted alike."""
    plant: Literal["first_order", "rotors"] = "first_order"
    """Whether thrust and rates follow their commands by first-order lags, or by a rate loop that
    drives four rotors; rotors have no use for the two lags, and want a short ``sim.step_s``: it is
    the rate loop's period."""
    rotors: RotorConstants = RotorConstants()
    """Constants of the rotors; used with ``sim.plant = "rotors"`` only."""
    drag_per_s: Drag = 0.0
    """Linear drag: deceleration per speed [1/s]."""
    drag_body_per_s: Vec3 = (0.0, 0.0, 0.0)
    """Further linear drag along each of the body's axes, against the air [1/s]."""
    inflow_drag_per_m: tuple[float, float] = (0.0, 0.0)
    """Growth of the drag with the air's speed in the rotors' plane: within that plane, and along
    the thrust [1/m]."""
    inflow_lift_per_m: float = 0.0
    """Acceleration along the thrust per square of that speed [1/m]."""
    air_velocity: Components = (0.0, 0.0, 0.0)
    """Speed of the air, against which the drag along the body's axes counts [m/s, NED]."""
    tunnel: WindTunnel = STILL
    """A wall of fans; not in the array engine."""
    rate_leak: float = 0.0
    """Centre of mass off the rotors' centre: lateral acceleration per commanded body rate [m/s² per
    rad/s]."""
    wind_mean: Components = (0.1, -0.05, 0.2)
    """Constant disturbance [m/s², NED]."""
    wind_gust: Components = (0.0, 0.0, 0.0)
    """Amplitude of the sine gusts [m/s², NED]."""
    wind_gust_hz: Rate = 0.2
    """Their frequency [Hz]."""
    wind_turbulence: Annotated[float, msgspec.Meta(ge=0.0, le=100.0)] = 0.0
    """Dryden-shaped turbulence, RMS per axis [m/s²]."""
    wind_step: Components = (0.0, 0.0, 0.0)
    """A step of the wind [m/s², NED]."""
    wind_step_time_s: Duration = 30.0
    """When it comes [s after release]."""
    wind_push_s: Duration = 0.0
    """Above 0 the step is a push: half a sine of this length, ``wind_step`` its peak [s]."""
    pose_rate_hz: Rate = 50.0
    """Camera frames per second [Hz]."""
    pose_latency_s: PartOfSecond = 0.020
    """Latency between exposure and the datagram's arrival [s]."""
    pose_noise_m: Noise = 0.0003
    """Position noise, 1σ per axis [m]."""
    attitude_noise_rad: AngleNoise = 0.002
    """Attitude noise, 1σ per axis [rad]."""
    pose_jitter_s: PartOfSecond = 0.0
    """Jitter of the poses' stamps against their exposures, 1σ [s]."""
    tracker_yaw_deg: Angle = 0.0
    """Error of the configured heading of the tracker: its true north lies so far to the east of it
    [deg]."""
    pose_loss: Share = 0.0
    """Share of the poses lost at random [-]."""
    outage_s: Duration = 0.0
    """Length of the regular outages of all poses [s]."""
    outage_period_s: Period = 10.0
    """Time from one outage to the next [s]."""
    other_bodies: Annotated[int, msgspec.Meta(ge=0, le=8)] = 0
    """Further bodies that the cameras see, circling around the volume."""
    occlusion_s: Duration = 0.0
    """Length of the regular occlusions: frames come, but our body is not seen [s]."""
    swap_s: Duration = 0.0
    """Length of the regular mix-ups: our body and the next one change names [s]."""
    mishap_period_s: Period = 10.0
    """Time from one occlusion, or mix-up, to the next [s]; they come in the middle of it, and after
    three quarters."""
    frame_period_s: FramePeriod = 0.0225
    """Period of the command frames; the last one is held [s]."""
    command_delay_s: PartOfSecond = 0.0
    """Latency of the uplink between our frame and the vehicle's autopilot, as on a slow radio
    [s]."""
    telemetry_hz: Annotated[float, msgspec.Meta(ge=0.0, le=1000.0)] = 0.0
    """Rate of the attitude telemetry through a CRSF module [Hz]; Betaflight sends 10 Hz."""
    frame_loss: Share = 0.0
    """Share of the command frames lost at random [-]."""
    speed_m_s: Speed = 0.5
    """Speed of the reference along the figure eight [m/s]."""
    start_ned: Place = (0.8, -0.8, 0.0)
    """Where the vehicle is held until it obeys [m, NED]."""
    start_velocity: Components = (0.0, 0.0, 0.0)
    """Velocity at the release [m/s, NED]: the vehicle is thrown."""
    start_turn_deg: Angles = (0.0, 0.0, 0.0)
    """Attitude in which it is held, as a rotation vector from level and north [deg]."""
    start_thrust: Annotated[float, msgspec.Meta(ge=0.0, le=10.0)] = 0.6
    """Thrust at the release, as a share of the hover thrust [-]."""
    own_estimate: bool = False
    """Whether the autopilot knows its own position and speed (GPS, optical flow), and says so."""
    velocity_bias: Components = (0.0, 0.0, 0.0)
    """Bias of the autopilot's velocity against its own positions [m/s, NED]; ArduCopter's, with a
    simulated GPS: 0.016."""
    estimate_wander_m: Annotated[float, msgspec.Meta(ge=0.0, le=10.0)] = 0.0
    """Random walk of the measured position over 2 s, 1σ per axis [m], and of the speed with it, for
    the autopilot's own estimate and the cameras' alike. PX4's own, with a simulated GPS: 0.05."""
    estimate_yaw_step_deg: Angle = 0.0
    """A step of the measured yaw, which the autopilot's ODOMETRY announces [deg]; PX4 was seen to
    make 19. Until then its heading is off by so much the other way: an estimator turns it once it
    sees that it does not fit its speed."""
    estimate_yaw_step_s: Duration = 2.0
    """When it comes [s after release]."""
    floor_z_m: Coordinate = 1.0
    """Height of the floor [m, NED, so 1 is one metre below the origin]."""
    floor_friction: Annotated[float, msgspec.Meta(ge=0.0, le=100.0)] = 1.0
    """Force that the floor holds it with sideways over the force that it presses on it with [-]."""
    floor_hold_s: Duration = 0.0
    """Time for which the floor holds a vehicle that already gathers speed upwards [s]; ArduPilot's
    SITL: 0.6."""
    ground_effect: bool = False
    """Whether thrust grows near the floor; flights that begin on the floor have it."""
    rotor_radius_m: Annotated[float, msgspec.Meta(ge=0.001, le=1.0)] = 0.035
    """Radius of one rotor [m]: the ground effect fades with height over it."""
    step_s: Annotated[float, msgspec.Meta(ge=1e-5, le=0.0025)] = 0.0025
    """Longest step of the plant [s]; errors are sampled at every step."""
    gravity: Annotated[float, msgspec.Meta(ge=1.0, le=30.0)] = GRAVITY
    """[m/s²]"""


# MIL-F-8785C, low altitude: at 1 m height the scale lengths are 7.9 m along and across the wind and
# 1 m vertically; flown through at 3 m/s they become these correlation times. For rooms no better
# figures are known.
CORRELATION_S = (2.6, 2.6, 0.33)
"""Correlation times of the turbulence, along and across the wind and vertical [s]."""


GRID_S = 0.0025
"""Period at which the turbulence advances; it is held between [s]: one step of the plant."""
# The lateral form (1 + √3 τs)/(1 + τs)² is √3 x - (√3 - 1) y: x has time τ and unit variance, y is
# x through one more lag τ; E[x²] = 1, E[xy] = E[y²] = 1/2, so its variance is 2.
ROOT3 = math.sqrt(3.0)
"""Root of 3, of Dryden's lateral filter."""
KEEP = tuple(math.exp(-GRID_S / correlation_s) for correlation_s in CORRELATION_S)
"""Share of each state that a grid step keeps [-]."""
SPREAD = tuple(math.sqrt(1.0 - keep**2) for keep in KEEP)
"""Weight of the new random number in a grid step, which keeps the variance 1 [-]."""


class TurbulenceState(NamedTuple):
    """State of the turbulence: x, y and z after one lag, y and z after a second one.
    Elementwise.
    """

    once: Vec3
    twice_y: Real
    twice_z: Real


def begin_turbulence(normals: Vec3) -> TurbulenceState:
    """Return a stationary state, from three standard normal numbers."""
    return TurbulenceState(normals, 0.0, 0.0)


def advance_turbulence(state: TurbulenceState, normals: Vec3) -> TurbulenceState:
    """Return the state one grid step later, from three standard normal numbers."""
    (x, y, z), twice_y, twice_z = state
    x = KEEP[0] * x + SPREAD[0] * normals[0]
    y = KEEP[1] * y + SPREAD[1] * normals[1]
    z = KEEP[2] * z + SPREAD[2] * normals[2]
    return TurbulenceState(
        (x, y, z), KEEP[1] * twice_y + (1.0 - KEEP[1]) * y, KEEP[2] * twice_z + (1.0 - KEEP[2]) * z
    )


def compute_turbulence(state: TurbulenceState, rms: Real) -> Vec3:
    """Return the turbulence [m/s², NED] of ``rms`` [m/s²]: Dryden's longitudinal form on x, lateral
    form on y and z (MIL-F-8785C, 3.7).
    """
    (x, y, z), twice_y, twice_z = state
    k = rms / math.sqrt(2.0)
    return (
        rms * x,
        k * (ROOT3 * y - (ROOT3 - 1.0) * twice_y),
        k * (ROOT3 * z - (ROOT3 - 1.0) * twice_z),
    )


class SteadyWind(NamedTuple):
    """Mean, gust and step or push of the wind, as in :class:`World`. Elementwise."""

    mean: Vec3
    gust: Vec3
    gust_hz: Real
    step: Vec3
    step_time_s: Real
    push_s: Real


def compute_steady(ops: Ops, wind: SteadyWind, flight_time: float) -> Vec3:
    """Return mean, gust and step or push together [m/s², NED] at ``flight_time`` [s]."""
    sine = ops.sin(2.0 * math.pi * wind.gust_hz * flight_time)
    is_push = wind.push_s > 0.0
    since = (flight_time - wind.step_time_s) / ops.where(is_push, wind.push_s, 1.0)
    half_sine = ops.sin(math.pi * ops.clamp(since, 0.0, 1.0))
    share = ops.where(flight_time >= wind.step_time_s, ops.where(is_push, half_sine, 1.0), 0.0)
    return add_scaled(add_scaled(wind.mean, sine, wind.gust), share, wind.step)


def find_grid_step(flight_time: float) -> int:
    """Return the number of the grid step that contains ``flight_time`` [s], its start included."""
    return int(flight_time / GRID_S + 1e-6)


class Wind:
    """Disturbance b(t) [m/s², NED] of one flight, for instants that do not go back in time."""

    def __init__(self, world: World, normals: Iterator[tuple[float, ...]]) -> None:
        """Take the world's wind figures, and rows of three standard normal numbers for the
        turbulence.
        """
        self._world = world
        w = world
        self._steady = SteadyWind(
            w.wind_mean, w.wind_gust, w.wind_gust_hz, w.wind_step, w.wind_step_time_s, w.wind_push_s
        )
        self._normals = normals
        self._is_constant = not any((*w.wind_gust, *w.wind_step))
        self._is_random = bool(world.wind_turbulence) or any(world.tunnel.rest_m_s2)
        self._grid_step = -1
        self._turbulence_state: TurbulenceState | None = None
        self._turbulence: Vec3 = (0.0, 0.0, 0.0)
        self._residual: Vec3 = (0.0, 0.0, 0.0)
        self.push: Vec3 = (0.0, 0.0, 0.0)
        """Additional acceleration beside the world's wind [m/s², NED]; may be changed in flight."""

    def at(self, flight_time: float) -> Vec3:
        """Return b [m/s², NED] at ``flight_time`` [s] after release."""
        x, y, z = (
            self._steady.mean
            if self._is_constant
            else compute_steady(FLOATS, self._steady, flight_time)
        )
        if self.push != (0.0, 0.0, 0.0):
            x, y, z = x + self.push[0], y + self.push[1], z + self.push[2]
        if not self._is_random:
            return (x, y, z)
        rest = self._world.tunnel.rest_m_s2
        grid_step = find_grid_step(flight_time)
        while self._grid_step < grid_step:
            if self._world.wind_turbulence:
                a, b, c = next(self._normals)
                self._turbulence_state = (
                    begin_turbulence((a, b, c))
                    if self._turbulence_state is None
                    else advance_turbulence(self._turbulence_state, (a, b, c))
                )
                self._turbulence = compute_turbulence(
                    self._turbulence_state, self._world.wind_turbulence
                )
            if any(rest):
                keep = (
                    math.exp(-GRID_S / self._world.tunnel.rest_s) if self._grid_step >= 0 else 0.0
                )
                spread, (a, b, c), (p, q, r) = (
                    math.sqrt(1.0 - keep * keep),
                    next(self._normals),
                    self._residual,
                )
                i, j, k = rest
                self._residual = (
                    keep * p + spread * i * a,
                    keep * q + spread * j * b,
                    keep * r + spread * k * c,
                )
            self._grid_step += 1
        (tx, ty, tz), (p, q, r) = self._turbulence, self._residual
        return (x + tx + p, y + ty + q, z + tz + r)
