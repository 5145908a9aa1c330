"""Shapes: circle, figure of eight and excitation, how often they are flown, and the table of all
kinds.

A closed curve may lie in any plane: the level one is turned about a level line through its middle.
One kind is a trajectory of the user's own, loaded by name:
``trajectory.kind = "package.module:factory"``.
"""

import inspect
import math
from collections.abc import Sequence
from contextlib import suppress
from itertools import chain, pairwise
from numbers import Real
from typing import Annotated, Any, NamedTuple, TypeAlias

import msgspec

from groundstation.config import (
    FACTORY,
    MAKING_LIMIT_S,
    STEP_LIMIT_S,
    STEP_WATCH,
    ConfigError,
    OpenFactory,
    Option,
    UserCodeFault,
    call_factory,
    config_notice,
    coroutine_hint,
    describe_error,
    find_object,
    needed_names,
)
from groundstation.core.geometry import Coordinate, Vec3
from groundstation.core.trajectory.paced import Paced, check_ramp
from groundstation.core.trajectory.reference import (
    LOOKED_AT_S,
    Acceleration,
    Degrees,
    Endless,
    Length,
    PeriodicTrajectory,
    Point,
    Positioned,
    Ramp,
    Reference,
    Speed,
    Trajectory,
)
from groundstation.core.trajectory.waypoints import SamplesConfig, WaypointsConfig

KEY = "trajectory.kind"


class OwnTrajectoryConfig(
    OpenFactory,
    msgspec.Struct,
    frozen=True,
    kw_only=True,
    forbid_unknown_fields=True,
    tag_field="kind",
    tag="custom",
):
    """A factory and its options. Written shorter: ``kind = "package.module:factory"``, options
    beside it.
    """

    factory: Annotated[
        str,
        msgspec.Meta(
            pattern=FACTORY,
            description="Where the trajectory comes from: `package.module:factory`, called as "
            "factory(options) or factory(), whose result has at(time_s) -> Reference; "
            "or a function of the time [s] that returns the Reference itself.",
        ),
    ]
    options: Annotated[dict[str, Option], msgspec.Meta(description="What the factory gets.")] = (
        msgspec.field(default_factory=dict)
    )

    def build(self) -> Trajectory:
        """The user's trajectory.

        Raises:
            ConfigError: it can't be imported, is not there, fails, or makes no trajectory.
        """
        found = find_object(KEY, self.factory)
        needed = needed_names(found, self.options) if inspect.isroutine(found) else None
        if needed is not None and len(needed) == 1 and needed != ["options"]:
            return OwnTrajectory(found, found, self.factory)
        made = call_factory(KEY, self.factory, found, (), self.options)
        if not callable(getattr(made, "at", None)):
            raise ConfigError(
                KEY,
                config_notice("trajectory.no_at", factory=self.factory, type=type(made).__name__),
            )
        return OwnTrajectory(made, made.at, self.factory)


