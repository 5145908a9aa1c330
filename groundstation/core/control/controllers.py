"""The controllers that can fly: ours, published ones (baselines), and a user's own.

``ControllerConfig`` lists the kinds. A user's own controller is
``controller.kind = "package.module:factory"``.

Baselines are published control laws to compare ours with; they share one inner loop. They fly on
the same estimate as our controller: position, velocity, attitude and modelled thrust at the instant
at which the command acts, and the observer's disturbance d̂. So a comparison with them is one of
control laws.
"""

import inspect
import math
from types import SimpleNamespace
from typing import Annotated, Any, Generic, TypeAlias, TypeVar

import msgspec

from groundstation.config import (
    FACTORY,
    STEP_LIMIT_S,
    STEP_WATCH,
    ConfigError,
    OpenFactory,
    Option,
    UserCodeFault,
    call_factory,
    coroutine_hint,
    find_object,
    needed_names,
)
from groundstation.core.control.adaptive import Adaptive, Gains, Uncompensated
from groundstation.core.control.attitude import (
    acceleration,
    clamp_command,
    half_angle_error,
    length,
    make_decision,
    sine_error,
    specific_thrust,
    turning,
)
from groundstation.core.control.backstepping import clamp_each, compute_yaw_rate
from groundstation.core.control.demand_limits import DemandLimits
from groundstation.core.estimation import (
    AccelerationBound,
    AccelerationGain,
    Estimation,
    FilterTime,
    Gain,
    GainOrOff,
    IntegralGain,
    PositionGain,
    SpeedBound,
)
from groundstation.core.geometry import (
    FLOATS,
    ZERO,
    Vec3,
    add,
    add_scaled,
    scale,
    subtract,
    third_column,
)
from groundstation.core.messages import Controller, Decision, Estimate, notice
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import ActuatorCommand, Vehicle, lead


