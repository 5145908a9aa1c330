"""Vehicle: its configuration, its limits, and the model by which it is integrated forward in time.

The configuration is the section ``[vehicle]``, or a file of its own. The limits (section
``[limits]``) restrict a flight further. The model is (1), (2) of the paper, p˙ = v, v˙ = g e3 + d -
(T/m) R e3 - c v, with first-order lags on thrust and body rates, the actuators; lags and their
inverse are exact for a command that is held. A step has two parts. Attitude and thrust depend on
the commands only, and so do the integrals of the thrust (:func:`integrate_actuators`, one call for
each command that acts). All else is added once, at the end (:func:`integrate_motion`): position and
velocity are linear in thrust over mass, gravity and wind. Elementwise: floats, or arrays of shape
(N,).
"""

import math
from collections import deque
from typing import Annotated, Any, ClassVar, NamedTuple

import msgspec

from groundstation.config import (
    WHOLE_NAME,
    FromFile,
    Problem,
    config_notice,
    convert,
    dotted_key,
    parse_toml,
    presets,
)
from groundstation.core.geometry import (
    FLOATS,
    ZERO,
    Ops,
    Quat,
    Real,
    Vec3,
    add,
    add_scaled,
    rotate,
    scale,
    subtract,
    to_world,
)

Mass = Annotated[float, msgspec.Meta(ge=0.005, le=100.0)]
"""A mass [kg]: a larger number is in grams, and no tracked vehicle is lighter than 5 g."""
Thrust = Annotated[float, msgspec.Meta(ge=1e-6, le=5000.0)]
"""A thrust [N]: from a fifty-thousandth of the weight of the lightest vehicle to five times that of
the heaviest."""
Lag = Annotated[float, msgspec.Meta(ge=0.0, le=0.5)]
"""A time constant of an actuator [s]: a larger number is in milliseconds, or of a rotor that no
loop can fly."""
Delay = Annotated[float, msgspec.Meta(ge=0.0, le=0.5)]
"""A dead time of an actuator [s]: a larger number is in milliseconds."""
Drag = Annotated[float, msgspec.Meta(ge=0.0, le=10.0)]
"""Linear drag [1/s]: at 10, a thrust of twice the weight reaches less than 2 m/s."""
FramePeriod = Annotated[float, msgspec.Meta(ge=0.001, le=0.25)]
"""A period of commands [s]: a larger number is in milliseconds, and no link carries more than 1000
a second."""
Size = Annotated[float, msgspec.Meta(ge=0.03, le=10.0)]
"""An extent [m]: a larger number is in millimetres, and no vehicle is smaller than the triangle of
its markers."""
RateLimit = Annotated[float, msgspec.Meta(ge=15.0, le=1e5)]
"""A body rate [deg/s]: 100000 is no limit at all, and a smaller number than 15 is in radians per
second."""
WeightShare = Annotated[float, msgspec.Meta(ge=0.01, le=10.0)]
"""A thrust as a share of the weight [-]."""
Share = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
"""A share, 0 and 1 included [-]."""
HoverSignal = Annotated[float, msgspec.Meta(ge=0.001, lt=1.0)]
"""A signal that carries the vehicle [-]: no rotors give a thousand times the weight."""

GRAVITY = 9.81
"""Default g [m/s²]: the paper's."""
APART_S = 0.002
"""Difference of the delays of thrust and rates up to which they count as equal [s]: a tenth of a
frame."""