class OwnTrajectory(Positioned):
    """A user's curve with the missing parts of :class:`Trajectory`.

    An invalid reference ends the flight.
    """

    def __init__(self, curve: Any, at: Any, name: str) -> None:
        """``at`` returns references.

        ``curve`` may have times of its end and joints, ``name`` is for the operator.

        Raises:
            ConfigError: it returns no reference for its beginning, or has invalid times.
        """
        self._at, self._name = at, name
        self.duration_s = self._time_of(curve, "duration_s")
        """Time at which it comes to rest at its last point [s]; None where it never ends, or that
        is not given."""
        end = self.duration_s or self._time_of(curve, "period_s") or LOOKED_AT_S
        self.joints_s: Sequence[float] = self._joints_of(curve, (0.0, end))
        """Its own joints, or its beginning and its end, one turn, or ``LOOKED_AT_S`` [s]."""
        try:
            self._reference(0.0, MAKING_LIMIT_S)  # it may be compiled at its first call
        except UserCodeFault as fault:
            raise ConfigError(KEY, str(fault)) from fault.__cause__

    def _read(self, curve: Any, name: str) -> Any:
        """Return the attribute ``name`` of ``curve``, which may be computed.

        None where there is none.
        """
        try:
            return STEP_WATCH.get().run(self._name, MAKING_LIMIT_S, getattr, curve, name, None)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            failed = config_notice("trajectory.attribute", name=self._name, attribute=name)
            raise ConfigError(
                KEY, config_notice("value.refused", value=failed, why=describe_error(error))
            ) from error

    def _time_of(self, curve: Any, name: str) -> float | None:
        value = self._read(curve, name)
        if value is None:
            return None
        if not isinstance(value, Real) or not 0.0 <= float(value) < math.inf:
            raise ConfigError(
                KEY,
                config_notice("trajectory.seconds", name=self._name, attribute=name, found=value),
            )
        return float(value)

    def _joints_of(self, curve: Any, ends: Sequence[float]) -> Sequence[float]:
        value = self._read(curve, "joints_s")
        if value is None:
            return ends
        with suppress(TypeError):
            joints = [float(time_s) for time_s in value if math.isfinite(time_s)]
            if len(joints) == len(value) >= len(ends) and all(a < b for a, b in pairwise(joints)):
                return joints
        raise ConfigError(KEY, config_notice("trajectory.joints", name=self._name, found=value))

    def at(self, time_s: float) -> Reference:
        """The reference ``time_s`` after the start [s].

        Numbers may be any that Python makes floats of.

        Raises:
            UserCodeFault: the user's code failed, or this is no reference of finite numbers.
        """
        return self._reference(time_s, STEP_LIMIT_S)

    def _reference(self, time_s: float, limit_s: float) -> Reference:
        is_over = self.duration_s is not None and time_s >= self.duration_s
        what = f"trajectory {self._name}"
        try:
            found = STEP_WATCH.get().run(
                what, limit_s, self._at, self.duration_s if is_over else time_s
            )
        except KeyboardInterrupt:
            raise  # Ctrl-C
        except BaseException as error:  # a SystemExit must not end a flight either
            raise UserCodeFault(what, error) from error
        if not isinstance(found, Reference):
            hint = (
                " (a factory's argument must be called options)"
                if hasattr(found, "at")
                else coroutine_hint(found)
            )
            kind = type(found).__name__
            raise UserCodeFault(
                config_notice("code.returned", what=what, type=kind, wanted="Reference", hint=hint)
            )
        try:
            vectors = (
                found.position_ned,
                found.velocity_ned,
                found.acceleration_ned,
                found.jerk_ned,
            )
            # isfinite refuses text, which float would take.
            finite = all(
                map(math.isfinite, (found.yaw_rad, found.yaw_rate_rad_s, *chain(*vectors)))
            )
            position, *derivatives = [(float(x), float(y), float(z)) for x, y, z in vectors]
            yaw, yaw_rate = float(found.yaw_rad), float(found.yaw_rate_rad_s)
        except (OverflowError, TypeError, ValueError):
            raise UserCodeFault(
                config_notice("trajectory.vectors", what=what, found=found)
            ) from None
        if not finite:
            raise UserCodeFault(
                config_notice("trajectory.not_finite", what=what, found=found, time_s=time_s)
            )
        if is_over:
            return Reference(position, yaw_rad=yaw)
        velocity, acceleration, jerk = derivatives
        return Reference(position, velocity, acceleration, jerk, yaw, yaw_rate)


class Tilted:
    """Closed curve whose side towards one bearing is raised.

    See :class:`Trajectory` for ``at`` and ``position_at``.
    """

    def __init__(
        self, curve: PeriodicTrajectory, middle_ned: Vec3, tilt_rad: float, uphill_rad: float
    ) -> None:
        """Raise the side at bearing ``uphill_rad`` by ``tilt_rad``.

        The curve is level at the height of its middle.
        """
        self._curve = curve
        self._middle = middle_ned
        self._north, self._east = math.cos(uphill_rad), math.sin(uphill_rad)
        self._shrink, self._rise = math.cos(tilt_rad) - 1.0, -math.sin(tilt_rad)

    @property
    def duration_s(self) -> float | None:
        """As the curve's."""
        return self._curve.duration_s

    @property
    def period_s(self) -> float:
        """As the curve's."""
        return self._curve.period_s

    @property
    def joints_s(self) -> Sequence[float]:
        """As the curve's."""
        return self._curve.joints_s

    def position_at(self, time_s: float) -> Vec3:
        """Position [m], world NED."""
        return self._point(self._curve.position_at(time_s))

    def at(self, time_s: float) -> Reference:
        """The reference ``time_s`` after the start [s]."""
        level = self._curve.at(time_s)
        return Reference(
            self._point(level.position_ned),
            self._tilt(level.velocity_ned),
            self._tilt(level.acceleration_ned),
            self._tilt(level.jerk_ned),
            level.yaw_rad,
            level.yaw_rate_rad_s,
        )

    def _point(self, point: Vec3) -> Vec3:
        north, east, down = self._middle
        x, y, z = self._tilt((point[0] - north, point[1] - east, 0.0))
        return (north + x, east + y, down + z)

    def _tilt(self, level: Vec3) -> Vec3:
        uphill = level[0] * self._north + level[1] * self._east
        more = self._shrink * uphill
        return (level[0] + more * self._north, level[1] + more * self._east, self._rise * uphill)