class Baseline(Estimation, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Keys that every baseline has. "As ours" means: the default of the adaptive controller."""

    k_yaw: Annotated[GainOrOff, msgspec.Meta(description="Heading gain [1/s], as ours.")] = 1.0
    tilt_limit_deg: Annotated[
        float,
        msgspec.Meta(
            ge=2.0,
            le=80.0,
            description="Largest commanded tilt [deg]; PX4's default (MPC_TILTMAX_AIR).",
        ),
    ] = 45.0
    actuator_compensation: Annotated[
        bool,
        msgspec.Meta(
            description="Invert the lags of thrust and body rates, as ours does; off, as the "
            "baselines are published. docs/decisions/0006-baselines.md says what "
            "happens with it, and has the gains for it."
        ),
    ] = False
    k_omega: Annotated[
        Gain,
        msgspec.Meta(
            description="With it: how fast an error of thrust or body rate shall decay [1/s], as "
            "ours."
        ),
    ] = 14.0
    rate_feedforward: Annotated[
        FilterTime,
        msgspec.Meta(
            description="With it: time constant of the filter on the derivative of what is wanted "
            "[s], as ours."
        ),
    ] = 0.03


class InnerLoop:
    """Turns a wanted specific thrust and two body rates into a decision.

    State, for ``actuator_compensation`` alone: the last wanted thrust and rates, and their filtered
    derivatives.
    """

    def __init__(self, vehicle: Vehicle, gains: Baseline) -> None:
        self._vehicle = vehicle
        self._gains = gains
        self._limits = DemandLimits(FLOATS, vehicle)
        lags = (vehicle.thrust_lag_s, *(vehicle.rate_lag_s,) * 3)
        self._leads = [
            lead(FLOATS, vehicle.frame_period_s, lag) if lag > 0.0 else 0.0 for lag in lags
        ]
        self._wanted: list[float] | None = None
        self._slopes = [0.0] * 4

    def decide(
        self,
        estimate: Estimate,
        reference: Reference,
        interval_s: float,
        *,
        specific_thrust: Vec3,
        turn: tuple[float, float],
        disturbance: Vec3,
    ) -> Decision:
        """Decide on the thrust m |F| and the body rates ``turn`` about x and y [rad/s].

        Args:
            estimate: state at the instant at which the command acts.
            reference: reference at that instant.
            interval_s: time since the last command [s].
            specific_thrust: wanted F = (T/m) R e3 [m/s², NED]: points down, as e3 does; the rotors
                accelerate the vehicle by -F.
            turn: wanted body rates about x and y [rad/s].
            disturbance: the controller's own disturbance estimate, for the record [m/s², NED].
        """
        motion, gravity = estimate.motion, self._gains.gravity
        heading = compute_yaw_rate(
            FLOATS,
            motion.attitude,
            reference.yaw_rad,
            reference.yaw_rate_rad_s,
            turn[1],
            self._gains.k_yaw,
            self._limits.rates[2],
        )
        wanted = [
            self._vehicle.mass_kg / estimate.effectiveness * length(specific_thrust),
            *turn,
            heading,
        ]
        if self._gains.actuator_compensation:
            wanted = self._lead([motion.thrust, *motion.rates], wanted, interval_s)
        thrust, x, y, z = wanted
        return make_decision(
            self._vehicle,
            estimate,
            reference,
            thrust,
            (x, y, self._limits.limit_yaw(motion.rates[2], z)),
            wanted=(
                disturbance[0] - specific_thrust[0],
                disturbance[1] - specific_thrust[1],
                gravity + disturbance[2] - specific_thrust[2],
            ),
            disturbance=disturbance,
        )

    def _lead(self, now: list[float], wanted: list[float], interval: float) -> list[float]:
        """Lead thrust and rates so that the true ones follow ``wanted`` (docs/explanation/law.md,
        section 6.4).
        """
        gains, last = self._gains, self._wanted
        if last is not None and interval > 0.0:
            k = interval / (interval + gains.rate_feedforward)
            self._slopes = [
                slope + k * ((new - old) / interval - slope)
                for slope, new, old in zip(self._slopes, wanted, last, strict=True)
            ]
        self._wanted = wanted
        return [
            present + gain * (gains.k_omega * (goal - present) + slope) if gain > 0.0 else goal
            for present, goal, slope, gain in zip(
                now, wanted, self._slopes, self._leads, strict=True
            )
        ]


GainsType = TypeVar("GainsType", bound=Baseline)


class BaselineController(Generic[GainsType]):
    """Base of the baselines: the configured vehicle, the gains, and the inner loop."""

    def __init__(self, vehicle: Vehicle, gains: GainsType) -> None:
        """Start with nothing learnt."""
        self._vehicle = vehicle
        self._gains = gains
        self._inner_loop = InnerLoop(vehicle, gains)


class Geometric(
    Baseline,
    frozen=True,
    kw_only=True,
    forbid_unknown_fields=True,
    tag_field="kind",
    tag="geometric",
):
    """Gains of the geometric law, found by a search: docs/decisions/0006-baselines.md."""

    k_position: Annotated[PositionGain, msgspec.Meta(description="k_x / m [1/s²].")] = 9.46
    k_velocity: Annotated[Gain, msgspec.Meta(description="k_v / m [1/s].")] = 5.81
    k_integral: Annotated[IntegralGain, msgspec.Meta(description="k_i / m [1/s²].")] = 9.74
    coupling: Annotated[
        Gain,
        msgspec.Meta(
            description="c1: share of the position error in the integral of e_v + c1 e_x [1/s]."
        ),
    ] = 1.85
    integral_bound: Annotated[
        AccelerationBound,
        msgspec.Meta(
            description="σ: largest acceleration of the integral term, per axis [m/s²]; as b_bound "
            "of ours."
        ),
    ] = 5.0
    k_attitude: Annotated[
        Gain, msgspec.Meta(description="k_R over k_Ω: body rate per attitude error [1/s].")
    ] = 16.1

    def build(self, vehicle: Vehicle) -> "GeometricController":
        """The controller."""
        return GeometricController(vehicle, self)


class GeometricController(BaselineController[Geometric]):
    """Geometric tracking control on SE(3) with integral action. State: the integral e_i.

    T. Lee, M. Leok, N. H. McClamroch, "Geometric tracking control of a quadrotor UAV on SE(3)", CDC
    2010, with the integral term of F. Goodarzi, D. Lee, T. Lee, "Geometric nonlinear PID control of
    a quadrotor UAV on SE(3)", ECC 2013, per unit of mass. The vehicle takes body rates, not
    moments: of the attitude loop there remain the error e_R and the rate Ω_c at which the wanted
    attitude turns, from exact derivatives as in the paper. Heading has its own loop, as in ours.
    """

    _integral: Vec3 = (0.0, 0.0, 0.0)
    _saturated = False

    def decide(self, estimate: Estimate, reference: Reference, interval_s: float) -> Decision:
        """One command; see the port."""
        gains, motion = self._gains, estimate.motion
        ki, c1, bound = gains.k_integral, gains.coupling, gains.integral_bound
        # The integral pauses while the command is clamped, so that it does not wind up.
        dt = 0.0 if self._saturated else interval_s
        ex = subtract(motion.position, reference.position_ned)
        ev = subtract(motion.velocity, reference.velocity_ned)
        error = add_scaled(ev, c1, ex)
        self._integral = clamp_each(FLOATS, add_scaled(self._integral, dt * ki, error), bound)
        decision = track_on_se3(
            self._vehicle,
            gains,
            self._inner_loop,
            estimate,
            reference,
            interval_s,
            counteracted=self._integral,
            counteracted_dot=scale(ki, error),
        )
        self._saturated = decision.saturated
        return decision


def track_on_se3(
    vehicle: Vehicle,
    gains: "Geometric | L1",
    inner_loop: InnerLoop,
    estimate: Estimate,
    reference: Reference,
    interval_s: float,
    *,
    counteracted: Vec3,
    counteracted_dot: Vec3,
) -> Decision:
    """Decide by geometric tracking (Lee, Leok, McClamroch 2010).

    ``counteracted`` is the disturbance to compensate [m/s², NED], ``counteracted_dot`` its
    derivative [m/s³].
    """
    motion, kx, kv = estimate.motion, gains.k_position, gains.k_velocity
    mass = vehicle.mass_kg / estimate.effectiveness
    now = acceleration(motion, estimate.disturbance, mass, gains.gravity, vehicle.drag_per_s)
    feed = reference.acceleration_ned
    ex = subtract(motion.position, reference.position_ned)
    ev = subtract(motion.velocity, reference.velocity_ned)
    ea = subtract(now, feed)
    feedback = subtract(add_scaled(add_scaled(feed, -kx, ex), -kv, ev), counteracted)
    slope = subtract(add_scaled(add_scaled(reference.jerk_ned, -kx, ev), -kv, ea), counteracted_dot)
    by_drag = scale(-vehicle.drag_per_s, motion.velocity)
    along, _ = specific_thrust(feedback, by_drag, gains.gravity, math.radians(gains.tilt_limit_deg))
    x, y = sine_error(motion.attitude, along)
    wx, wy = turning(motion.attitude, along, scale(-1.0, slope))
    return inner_loop.decide(
        estimate,
        reference,
        interval_s,
        specific_thrust=along,
        turn=(wx + gains.k_attitude * x, wy + gains.k_attitude * y),
        disturbance=counteracted,
    )


class L1(
    Baseline, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="l1"
):
    """Gains: those of the geometric law, and two of the adaptation, which were chosen, not
    searched.
    """

    k_position: Annotated[PositionGain, msgspec.Meta(description="k_x / m [1/s²].")] = 9.46
    k_velocity: Annotated[Gain, msgspec.Meta(description="k_v / m [1/s].")] = 5.81
    predictor_pole: Annotated[
        Gain,
        msgspec.Meta(
            description="-A_s: how fast the predictor forgets its error [1/s]. At commands every "
            "T_s it leaves A_s T_s / 2 of a steady disturbance uncompensated."
        ),
    ] = 1.0
    bandwidth_rad_s: Annotated[
        Gain,
        msgspec.Meta(
            description="ω_c of the low-pass filter C(s) between what is found and what is "
            "counteracted [rad/s]."
        ),
    ] = 8.0
    k_attitude: Annotated[
        Gain, msgspec.Meta(description="k_R over k_Ω: body rate per attitude error [1/s].")
    ] = 16.1

    def build(self, vehicle: Vehicle) -> "L1Controller":
        """The controller."""
        return L1Controller(vehicle, self)


class L1Controller(BaselineController[L1]):
    """L1 adaptive augmentation of the geometric law.

    State: the predictor's velocity, σ̂, and σ̂ filtered.

    Z. Wu, S. Cheng, P. Zhao, A. Gahlawat, K. A. Ackerman, A. Lakshmanan, C. Yang, J. Yu, N.
    Hovakimyan, "L1Quad: L1 adaptive augmentation of geometric control for agile quadrotors with
    performance guarantees", 2023. State predictor v̂˙ = g e3 - (T/m) R e3 + σ̂ + A_s ṽ, ṽ = v̂ - v;
    piecewise-constant adaptation σ̂ = -Φ⁻¹ e^(A_s T_s) ṽ, Φ = A_s⁻¹ (e^(A_s T_s) - 1); counteracted
    is what a low-pass filter C(s) lets through. The vehicle takes body rates, not moments: so the
    predictor is of the velocity alone, and the forces across the thrust, which L1Quad leaves to the
    outer loop, are counteracted by the thrust, too.
    """

    _predicted: Vec3 | None = None  # takes the first velocity that comes
    _filtered: Vec3 = (0.0, 0.0, 0.0)

    def decide(self, estimate: Estimate, reference: Reference, interval_s: float) -> Decision:
        """One command; see the port."""
        gains, motion = self._gains, estimate.motion
        period_s = self._vehicle.frame_period_s  # T_s
        decay = math.exp(-gains.predictor_pole * period_s)  # e^(A_s T_s)
        phi = (1.0 - decay) / gains.predictor_pole
        rise = 1.0 - math.exp(-gains.bandwidth_rad_s * interval_s)
        mass = self._vehicle.mass_kg / estimate.effectiveness
        known = acceleration(motion, ZERO, mass, gains.gravity, self._vehicle.drag_per_s)
        velocity = motion.velocity
        error = subtract(velocity if self._predicted is None else self._predicted, velocity)  # ṽ
        x, y, z = scale(-decay, error)
        sigma = (x / phi, y / phi, z / phi)  # σ̂
        # The predicted velocity at the next command.
        self._predicted = add_scaled(
            add_scaled(add_scaled(velocity, period_s, known), decay, error), phi, sigma
        )
        change = subtract(sigma, self._filtered)
        self._filtered = add_scaled(self._filtered, rise, change)
        return track_on_se3(
            self._vehicle,
            gains,
            self._inner_loop,
            estimate,
            reference,
            interval_s,
            counteracted=self._filtered,
            counteracted_dot=scale(gains.bandwidth_rad_s, change),
        )


class Pid(
    Baseline, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="pid"
):
    """Gains of the PID, found by a search: docs/decisions/0006-baselines.md. In brackets: PX4's
    parameters.
    """

    p_position: Annotated[
        Gain, msgspec.Meta(description="Velocity per position error [1/s] (MPC_XY_P).")
    ] = 2.32
    p_velocity: Annotated[
        Gain, msgspec.Meta(description="Acceleration per velocity error [1/s] (MPC_XY_VEL_P_ACC).")
    ] = 4.69
    i_velocity: Annotated[
        IntegralGain,
        msgspec.Meta(
            description="Acceleration per integral of the velocity error [1/s²] (MPC_XY_VEL_I_ACC)."
        ),
    ] = 6.83
    d_velocity: Annotated[
        AccelerationGain,
        msgspec.Meta(description="Acceleration against acceleration [-] (MPC_XY_VEL_D_ACC)."),
    ] = 0.0164
    speed_limit_m_s: Annotated[
        SpeedBound, msgspec.Meta(description="Largest commanded speed [m/s] (MPC_XY_VEL_MAX).")
    ] = 12.0
    integral_bound: Annotated[
        AccelerationBound,
        msgspec.Meta(
            description="Largest acceleration of the integral, per axis [m/s²]; PX4 has g, upwards "
            "only."
        ),
    ] = 5.0
    p_attitude: Annotated[
        Gain,
        msgspec.Meta(description="Body rate per attitude error [1/s] (MC_ROLL_P, MC_PITCH_P)."),
    ] = 20.0

    def build(self, vehicle: Vehicle) -> "PidController":
        """The controller."""
        return PidController(vehicle, self)


class PidController(BaselineController[Pid]):
    """Cascaded PID, as the position and attitude control of PX4 (main branch of 2024).

    State: the velocity integral.

    Position P → velocity PID with anti-windup → thrust vector, tilt-limited → attitude P on the
    quaternion error → body rates. Velocity and acceleration of the reference are fed forward; PX4
    feeds no attitude rate forward, nor does this.
    """

    _integral: Vec3 = (0.0, 0.0, 0.0)
    _saturated = False

    def decide(self, estimate: Estimate, reference: Reference, interval_s: float) -> Decision:
        """One command; see the port."""
        gains, motion = self._gains, estimate.motion
        mass, drag = self._vehicle.mass_kg / estimate.effectiveness, self._vehicle.drag_per_s
        now = acceleration(motion, estimate.disturbance, mass, gains.gravity, drag)
        error = subtract(self._velocity(motion.position, reference), motion.velocity)
        integral, p, d = self._integral, gains.p_velocity, gains.d_velocity
        wanted = add_scaled(
            add(add_scaled(reference.acceleration_ned, p, error), integral), -d, now
        )
        by_drag = scale(-drag, motion.velocity)
        along, is_limited = specific_thrust(
            wanted, by_drag, gains.gravity, math.radians(gains.tilt_limit_deg)
        )
        if not (is_limited or self._saturated):  # else it would wind up
            grown = add_scaled(integral, interval_s * gains.i_velocity, error)
            self._integral = clamp_each(FLOATS, grown, gains.integral_bound)
        x, y = half_angle_error(motion.attitude, along)
        decision = self._inner_loop.decide(
            estimate,
            reference,
            interval_s,
            specific_thrust=along,
            turn=(gains.p_attitude * x, gains.p_attitude * y),
            disturbance=scale(-1.0, integral),
        )
        self._saturated = decision.saturated
        return decision

    def _velocity(self, position: Vec3, reference: Reference) -> Vec3:
        """The wanted velocity [m/s, NED], no faster than the limit."""
        error = subtract(reference.position_ned, position)
        goal = add_scaled(reference.velocity_ned, self._gains.p_position, error)
        # 1e-9: not 0.
        return scale(min(1.0, self._gains.speed_limit_m_s / (length(goal) + 1e-9)), goal)


class Indi(
    Baseline, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="indi"
):
    """Gains of INDI, found by a search: docs/decisions/0006-baselines.md."""

    k_position: Annotated[PositionGain, msgspec.Meta(description="K_x [1/s²].")] = 17.8
    k_velocity: Annotated[Gain, msgspec.Meta(description="K_v [1/s].")] = 6.36
    k_acceleration: Annotated[AccelerationGain, msgspec.Meta(description="K_a [-].")] = 0.95
    filter_s: Annotated[
        FilterTime,
        msgspec.Meta(
            description="Time constant of the low-pass filter on acceleration and thrust vector "
            "[s]."
        ),
    ] = 0.0041
    k_attitude: Annotated[Gain, msgspec.Meta(description="Body rate per attitude error [1/s].")] = (
        18.3
    )

    def build(self, vehicle: Vehicle) -> "IndiController":
        """The controller."""
        return IndiController(vehicle, self)


class IndiController(BaselineController[Indi]):
    """Incremental nonlinear dynamic inversion of the acceleration.

    State: filtered acceleration and thrust vector.

    E. Tal, S. Karaman, "Accurate tracking of aggressive quadrotor trajectories using incremental
    nonlinear dynamic inversion and differential flatness", CDC 2018 / TCST 2021: the thrust vector
    is changed by the error of the acceleration, both through the same low-pass filter; the attitude
    follows by proportional control, with the reference's jerk as feedforward of the body rates.
    There is no accelerometer here: the acceleration is the model's, with the observer's
    disturbance.
    """

    _acceleration: Vec3 | None = None  # both filters start at their first values
    _thrust: Vec3 = (0.0, 0.0, 0.0)

    def decide(self, estimate: Estimate, reference: Reference, interval_s: float) -> Decision:
        """One command; see the port."""
        gains, motion = self._gains, estimate.motion
        filtered, thrust = self._filter(estimate, interval_s)
        kx = gains.k_position
        kv = gains.k_velocity
        ka = gains.k_acceleration
        feed = reference.acceleration_ned
        wanted = add_scaled(feed, kx, subtract(reference.position_ned, motion.position))
        wanted = add_scaled(wanted, kv, subtract(reference.velocity_ned, motion.velocity))
        wanted = add_scaled(wanted, ka, subtract(feed, filtered))
        # The increment: the thrust vector changes by the error of the acceleration.
        # `specific_thrust` limits the tilt.
        error, base = subtract(wanted, filtered), subtract(thrust, (0.0, 0.0, gains.gravity))
        along, _ = specific_thrust(error, base, gains.gravity, math.radians(gains.tilt_limit_deg))
        x, y = half_angle_error(motion.attitude, along)
        wx, wy = turning(motion.attitude, along, scale(-1.0, reference.jerk_ned))
        return self._inner_loop.decide(
            estimate,
            reference,
            interval_s,
            specific_thrust=along,
            turn=(wx + gains.k_attitude * x, wy + gains.k_attitude * y),
            disturbance=estimate.disturbance,
        )

    def _filter(self, estimate: Estimate, interval: float) -> tuple[Vec3, Vec3]:
        """Acceleration and thrust vector (T/m) R e3 [m/s², NED], both through the same first-order
        filter.
        """
        motion, mass = estimate.motion, self._vehicle.mass_kg / estimate.effectiveness
        now = acceleration(
            motion, estimate.disturbance, mass, self._gains.gravity, self._vehicle.drag_per_s
        )
        thrust = scale(motion.thrust / mass, third_column(motion.attitude))
        before = self._acceleration
        if before is not None and self._gains.filter_s > 0.0:
            k = interval / (interval + self._gains.filter_s)
            now = add_scaled(before, k, subtract(now, before))
            thrust = add_scaled(self._thrust, k, subtract(thrust, self._thrust))
        self._acceleration, self._thrust = now, thrust
        return now, thrust


KIND_KEY = "controller.kind"
"""Configuration key that errors in a user's own controller name."""


class Custom(
    Estimation,
    OpenFactory,
    frozen=True,
    kw_only=True,
    forbid_unknown_fields=True,
    tag_field="kind",
    tag="custom",
):
    """A user's own controller: a factory and its options.

    The short form in a configuration file is ``kind = "package.module:factory"``, with the options
    beside it.
    """

    factory: Annotated[
        str,
        msgspec.Meta(
            pattern=FACTORY,
            description="Where the controller comes from: `package.module:factory`, called as "
            "factory(vehicle, options) or with as much of it as it needs; or a function "
            "decide(estimate, reference, interval_s) itself.",
        ),
    ]
    options: Annotated[
        dict[str, Option], msgspec.Meta(description="What the factory gets beside the vehicle.")
    ] = msgspec.field(default_factory=dict)

    @property
    def kind(self) -> str:
        """The factory's name."""
        return self.factory

    def build(self, vehicle: Vehicle) -> Controller:
        """The user's controller, within the vehicle's limits.

        Raises:
            ConfigError: the factory can't be imported or called, does not exist, fails, or makes no
                controller.
        """
        found = find_object(KIND_KEY, self.factory)
        if not callable(found) and not hasattr(found, "decide"):
            raise ConfigError(KIND_KEY, notice("controller.not_callable", factory=self.factory))
        controller: Any
        if inspect.isroutine(found) and len(needed_names(found, self.options) or ()) == 3:
            controller = SimpleNamespace(decide=found)  # the function is decide() itself
        else:
            controller = call_factory(KIND_KEY, self.factory, found, (vehicle,), self.options)
        if not callable(getattr(controller, "decide", None)):
            made = type(controller).__name__
            raise ConfigError(
                KIND_KEY, notice("controller.no_decide", factory=self.factory, type=made)
            )
        return Guarded(controller, vehicle, self.factory)


class Guarded:
    """A user's own controller whose commands are clamped to the vehicle's limits.

    An invalid one ends the flight.
    """

    def __init__(self, controller: Controller, vehicle: Vehicle, name: str) -> None:
        """``name`` is for the operator."""
        self._controller = controller
        self._vehicle = vehicle
        self._name = name

    def decide(self, estimate: Estimate, reference: Reference, interval_s: float) -> Decision:
        """Return the controller's decision with a clamped command.

        A bare command is completed to a decision.

        Raises:
            UserCodeFault: the controller failed, or did not return a command of four finite
                numbers.
        """
        who = f"controller {self._name}"
        try:
            decide = self._controller.decide
            decision: Any = STEP_WATCH.get().run(
                who, STEP_LIMIT_S, decide, estimate, reference, interval_s
            )
        except KeyboardInterrupt:
            raise  # the operator stops the program
        except (
            BaseException
        ) as error:  # SystemExit, too: a user's sys.exit() must not end the program in flight
            raise UserCodeFault(who, error) from error
        if isinstance(decision, ActuatorCommand):
            decision = self._make_whole(decision, estimate, reference)
        if not isinstance(decision, Decision):
            kind, hint = type(decision).__name__, coroutine_hint(decision)
            raise UserCodeFault(
                notice("code.returned", what=who, type=kind, wanted="Decision", hint=hint)
            )
        try:
            command = (decision.drive.thrust, *decision.drive.rates)
            # It refuses text, which float() would take for a number.
            is_finite = all(map(math.isfinite, command))
            thrust, x, y, z = map(float, command)
        except (AttributeError, OverflowError, TypeError, ValueError):
            raise UserCodeFault(notice("controller.no_command", what=who)) from None
        if not is_finite:
            raise UserCodeFault(
                notice("controller.not_finite", what=who, thrust=thrust, rates=(x, y, z))
            )
        drive, clamped = clamp_command(self._vehicle, thrust, (x, y, z))
        return decision._replace(drive=drive, saturated=bool(decision.saturated) or clamped)

    def _make_whole(self, drive: ActuatorCommand, estimate: Estimate, reference: Reference) -> Any:
        """Make a decision with ``drive``, which is checked later."""
        still = make_decision(self._vehicle, estimate, reference, 0.0, (0.0, 0.0, 0.0))
        return still._replace(drive=drive, saturated=False)


ControllerConfig: TypeAlias = Gains | Uncompensated | Geometric | L1 | Pid | Indi | Custom
"""Section ``[controller]``: the gains of a controller, chosen by its ``kind``, and the keys of the
estimator."""


def make_controller(config: ControllerConfig, vehicle: Vehicle) -> Controller:
    """Make the controller that ``config`` describes.

    Raises:
        ConfigError: a user's own controller can't be loaded.
    """
    return Adaptive(vehicle, config) if isinstance(config, Gains) else config.build(vehicle)