class Vehicle(FromFile, msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Mass, limits and lags. Defaults: the paper's Blade mQX."""

    PRESETS: ClassVar[str] = "vehicles"
    preset: Annotated[
        str | None,
        msgspec.Meta(
            description="Vehicle that comes along to start from, see `groundstation config "
            "vehicles`; its keys are then here."
        ),
    ] = None
    file: Annotated[
        str | None,
        msgspec.Meta(
            description="Vehicle file to start from, beside the configuration; its keys are then "
            "here."
        ),
    ] = None
    name: Annotated[
        str,
        msgspec.Meta(
            pattern=WHOLE_NAME,
            description="Name for the operator, who types it before arming.",
        ),
    ] = "mqx"
    mass_kg: Annotated[Mass, msgspec.Meta(description="With battery and markers [kg].")] = 0.080
    thrust_max_n: Annotated[
        Thrust,
        msgspec.Meta(
            description="Largest thrust to command [N]; without hover_thrust also what the full "
            "signal (1) gives."
        ),
    ] = 1.37
    thrust_min_n: Annotated[
        Thrust,
        msgspec.Meta(description="Least thrust to command in the air [N]; the law needs T > 0."),
    ] = 0.02
    thrust_curve: Annotated[
        Share,
        msgspec.Meta(
            description="f of thrust = f u² + (1 - f) u, from the signal u (0..1) to the share of "
            "full thrust [-]. 0 is straight: right where the autopilot straightens the "
            "motors' curve itself."
        ),
    ] = 0.0
    hover_thrust: Annotated[
        HoverSignal | None,
        msgspec.Meta(
            description="Signal (0..1) that carries the vehicle, as the autopilot shows it (PX4: "
            "MPC_THR_HOVER) [-]; it says how many newtons the full signal gives."
        ),
    ] = None
    rate_limits_deg_s: Annotated[
        tuple[RateLimit, RateLimit, RateLimit],
        msgspec.Meta(description="Largest commanded roll, pitch and yaw rate [deg/s]."),
    ] = (200.0, 200.0, 300.0)
    thrust_lag_s: Annotated[
        Lag, msgspec.Meta(description="Time constant from commanded to actual thrust [s].")
    ] = 1.0 / (2.0 * math.pi * 1.5)
    rate_lag_s: Annotated[
        Lag, msgspec.Meta(description="Time constant from commanded to actual body rates [s].")
    ] = 1.0 / (2.0 * math.pi * 1.5)
    command_delay_s: Annotated[
        Delay, msgspec.Meta(description="From a command leaving us to the actuators seeing it [s].")
    ] = 0.0
    thrust_delay_s: Annotated[
        Delay,
        msgspec.Meta(
            description="From the arrival of a command at the actuators to the beginning of the "
            "thrust's lag [s]."
        ),
    ] = 0.0
    rate_delay_s: Annotated[
        Delay,
        msgspec.Meta(
            description="The same for body rates [s]: rotors and the autopilot's rate loop respond "
            "like a lag behind a delay."
        ),
    ] = 0.0
    drag_per_s: Annotated[
        Drag,
        msgspec.Meta(
            description="Linear drag: deceleration per speed [1/s]; 0 leaves it to what is found "
            "out as wind."
        ),
    ] = 0.0
    frame_period_s: Annotated[
        FramePeriod,
        msgspec.Meta(description="How long a command is held: the period of command frames [s]."),
    ] = 0.0225
    size_m: Annotated[
        Size,
        msgspec.Meta(
            description="Its largest extent, propellers included [m]: another tracked body that is "
            "nearer before arming is too near, or one body under two names."
        ),
    ] = 0.3
    hover_range: Annotated[
        tuple[WeightShare, WeightShare],
        msgspec.Meta(
            description="Least and largest thrust at which it may hover, as a share of its weight "
            "[-]; outside, it lands again. A first number below 0.6 has no effect: what leaves the "
            "floor by 60 % of its weight is stopped there."
        ),
    ] = (0.7, 1.45)
    wind_share: Annotated[
        Share,
        msgspec.Meta(
            description="Share of the disturbance that full thrust can trim sideways, "
            "√((T_max/m)² - g²) [-]: the bound of the estimated disturbance, but at least 5 m/s² "
            "(`controller.b_bound`, where that is left at its default)."
        ),
    ] = 1.0
    hover_n: Annotated[
        Thrust | None,
        msgspec.Meta(
            description="Thrust that hovers, where it was measured (`groundstation identify` does) "
            "[N]: take-off then goes to 1.1 of it and no further, in the place of 1.3 "
            "of the weight."
        ),
    ] = None

    def __post_init__(self) -> None:
        """Only the reader of configurations follows ``preset`` and ``file``.

        Raises:
            ValueError: one of them is given elsewhere.
        """
        if self.preset is not None or self.file is not None:
            raise ValueError(
                config_notice("file.in_python", key="file" if self.preset is None else "preset")
            )

    @property
    def acting_delay_s(self) -> float:
        """Time from sending a command until all of it acts [s]: it is computed for that instant."""
        return self.command_delay_s + max(self.thrust_delay_s, self.rate_delay_s)

    def wind_bound_m_s2(self, gravity: float) -> float:
        """Return ``wind_share`` of the disturbance that full thrust can trim sideways, at
        ``gravity`` [m/s²].
        """
        most = self.thrust_max_n / self.mass_kg
        return self.wind_share * math.sqrt(max(most * most - gravity * gravity, 0.0))

    @property
    def rate_response_per_s(self) -> float:
        """Bandwidth of the body rates for a command held for one frame, delay included [1/s]."""
        return 1.0 / (lead(FLOATS, self.frame_period_s, self.rate_lag_s) + self.rate_delay_s)

    @property
    def sooner_s(self) -> float:
        """Difference between the thrust's and the rates' delay [s]; 0 where it is negligible."""
        apart_s = abs(self.thrust_delay_s - self.rate_delay_s)
        return apart_s if apart_s > APART_S else 0.0

    @classmethod
    def with_text(cls, table: dict[str, Any], text: str) -> dict[str, Any]:
        """Return ``table`` completed by a vehicle file: TOML with all keys of this section.

        A file may start from a ``preset``; then it needs only what differs.

        Raises:
            ValueError: not TOML, a key that is unknown or missing, or a value outside its bounds.
        """
        try:
            values = parse_toml(text)
            base = values.pop("preset", None)
            if "file" in values:
                raise ValueError(config_notice("vehicle.nested_file"))
            if base is not None:
                known = presets(cls)
                if not isinstance(base, str) or base not in known:
                    raise Problem(
                        ("preset",), config_notice("value.choice", choices=list(known), found=base)
                    )
                values = {**parse_toml(known[base]), **values}
            convert(cls, values)
        except Problem as problem:
            raise ValueError(f"{dotted_key(problem.path)}: {problem.text}") from None
        missing = [key for key in cls.__struct_fields__ if key not in {*values, *_OPTIONAL}]
        if missing:
            raise ValueError(config_notice("vehicle.missing", keys=", ".join(missing)))
        return {**values, **table}


_OPTIONAL = (
    "preset", "file", "command_delay_s", "thrust_delay_s", "rate_delay_s", "drag_per_s",
    "thrust_curve",
    "hover_thrust", "hover_range", "size_m", "hover_n", "wind_share",
)  # fmt: skip
"""Keys that a vehicle file may omit."""


class LimitsConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Bounds on the planned flight: a trajectory that would leave them is refused at start."""

    max_speed_m_s: Annotated[
        Annotated[float, msgspec.Meta(ge=0.001, le=50.0)] | None,
        msgspec.Meta(description="Fastest the reference may go [m/s]."),
    ] = None
    max_acceleration_m_s2: Annotated[
        Annotated[float, msgspec.Meta(ge=0.001, le=100.0)] | None,
        msgspec.Meta(description="Largest acceleration of the reference [m/s²]."),
    ] = None
    max_tilt_deg: Annotated[
        float,
        msgspec.Meta(
            ge=2.0,
            le=80.0,
            description="Farthest the vehicle may lean to follow the reference in still air [deg].",
        ),
    ] = 45.0
    reserve: Annotated[
        float,
        msgspec.Meta(
            ge=0.0,
            le=0.4,
            description="Share of the vehicle's thrust range, at either end, and of its body rates "
            "kept for wind and errors [-].",
        ),
    ] = 0.1


class Motion(msgspec.Struct, frozen=True, gc=False, array_like=True):
    """Position and velocity [m, m/s, NED], attitude, thrust [N] and body rates [rad/s, FRD]."""

    position: Vec3
    """North, east, down [m], world NED."""
    velocity: Vec3
    """[m/s], world NED."""
    attitude: Quat
    """Unit quaternion w, x, y, z, body FRD to world NED."""
    thrust: Real
    """Present thrust of the rotors [N], along minus z of the body."""
    rates: Vec3
    """Body rates about x forward, y right, z down [rad/s, FRD]."""


class ActuatorCommand(NamedTuple):
    """A command as the actuators take it: thrust [N] and body rates [rad/s, FRD]."""

    thrust: Real
    """[N], along minus z of the body."""
    rates: Vec3
    """About x forward, y right, z down [rad/s, FRD]."""


def schedule(
    drives: deque[tuple[float, ActuatorCommand]],
    vehicle: Vehicle,
    seen_s: float,
    drive: ActuatorCommand,
) -> float:
    """Put ``drive``, which the actuators see at ``seen_s`` [s], into ``drives``: what acts from
    which instant on.

    It replaces what was to act later: thrust from thrust_delay_s on, rates from rate_delay_s on;
    between the two the other keeps its older commands. Return the instant from which on anything
    has changed [s].
    """
    thrust_s, rates_s = seen_s + vehicle.thrust_delay_s, seen_s + vehicle.rate_delay_s
    if thrust_s == rates_s:
        while drives and drives[-1][0] >= thrust_s:
            drives.pop()
        drives.append((thrust_s, drive))
        return thrust_s
    first_s, last_s = min(thrust_s, rates_s), max(thrust_s, rates_s)
    between: list[tuple[float, ActuatorCommand]] = []
    while drives and drives[-1][0] >= first_s:
        time_s, other = drives.pop()
        if time_s < last_s:
            between.insert(0, (time_s, other))
    if not between or between[0][0] > first_s:
        between.insert(0, (first_s, drives[-1][1] if drives else drive))
    for time_s, other in between:
        drives.append(
            (
                time_s,
                drive._replace(rates=other.rates)
                if thrust_s < rates_s
                else other._replace(rates=drive.rates),
            )
        )
    drives.append((last_s, drive))
    return first_s


class ActuatorResponse(msgspec.Struct, frozen=True, gc=False):
    """Response of thrust, rates and attitude to commands since an interval began, and the integrals
    of the thrust.
    """

    attitude: Quat
    """Unit quaternion w, x, y, z, body FRD to world NED."""
    thrust: Real
    """[N]"""
    rates: Vec3
    """[rad/s, FRD]"""
    impulse: Vec3
    """∫ T R e3 dt [N s, NED]."""
    reach: Vec3
    """∫∫ T R e3 dt dt [N s², NED]."""


def begin_response(motion: Motion) -> ActuatorResponse:
    """Return the response at ``motion``, before any command has acted."""
    return ActuatorResponse(motion.attitude, motion.thrust, motion.rates, ZERO, ZERO)


def integrate_actuators(
    ops: Ops,
    before: ActuatorResponse,
    drive: ActuatorCommand,
    duration: Real,
    thrust_lag: float,
    rate_lag: float,
) -> ActuatorResponse:
    """Integrate the actuators from ``before`` for ``duration`` [s] of ``drive``, through the lags
    [s].

    The lags are exact; attitude turns by the exact integral of the rates; what thrust gives is its
    exact integral along the attitude at mid-step, so the error is of third order in ``duration``
    (keep it below 25 ms).
    """
    h, half, attitude = duration, 0.5 * duration, before.attitude
    rate_rise, half_rise = approach(ops, h, rate_lag), approach(ops, half, rate_lag)
    thrust_rise = approach(ops, h, thrust_lag)
    missing = subtract(drive.rates, before.rates)
    # ∫ω dt = h ω_c - τ (1 - e^(-h/τ)) (ω_c - ω_0), ω_c commanded, ω_0 at the begin.
    a, b, c = add_scaled(scale(half, drive.rates), -rate_lag * half_rise, missing)
    # R e3 at mid-step: e3 rotated by (a, b, c) to second order, in the world.
    down = to_world(attitude, (b + 0.5 * a * c, 0.5 * b * c - a, 1.0 - 0.5 * (a * a + b * b)))
    step = drive.thrust - before.thrust
    impulse = scale(h * drive.thrust - thrust_lag * thrust_rise * step, down)
    return ActuatorResponse(
        rotate(attitude, add_scaled(scale(h, drive.rates), -rate_lag * rate_rise, missing)),
        before.thrust + thrust_rise * step,
        add_scaled(before.rates, rate_rise, missing),
        add(before.impulse, impulse),
        add_scaled(add_scaled(before.reach, h, before.impulse), half, impulse),
    )


def integrate_motion(
    motion: Motion,
    after: ActuatorResponse,
    duration: Real,
    mass: Real,
    other: Vec3,
    other_rate: Vec3 = ZERO,
    drag: float = 0.0,
) -> Motion:
    """Integrate ``motion`` for ``duration`` [s] in which the actuators responded by ``after``.

    Args:
        motion: motion at the begin of the interval.
        after: response to the commands at its end.
        duration: its length [s].
        mass: [kg].
        other: all other acceleration, gravity and wind, at the beginning [m/s², NED]; exact,
            whatever the duration.
        other_rate: its time derivative [m/s³, NED].
        drag: linear drag c, -c v on top of it [1/s]; off by the third order of c ``duration``.
    """
    h, half, per_kg = duration, 0.5 * duration, -1.0 / mass
    pushed = add_scaled(motion.position, per_kg, after.reach)
    speed = add_scaled(motion.velocity, half, add_scaled(other, h / 3.0, other_rate))
    position = add_scaled(pushed, h, speed)
    velocity = add_scaled(
        add_scaled(motion.velocity, per_kg, after.impulse), h, add_scaled(other, half, other_rate)
    )
    if drag:
        # ∫v dt is the way itself; ∫∫v dt dt by the way and the speed at its beginning, exact for a
        # steady push.
        free = subtract(position, motion.position)
        way = add_scaled(
            add_scaled(free, -drag * h / 3.0, free), -drag * h * h / 6.0, motion.velocity
        )
        position, velocity = add(motion.position, way), add_scaled(velocity, -drag, way)
    return Motion(position, velocity, after.attitude, after.thrust, after.rates)


def integrate(
    ops: Ops,
    motion: Motion,
    drive: ActuatorCommand,
    duration: Real,
    *,
    mass: Real,
    gravity: float,
    disturbance: Vec3,
    thrust_lag: float,
    rate_lag: float,
    drag: float = 0.0,
) -> Motion:
    """Integrate ``motion`` for ``duration`` [s] of one ``drive``, a constant ``disturbance``
    [m/s², NED], and drag.
    """
    x, y, z = disturbance
    after = integrate_actuators(ops, begin_response(motion), drive, duration, thrust_lag, rate_lag)
    return integrate_motion(motion, after, duration, mass, (x, y, z + gravity), ZERO, drag)


def approach(ops: Ops, duration: Real, lag: float) -> Real:
    """Return the step response of a lag [s] after ``duration`` [s]: 1 - e^(-h/τ)."""
    return 1.0 - ops.exp(-duration / lag) if lag > 0.0 else 1.0


def lead(ops: Ops, hold: Real, lag: float) -> Real:
    """Inverse of the lag for a command held ``hold`` seconds: x_cmd = x + lead · x˙ makes x rise by
    hold · x˙.

    h/(1 - e^(-h/τ)) → τ for h → 0; h where there is no lag. With τ instead only 0.8-0.9 of a step
    arrives.
    """
    return hold / approach(ops, hold, lag)