class Laps(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Keys of every closed curve.

    Without them it is level, at full speed from the start, and never ends.
    """

    laps: Annotated[
        Annotated[int, msgspec.Meta(ge=1, le=100_000)] | None,
        msgspec.Meta(
            description="Whole turns to fly, then it rests where it began; needs `ramp_s`. Without "
            "it, it never ends."
        ),
    ] = None
    ramp_s: Annotated[
        Ramp,
        msgspec.Meta(
            description="From rest to full speed in this time, and back to rest at the end [s]; 0: "
            "at full speed at once."
        ),
    ] = 0.0
    tilt_deg: Annotated[
        float,
        msgspec.Meta(
            ge=-90.0,
            le=90.0,
            description="Turns the figure out of the level plane, about its middle [deg]; 90 is "
            "upright.",
        ),
    ] = 0.0
    uphill_deg: Annotated[
        Degrees,
        msgspec.Meta(
            description="Bearing of the side that `tilt_deg` raises [deg], from north towards east."
        ),
    ] = 0.0

    def __post_init__(self) -> None:
        if self.laps is not None and self.ramp_s == 0.0:
            raise ValueError(config_notice("trajectory.no_ramp"))
        check_ramp(self.ramp_s, math.inf if self.laps is None else self.laps * self.lap_s)

    @property
    def lap_s(self) -> float:
        """Time of one turn at full speed [s]."""
        raise NotImplementedError

    def pace_and_tilt(self, curve: PeriodicTrajectory, middle_ned: Vec3) -> PeriodicTrajectory:
        """The level ``curve``, as these keys have it.

        Its plane is turned about ``middle_ned`` [m].
        """
        if self.ramp_s > 0.0:
            length_s = None if self.laps is None else self.laps * curve.period_s
            curve = Paced(curve, self.ramp_s, length_s, curve.period_s)
        if self.tilt_deg != 0.0:
            curve = Tilted(
                curve, middle_ned, math.radians(self.tilt_deg), math.radians(self.uphill_deg)
            )
        return curve


class CircleConfig(
    Laps, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="circle"
):
    """A circle at constant speed, level unless it is tilted."""

    radius_m: Annotated[Length, msgspec.Meta(description="Radius [m].")] = 1.0
    speed_m_s: Annotated[Speed, msgspec.Meta(description="Speed along the circle [m/s].")] = 0.5
    altitude_m: Annotated[
        Coordinate, msgspec.Meta(description="Height above `centre_ned` [m].")
    ] = 1.0
    centre_ned: Annotated[
        Point, msgspec.Meta(description="The point below the middle of the circle [m], world NED.")
    ] = (0.0, 0.0, 0.0)
    start_deg: Annotated[
        Degrees,
        msgspec.Meta(
            description="Where on the circle it starts: bearing from the centre [deg], from north "
            "towards east."
        ),
    ] = 0.0
    clockwise: Annotated[
        bool,
        msgspec.Meta(
            description="Turn from north towards east (seen from above), or the other way."
        ),
    ] = True
    yaw_deg: Annotated[
        Degrees, msgspec.Meta(description="Heading [deg], from north towards east; it stays.")
    ] = 0.0

    @property
    def lap_s(self) -> float:
        """Time of one turn at full speed [s]."""
        return 2.0 * math.pi * self.radius_m / self.speed_m_s

    def build(self) -> PeriodicTrajectory:
        """The trajectory of this config."""
        north, east, down = self.centre_ned
        return self.pace_and_tilt(Circle(self), (north, east, down - self.altitude_m))


class Circle(Endless):
    """pd = centre + r (cos θ, sin θ), θ = θ0 ± (V/r) t.

    See :class:`Trajectory` for ``at`` and ``position_at``.
    """

    def __init__(self, config: CircleConfig) -> None:
        self._north, self._east, down = config.centre_ned
        self._down = down - config.altitude_m
        self._radius = config.radius_m
        self._start = math.radians(config.start_deg)
        self._yaw = math.radians(config.yaw_deg)
        self.period_s = config.lap_s
        self._rate = config.speed_m_s / config.radius_m * (1.0 if config.clockwise else -1.0)

    def position_at(self, time_s: float) -> Vec3:
        """Position [m], world NED."""
        angle = self._start + self._rate * math.remainder(time_s, self.period_s)
        radius = self._radius
        return (
            self._north + radius * math.cos(angle),
            self._east + radius * math.sin(angle),
            self._down,
        )

    def at(self, time_s: float) -> Reference:
        """The reference ``time_s`` after the start [s]."""
        # Whole turns are taken off the time, exactly, so that hours of flight cost no digits.
        rate = self._rate
        angle = self._start + rate * math.remainder(time_s, self.period_s)
        x, y = self._radius * math.cos(angle), self._radius * math.sin(angle)
        rate2 = rate * rate
        rate3 = rate2 * rate
        return Reference(
            (self._north + x, self._east + y, self._down),
            (-rate * y, rate * x, 0.0),
            (-rate2 * x, -rate2 * y, 0.0),
            (rate3 * y, -rate3 * x, 0.0),
            self._yaw,
        )


def _landen() -> tuple[float, tuple[float, ...]]:
    """Return 2^N a_N, and the ratios c_n/a_n for n = N..1, of the arithmetic-geometric mean for m =
    -1.
    """
    a, b = 1.0, math.sqrt(2.0)
    c = (a - b) / 2.0
    factor = 1.0
    ratios: list[float] = []
    while abs(c) > 1e-17:
        a, b = (a + b) / 2.0, math.sqrt(a * b)
        factor *= 2.0
        ratios.append(c / a)
        # (a - b)/2 of the next step, without its cancellation.
        c = c * c / (2.0 * (a + b))
    return factor * a, tuple(reversed(ratios))


_FACTOR, _RATIOS = _landen()
_QUARTER: float = math.pi / 2.0 * 2 ** len(_RATIOS) / _FACTOR
"""K(-1), a quarter of the period in u: am(K) = π/2."""


class LemniscateConfig(
    Laps, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="lemniscate"
):
    """A figure of eight at constant speed, level unless it is tilted."""

    scale_m: Annotated[
        Length, msgspec.Meta(description="From the crossing to the far end of a lobe [m].")
    ] = 1.0
    speed_m_s: Annotated[Speed, msgspec.Meta(description="Speed along the curve [m/s].")] = 0.5
    altitude_m: Annotated[
        Coordinate, msgspec.Meta(description="Height above `centre_ned` [m].")
    ] = 1.0
    rotation_deg: Annotated[
        Degrees,
        msgspec.Meta(
            description="Turns the figure about down [deg], from north towards east; at 0 its "
            "lobes lie east and west."
        ),
    ] = -45.0
    centre_ned: Annotated[
        Point, msgspec.Meta(description="The point below the crossing [m], world NED.")
    ] = (0.0, 0.0, 0.0)
    yaw_deg: Annotated[
        Degrees, msgspec.Meta(description="Heading [deg], from north towards east; it stays.")
    ] = 0.0

    @property
    def lap_s(self) -> float:
        """Time of one turn at full speed [s]."""
        return 4.0 * _QUARTER * self.scale_m / self.speed_m_s

    def build(self) -> PeriodicTrajectory:
        """The trajectory of this config."""
        north, east, down = self.centre_ned
        return self.pace_and_tilt(Lemniscate(self), (north, east, down - self.altitude_m))


class Lemniscate(Endless):
    """Figure of eight at constant speed, the trajectory of the paper's experiment.

    See the port for its methods.

        pd = Rz(rotation) [ sinφ cosφ, cosφ ] / (1 + sin²φ) · scale,    φ˙ = (V/scale) √(1 + sin²φ),
                                                                        φ(0) = 0

    (the paper prints sin² t, whose speed is not constant). In u = V t / scale the solution is the
    Jacobi amplitude φ = am(u | m = -1). It comes from the arithmetic-geometric mean and the
    descending Landen transformation (Abramowitz & Stegun 16.4), exact to rounding, with nothing to
    integrate.

    With s = sinφ, c = cosφ, d = √(1 + s²):  ds/du = c d,  dc/du = -s d,  dd/du = s c.  Hence, all
    per unit of scale:
        unit tangent  T = (1 - 3s², -s (3 - s²)) / d³        (the speed is V)
        curvature     κ = -3 c / d,   dκ/du = 6 s / d²
        dT/du = κ N,  d²T/du² = κ' N - κ² T,                 N = T turned by +90° about down
    """

    def __init__(self, config: LemniscateConfig) -> None:
        self._north, self._east, down = config.centre_ned
        self._down = down - config.altitude_m
        self._scale = config.scale_m
        self._speed = config.speed_m_s
        self._cos = math.cos(math.radians(config.rotation_deg))
        self._sin = math.sin(math.radians(config.rotation_deg))
        self._yaw = math.radians(config.yaw_deg)
        self._rate = _FACTOR * config.speed_m_s / config.scale_m
        self.period_s = config.lap_s

    def _amplitude(self, time_s: float) -> float:
        """φ [rad], less whole turns."""
        # Whole periods are taken off the time, exactly, so that hours of flight cost no digits.
        phi = self._rate * math.remainder(time_s, self.period_s)
        asin, sin = math.asin, math.sin
        for ratio in _RATIOS:
            phi = 0.5 * (phi + asin(ratio * sin(phi)))
        return phi

    def position_at(self, time_s: float) -> Vec3:
        """Position [m], world NED."""
        phi = self._amplitude(time_s)
        s = math.sin(phi)
        y = self._scale * math.cos(phi) / (1.0 + s * s)
        x = s * y
        return (
            self._north + self._cos * x - self._sin * y,
            self._east + self._sin * x + self._cos * y,
            self._down,
        )

    def at(self, time_s: float) -> Reference:
        """The reference ``time_s`` after the start [s]."""
        phi = self._amplitude(time_s)
        s, c = math.sin(phi), math.cos(phi)
        cos, sin, scale, speed = self._cos, self._sin, self._scale, self._speed
        s2 = s * s
        d2 = 1.0 / (1.0 + s2)
        d1 = math.sqrt(d2)
        d3 = d1 * d2
        y = scale * c * d2
        x = s * y
        tx, ty = (1.0 - 3.0 * s2) * d3, s * (s2 - 3.0) * d3
        north, east = cos * tx - sin * ty, sin * tx + cos * ty
        kappa = -3.0 * c * d1
        centripetal = speed * speed / scale * kappa
        along = -kappa * kappa
        across = 6.0 * s * d2
        jerk = speed * speed * speed / (scale * scale)
        return Reference(
            (self._north + cos * x - sin * y, self._east + sin * x + cos * y, self._down),
            (speed * north, speed * east, 0.0),
            (-centripetal * east, centripetal * north, 0.0),
            (jerk * (along * north - across * east), jerk * (along * east + across * north), 0.0),
            self._yaw,
        )


SINES_PER_AXIS = 10
"""Largest number of sines on an axis [-]. Chosen."""
PEAK_SAMPLES = 16
"""Samples within the period of the fastest sine among which the peak is found [-]: the true peak is
larger by 1 - cos(π / 16) = 2 % at most."""

LEAST_SINES = 8
"""Least number of sines in all [-]: two for each axis, and for the heading."""

Frequency = Annotated[float, msgspec.Meta(ge=0.05, le=10.0)]
LEAST_SWING_DEG = 1.6
"""Least swing of the heading, except 0 [deg]: a smaller number is in radians, of which 90° has
1.57."""


class ExcitationConfig(
    msgspec.Struct,
    frozen=True,
    kw_only=True,
    forbid_unknown_fields=True,
    tag_field="kind",
    tag="excitation",
):
    """Motions of many frequencies about a point, to identify the vehicle from their recording."""

    position_ned: Annotated[
        Point,
        msgspec.Meta(
            description="The point about which it moves [m], world NED; 1 m up is -1 in the third "
            "place."
        ),
    ] = (0.0, 0.0, -1.0)
    acceleration_m_s2: Annotated[
        Acceleration,
        msgspec.Meta(
            description="Largest acceleration [m/s²]; at the frequencies below it keeps within 0.2 "
            "m of the point on each axis."
        ),
    ] = 3.0
    lowest_hz: Annotated[
        Frequency,
        msgspec.Meta(description="Slowest sine [Hz]; gusts are slower, and take more room."),
    ] = 0.4
    highest_hz: Annotated[
        Frequency,
        msgspec.Meta(
            description="Fastest sine [Hz]; best for lags is 1/(2 pi lag), where body rates allow "
            "it."
        ),
    ] = 1.6
    yaw_swing_deg: Annotated[
        float,
        msgspec.Meta(
            ge=0.0,
            le=90.0,
            description="How far the heading swings to either side [deg]; 0 leaves the lag of the "
            "yaw rate unknown.",
        ),
    ] = 10.0
    yaw_deg: Annotated[
        Degrees, msgspec.Meta(description="Heading in the middle [deg], from north towards east.")
    ] = 0.0
    period_s: Annotated[
        float, msgspec.Meta(ge=5.0, le=100.0, description="After this time it begins anew [s].")
    ] = 20.0
    laps: Annotated[int, msgspec.Meta(ge=1, le=20, description="How many periods are flown.")] = 3
    ramp_s: Annotated[
        float,
        msgspec.Meta(
            ge=1.0,
            le=5.0,
            description="From rest to full speed in this time, and back to rest at the end [s].",
        ),
    ] = 2.0

    def __post_init__(self) -> None:
        if 0.0 < self.yaw_swing_deg < LEAST_SWING_DEG:
            found_deg = self.yaw_swing_deg
            raise ValueError(
                config_notice("trajectory.swing", least_deg=LEAST_SWING_DEG, found_deg=found_deg)
            )
        if len(self.multiples) < LEAST_SINES:
            needed = self.lowest_hz + LEAST_SINES / self.period_s
            raise ValueError(config_notice("trajectory.band", least_hz=needed))

    @property
    def multiples(self) -> range:
        """Frequencies of the band, as multiples of 1/period."""
        first = math.ceil(self.lowest_hz * self.period_s)
        return range(first, math.floor(self.highest_hz * self.period_s) + 1)

    def build(self) -> Paced:
        """The trajectory of this config."""
        return Paced(Excitation(self), self.ramp_s, self.laps * self.period_s, self.period_s)


class Sine(NamedTuple):
    """amplitude · sin(rate · t + phase)."""

    amplitude: float
    """[m or rad]."""
    rate: float
    """[rad/s]."""
    phase: float
    """[rad]."""


class Excitation(Endless, Positioned):
    """The sines at full speed, for ever. See :class:`Trajectory` for ``at`` and ``position_at``.

    Each axis, and the heading, is a sum of sines at whole multiples of 1/period, no two of them at
    the same frequency, so that the effects of the axes can be separated. All sines of an axis have
    the same acceleration; Schroeder's phases (IEEE Trans. Inf. Theory 16, 1970) keep their sum
    flat. The whole is scaled to the configured acceleration.
    """

    def __init__(self, config: ExcitationConfig) -> None:
        self.period_s = config.period_s
        self._middle = config.position_ned
        self._yaw = math.radians(config.yaw_deg)
        multiples = config.multiples
        # North, east, down and heading take turns.
        north, east, down, heading = (_spread(multiples[i::4]) for i in range(4))
        count = PEAK_SAMPLES * multiples[-1]
        samples_s = [config.period_s * i / count for i in range(count)]
        # The same acceleration at every frequency of an axis: it decides what actuators must do.
        axes = [_sines(axis, config.period_s, 2) for axis in (north, east, down)]
        peak = max(math.hypot(*(_sum(sines, t)[2] for sines in axes)) for t in samples_s)
        self._axes = tuple(_scale(sines, config.acceleration_m_s2 / peak) for sines in axes)
        # The same yaw rate at every frequency, of the lower half: others would need a larger yaw
        # rate for the same swing.
        yaws = _sines(heading[: max(1, len(heading) // 2)], config.period_s, 1)
        swing = max(abs(_sum(yaws, t)[0]) for t in samples_s)
        self._yaw_sines = _scale(yaws, math.radians(config.yaw_swing_deg) / swing)

    def at(self, time_s: float) -> Reference:
        """The reference ``time_s`` after the start [s]."""
        # Whole periods are taken off the time, exactly, so that late times cost no digits.
        t = math.remainder(time_s, self.period_s)
        (north, east, down), (x, y, z) = self._middle, (_sum(sines, t) for sines in self._axes)
        yaw = _sum(self._yaw_sines, t)
        return Reference(
            (north + x[0], east + y[0], down + z[0]),
            (x[1], y[1], z[1]),
            (x[2], y[2], z[2]),
            (x[3], y[3], z[3]),
            self._yaw + yaw[0],
            yaw[1],
        )


def _spread(multiples: Sequence[int]) -> Sequence[int]:
    """Return :data:`SINES_PER_AXIS` of them at most, evenly."""
    if len(multiples) <= SINES_PER_AXIS:
        return multiples
    gap = (len(multiples) - 1) / (SINES_PER_AXIS - 1)
    return [multiples[round(i * gap)] for i in range(SINES_PER_AXIS)]


def _sines(multiples: Sequence[int], period_s: float, order: int) -> list[Sine]:
    """Return sines at these multiples of 1/period, whose derivatives of ``order`` have amplitude
    1.
    """
    rates = [2.0 * math.pi * multiple / period_s for multiple in multiples]
    return [Sine(rate**-order, rate, -math.pi * i * i / len(rates)) for i, rate in enumerate(rates)]


def _scale(sines: list[Sine], factor: float) -> tuple[Sine, ...]:
    return tuple(Sine(factor * one.amplitude, one.rate, one.phase) for one in sines)


def _sum(sines: tuple[Sine, ...] | list[Sine], t: float) -> tuple[float, float, float, float]:
    """Return the sum and its first three derivatives at ``t`` [s]."""
    a = b = c = d = 0.0
    for amplitude, w, phase in sines:
        s, k = amplitude * math.sin(w * t + phase), amplitude * math.cos(w * t + phase)
        a, b, c, d = a + s, b + w * k, c - w * w * s, d - w * w * w * k
    return a, b, c, d


class HoldConfig(
    msgspec.Struct,
    frozen=True,
    kw_only=True,
    forbid_unknown_fields=True,
    tag_field="kind",
    tag="hold",
):
    """A point to stay at."""

    position_ned: Annotated[
        Point,
        msgspec.Meta(description="The point [m], world NED; 1 m up is -1 in the third place."),
    ] = (0.0, 0.0, -1.0)
    yaw_deg: Annotated[
        Degrees, msgspec.Meta(description="Heading [deg], from north towards east.")
    ] = 0.0

    def build(self) -> "Hold":
        """The trajectory of this config."""
        return Hold(self.position_ned, math.radians(self.yaw_deg))


class Hold:
    """One reference for all time. See :class:`Trajectory` for ``at`` and ``position_at``."""

    duration_s: float | None = None
    """None: it never ends."""
    joints_s = (0.0,)
    """Its beginning alone: it never changes."""

    def __init__(self, position_ned: Vec3, yaw_rad: float) -> None:
        self._reference = Reference(position_ned, yaw_rad=yaw_rad)

    def position_at(self, time_s: float) -> Vec3:
        """The point [m], world NED."""
        return self._reference.position_ned

    def at(self, time_s: float) -> Reference:
        """The reference at rest."""
        return self._reference


TrajectoryConfig: TypeAlias = (
    CircleConfig
    | ExcitationConfig
    | HoldConfig
    | LemniscateConfig
    | SamplesConfig
    | WaypointsConfig
    | OwnTrajectoryConfig
)
"""Config section ``[trajectory]`` of any ``kind``; ``.build()`` makes the trajectory."""
