"""Quadrotor in time: held, released, flying, on the floor, and as its autopilot sees it.

Its physics are in plant.py.

It advances when it is asked for a later instant, in steps of ``world.step_s`` that begin anew with
every command. An autopilot sits on it through :class:`Airframe`. With ``world.plant = "rotors"``
another autopilot may have the rotors themselves: it steps as long as its own loop, and each time
reads ``truth(now)`` (rates for its gyro) and ``specific_force`` (for its accelerometer), and then
calls ``drive_rotors(now, signals)``.

An autopilot sees a plant behind motors that may be off, and its own estimate. What attitude
estimators are seen to do: between two corrections the estimate turns as the body does, to a
hundredth of a degree; it is off by a few tenths of a degree, which wander over many seconds; and
one that knows no accelerations takes a part of a lean that lasts for level, as a leaning
multirotor's accelerometers show no lean while it accelerates freely.
"""

import copy
import math
from collections import deque
from collections.abc import Callable, Iterator
from itertools import repeat
from typing import Protocol

import msgspec

from groundstation.core.geometry import FLOATS, Quat, Vec3, add_scaled, so3
from groundstation.core.messages import ROUNDING_S
from links.core import thrust
from sim.world.plant import (
    Actuators,
    AirDrag,
    Body,
    FourRotors,
    Physics,
    begin_rotors,
    compute_drag,
    describe_rotors,
    integrate,
    integrate_rotors,
    turn_rotors,
)
from sim.world.world import STILL, Wind, World


class TrueState(msgspec.Struct, frozen=True, gc=False):
    """The exact state of the simulated vehicle at one instant."""

    time_s: float
    """Event loop's clock [s]."""
    position_ned: Vec3
    """[m]"""
    velocity_ned: Vec3
    """[m/s]"""
    attitude: Quat
    """Body FRD to world NED, w first."""
    rates_rad_s: Vec3
    """Body rates, FRD [rad/s]."""
    thrust_n: float
    """Thrust the rotors give now [N]."""
    on_ground: bool
    """True while it rests on the floor (not while it is held in the air)."""
    resets: int = 0
    """Number of times that the measuring estimator has moved its origin or heading."""


class Airframe(Protocol):
    """Motors, body and sensors as the autopilot on board sees them. Times never go backwards."""

    def act(self, time_s: float, thrust_fraction: float, rates_rad_s: Vec3) -> None:
        """Follow a thrust signal (0..1) and body rates [rad/s, FRD] from ``time_s`` on."""

    def power(self, time_s: float, on: bool) -> None:
        """Motors on (armed) or off; off means no thrust whatever ``act`` says."""

    def release(self, time_s: float) -> None:
        """Let go of a vehicle that is held in the air until it obeys; does nothing afterwards."""

    def truth(self, time_s: float) -> TrueState:
        """The exact state at ``time_s``."""

    def measure(self, time_s: float) -> TrueState:
        """True state with the noise of the vehicle's own position estimate."""

    def feel(self, time_s: float) -> tuple[Quat, Vec3]:
        """Attitude and body rates [rad/s] as its own estimator has them, by gyros and
        accelerometers.
        """


HOP_M = 0.005
"""Whoever was not higher than this above the floor has not left it [m]."""
STANDS_RADII = 0.85
"""Height of the rotors of a standing vehicle above the floor, in rotor radii [-]."""
LIFTING_SHARE = 0.2
"""Mean signal of the rotors above which a held vehicle is released [-]. Chosen: above idling, which
is below 0.1."""
LEVELS_S = 0.02
"""Time constant with which the floor levels what comes down tilted [s]."""
NOTICES_S = 0.15
"""Time constant with which an autopilot's own speed finds out that the floor holds it [s]. By a
take-off of ArduCopter's SITL, whose estimate stayed at 0.4 m/s for 0.4 s and then rose to 1.7."""
FORGETS_S = 2.0
"""Time constant with which its own height finds out that the floor holds it [s]."""


class DelayLine:
    """Commands that begin to act some time after they come: a held one's mean over any later
    span.
    """

    def __init__(self, delay_s: float, first: tuple[float, ...]) -> None:
        """Delay commands by ``delay_s`` [s].

        ``first`` acts until the first one has come through.
        """
        self._delay_s = delay_s
        self._now = first
        self._coming: deque[tuple[float, tuple[float, ...]]] = deque()

    def put(self, time_s: float, command: tuple[float, ...]) -> None:
        """A command comes."""
        self._coming.append((time_s + self._delay_s, command))

    def compute_mean(self, start_s: float, span_s: float) -> tuple[float, ...]:
        """Mean of the acting command over ``span_s`` [s] from ``start_s`` on.

        Calls come in order of time.
        """
        coming = self._coming
        while coming and coming[0][0] <= start_s + ROUNDING_S:
            self._now = coming.popleft()[1]
        if not coming or coming[0][0] >= start_s + span_s:
            return self._now
        acting, since, end, mean = self._now, start_s, start_s + span_s, [0.0] * len(self._now)
        for due, command in (*coming, (end, acting)):
            until = min(due, end)
            mean = [m + (until - since) / span_s * x for m, x in zip(mean, acting, strict=True)]
            acting, since = command, until
        return tuple(mean)


class ActuationChain:
    """Way of commanded thrust and rates to those that act: gain, limits and dead times."""

    def __init__(self, world: World, thrust: float) -> None:
        """``thrust`` [N] acts until a command does, where commands act late."""
        self._world = world
        x, y, z = world.rate_limits_deg_s
        self._limits: Vec3 = (math.radians(x), math.radians(y), math.radians(z))
        self.told: tuple[float, Vec3] = (0.0, (0.0, 0.0, 0.0))
        """Newest command: thrust [N] and rates [rad/s, FRD]."""
        self.strength = 1.0
        """Thrust of the rotors, as a share of the healthy ones' [-]."""
        self.gain = world.thrust_gain
        """Thrust that comes of what is told, as a share, at the newest command [-]."""
        self._thrust = 0.0
        self._rates: Vec3 = (0.0, 0.0, 0.0)
        self._late_thrust = (
            DelayLine(world.thrust_delay_s, (thrust,)) if world.thrust_delay_s else None
        )
        self._late_rates = (
            DelayLine(world.rate_delay_s, (0.0, 0.0, 0.0)) if world.rate_delay_s else None
        )

    def command(self, time_s: float, flown_s: float | None, thrust_n: float, rates: Vec3) -> None:
        """Take a command at ``time_s`` [s], so long after the release."""
        self.told = thrust_n, rates
        a, b, c = self._limits
        self.gain = gain = self.compute_gain(flown_s)
        self._thrust = gain * min(max(thrust_n, 0.0), self._world.thrust_max_n)
        self._rates = (
            min(max(rates[0], -a), a),
            min(max(rates[1], -b), b),
            min(max(rates[2], -c), c),
        )
        if self._late_thrust is not None:
            self._late_thrust.put(time_s, (self._thrust,))
        if self._late_rates is not None:
            self._late_rates.put(time_s, self._rates)

    def compute_gain(self, flown_s: float | None) -> float:
        """Thrust that comes of what is told, as a share, so long after the release: batteries
        sag.
        """
        gain, sag = self.strength * self._world.thrust_gain, self._world.thrust_sag
        if sag and flown_s is not None:
            gain *= 1.0 - sag * min(1.0, flown_s / 60.0)
        return gain

    def compute_mean(self, start_s: float, span_s: float) -> tuple[float, Vec3]:
        """Mean of thrust [N] and rates [rad/s] that act over ``span_s`` [s] from ``start_s`` on."""
        thrust, rates = self._thrust, self._rates
        if self._late_thrust is not None:
            (thrust,) = self._late_thrust.compute_mean(start_s, span_s)
        if self._late_rates is not None:
            p, q, r = self._late_rates.compute_mean(start_s, span_s)
            rates = (p, q, r)
        return thrust, rates

    def continue_from(self, other: "ActuationChain") -> None:
        """Go on with what ``other`` was told, in a world of its own."""
        self.told, self.strength, self.gain = other.told, other.strength, other.gain
        self._thrust, self._rates = other._thrust, other._rates
        self._late_thrust, self._late_rates = copy.deepcopy((other._late_thrust, other._late_rates))


class Rotors:
    """Four rotors, and the rate loop that drives them: ours, or another autopilot's."""

    def __init__(
        self, world: World, thrust: float, gyro: Iterator[tuple[float, ...]] | None
    ) -> None:
        """Turn as for a total ``thrust`` [N]; ``gyro``: see :class:`Quadrotor`."""
        self._frame, self._gains = describe_rotors(world)
        self._gyro = repeat((0.0, 0.0, 0.0)) if gyro is None else gyro
        self._gyro_noise_rad_s = world.rotors.gyro_noise_rad_s
        self._gyro_noise = self._draw_noise()
        self.actuators: Actuators = begin_rotors(thrust, self._gains)
        self.signals: FourRotors | None = None
        """Signals of another autopilot; None while our rate loop drives the rotors."""

    def compute_turn(
        self, body: Body, thrust: float, rates: Vec3, gain: float, push: Vec3, h: float
    ) -> tuple[Body, Actuators]:
        """``body`` and actuators after ``h`` [s].

        Nothing is kept of it: see :func:`sim.world.plant.turn_rotors`.
        """
        old, gains = self.actuators, self._gains
        if self.signals is None:
            noise = self._gyro_noise
            return turn_rotors(body, old, thrust, rates, noise, gain, push, h, self._frame, gains)
        full = gain * gains.full_n
        body, speeds = integrate_rotors(
            body, old.speeds, self.signals, full, rates, push, h, self._frame
        )
        return body, old._replace(speeds=speeds)

    def keep(self, actuators: Actuators, *, on_floor: bool) -> None:
        """The step is done; a rate loop on the floor does not wind up."""
        if on_floor:
            actuators = actuators._replace(loop=actuators.loop._replace(integral=(0.0, 0.0, 0.0)))
        self.actuators = actuators
        self._gyro_noise = self._draw_noise()

    def _draw_noise(self) -> Vec3:
        (a, b, c), noise = next(self._gyro), self._gyro_noise_rad_s
        return noise * a, noise * b, noise * c


class FloorContact:
    """Contact of one vehicle with its floor: what it meets it with, friction, and a floor that
    holds it.
    """

    def __init__(self, world: World) -> None:
        """Begin without contact."""
        self._world = world
        self.is_down = False
        """True while it rests on the floor (not while it is held in the air)."""
        self._highest_m = 0.0
        self._held_s: float | None = None
        """Since when the floor has held a vehicle that gathers speed upwards [s of flight]."""
        self.touchdown_m_s: float | None = None
        """Sink rate at the first touchdown [m/s]."""
        self.hardest_m_s: float | None = None
        """Largest sink rate of all touchdowns [m/s]: a vehicle may hop."""
        self.felt = (0.0, 0.0)
        """Error of the autopilot's own estimate while the floor holds the vehicle: height [m] and
        upward speed [m/s]. Only with ``sim.floor_hold_s``."""

    def meets(self, body: Body, flight_time: float) -> bool:
        """Whether ``body`` is on the floor after a step from ``flight_time`` [s] on."""
        hold_s = self._world.floor_hold_s
        held = (
            self.is_down
            and hold_s > 0.0
            and (self._held_s is None or flight_time - self._held_s < hold_s)
        )
        return held or body.position[2] >= self._world.floor_z_m

    def stand(self, body: Body, before: Body, flight_time: float, h: float) -> Body:
        """State of ``body`` after ``h`` [s] on the floor; it was ``before`` at their start."""
        self.is_down = True
        if self._highest_m > HOP_M:
            self.touchdown_m_s = (
                body.velocity[2] if self.touchdown_m_s is None else self.touchdown_m_s
            )
            self.hardest_m_s = max(self.hardest_m_s or 0.0, body.velocity[2])
            self._highest_m = 0.0
        body = self.slide(body, before, h)
        rises = body.velocity[2] < 0.0
        self._held_s = (flight_time if self._held_s is None else self._held_s) if rises else None
        return body

    def slide(self, body: Body, before: Body, h: float) -> Body:
        """On the floor after ``h`` [s]: it does not sink, slides against friction, levels out, and
        does not turn.
        """
        (x, y, _), (u, v, w) = body.position, body.velocity
        speed, stops = (
            math.hypot(u, v),
            self._world.floor_friction * max(w, 0.0),
        )  # w is what the floor takes of it
        slides = 1.0 - stops / speed if stops < speed else 0.0
        if not slides:
            x, y, _ = before.position
        roll, pitch, yaw = so3.euler_zyx(body.attitude)
        keep = math.exp(-h / LEVELS_S)
        return Body(
            (x, y, self._world.floor_z_m),
            (slides * u, slides * v, min(w, 0.0)),
            so3.from_euler_zyx(keep * roll, keep * pitch, yaw),
            body.thrust,
            (0.0, 0.0, 0.0),
        )

    def leave(self, body: Body) -> None:
        """``body`` is in the air."""
        self.is_down, self._held_s = False, None
        height = self._world.floor_z_m - body.position[2]
        self._highest_m = max(self._highest_m, height)

    def feel(self, before: Body, body: Body, h: float) -> None:
        """Let the autopilot's own estimate go on by the ``h`` [s] from ``before`` to ``body``."""
        higher, up = self.felt
        moves = 0.0 if self.is_down else -body.velocity[2]
        gained_m_s = before.velocity[2] - body.velocity[2]
        up += gained_m_s + (moves - up) * h / NOTICES_S
        self.felt = higher * math.exp(-h / FORGETS_S) + (up - moves) * h, up

    def continue_from(self, other: "FloorContact") -> None:
        """Go on as ``other`` stands."""
        self.is_down, self._highest_m = other.is_down, other._highest_m


def _find_start_attitude(world: World) -> Quat:
    """Attitude in which the vehicle is held at its start."""
    level = so3.from_euler_zyx(0.0, math.radians(world.tunnel.start_pitch_deg), 0.0)
    roll, pitch, yaw = world.start_turn_deg
    return so3.rotate(level, (math.radians(roll), math.radians(pitch), math.radians(yaw)))


def _make_drag(world: World) -> AirDrag | None:
    """Drag of the body and of the rotors' inflow; None where ``world`` has none."""
    inflow = (*world.inflow_drag_per_m, world.inflow_lift_per_m)
    drag = AirDrag(world.drag_body_per_s, *inflow, world.air_velocity)
    return drag if any((*drag.linear, drag.within, drag.along, drag.lift)) else None


class Quadrotor:
    """One simulated vehicle.

    It is held at ``world.start_ned`` until released. Implements Airframe's physics.
    """

    def __init__(
        self,
        world: World,
        wind: Wind,
        on_step: Callable[[float, Vec3], None] | None = None,
        gyro: Iterator[tuple[float, ...]] | None = None,
    ) -> None:
        """Hold the vehicle at its start.

        ``on_step(time_s, position_ned)`` sees every step after release.

        ``gyro`` gives rows of three standard normal numbers, one for each step of a rate loop;
        without them its gyro has no noise.
        """
        self._world, self._wind, self._on_step = world, wind, on_step
        self._time = 0.0
        self._cut = 0.0
        """When the whole steps began to be counted [s], and how many there were since."""
        self._steps = 0
        self.released_s: float | None = None
        self._physics = Physics(
            world.mass_kg,
            world.thrust_lag_s,
            world.rate_lag_s,
            world.drag_per_s,
            world.rate_leak,
            world.gravity,
        )
        thrust = world.start_thrust * world.mass_kg * world.gravity
        begins = _find_start_attitude(world)
        self._body = Body(world.start_ned, (0.0, 0.0, 0.0), begins, thrust, (0.0, 0.0, 0.0))
        self._tunnel = None if world.tunnel == STILL else world.tunnel
        self._drag = _make_drag(world)
        self._chain = ActuationChain(world, thrust)
        self._rotors = Rotors(world, thrust, gyro) if world.plant == "rotors" else None
        self.specific_force: Vec3 = (0.0, 0.0, -world.gravity)
        """Specific force over the newest whole step [m/s², FRD]; computed with
        ``sim.plant = "rotors"`` only."""
        self.floor = FloorContact(world)
        self.pull: Callable[[Body], Vec3] | None = None
        """Additional acceleration by position and speed [m/s², NED]; may be changed in flight."""
        self.lead: Callable[[float, float], Body] | None = None
        """A hand that holds it: time [s] and thrust [N] → where it is, whatever its motors do."""
        self.partner: Quadrotor | None = None
        """Another one that is told the same."""

    def command(self, time_s: float, thrust_n: float, rates: Vec3) -> None:
        """Follow a commanded thrust [N] and rates [rad/s, FRD] from ``time_s`` on.

        Gain and limits apply here.
        """
        self._settle(time_s)
        if self.partner is not None:
            self.partner.command(time_s, thrust_n, rates)
        self._chain.command(time_s, self._flown_s(time_s), thrust_n, rates)

    def drive_rotors(self, time_s: float, signals: FourRotors) -> None:
        """Drive the rotors by signals (0..1) from ``time_s`` on, without a rate loop.

        See plant.py for their order.

        A vehicle that is held is released once they lift.

        Raises:
            ValueError: ``sim.plant`` is not "rotors".
        """
        if self._rotors is None:
            raise ValueError('rotors are driven with sim.plant = "rotors" only')
        if self.released_s is None and sum(signals) > 4.0 * LIFTING_SHARE:
            self.release(time_s)
        self._settle(time_s)
        a, b, c, d = (min(max(signal, 0.0), 1.0) for signal in signals)
        self._rotors.signals = (a, b, c, d)

    def _flown_s(self, time_s: float) -> float | None:
        """Time since the release [s]; None before it."""
        return None if self.released_s is None else time_s - self.released_s

    def most_n(self, time_s: float) -> float:
        """The thrust that its rotors give at their fullest, as they are at ``time_s`` [N]."""
        return self._chain.compute_gain(self._flown_s(time_s)) * self._world.thrust_max_n

    def weaken(self, time_s: float, share: float) -> None:
        """Reduce the rotors' thrust to ``share`` of the healthy one from ``time_s`` on."""
        self._chain.strength = share
        self.command(time_s, *self._chain.told)

    def release(self, time_s: float) -> None:
        """Let go of the vehicle; does nothing the second time."""
        if self.released_s is None:
            self.advance(time_s)
            self.released_s = time_s
            self._body = self._body._replace(velocity=self._world.start_velocity)
        if self.partner is not None:
            self.partner.release(time_s)

    def twin(self, time_s: float, world: World, wind: Wind) -> "Quadrotor":
        """Another one that is in the same state at ``time_s`` [s], in a ``world`` and ``wind`` of
        its own.
        """
        self._settle(time_s)
        other = Quadrotor(world, wind)
        other._time = other._cut = self._time
        other.released_s, other._body = self.released_s, self._body
        other._chain.continue_from(self._chain)
        if other._rotors is not None and self._rotors is not None:
            other._rotors.actuators = self._rotors.actuators
            other._rotors.signals = self._rotors.signals
        other.floor.continue_from(self.floor)
        return other

    def truth(self, time_s: float) -> TrueState:
        """The exact state at ``time_s`` [s].

        In real time a tracker may wake up late, after a command has come: the state is then moved
        back by speed and rates.
        """
        self.advance(time_s)
        body, down, rest = self._body, self.floor.is_down, time_s - self._time
        if self.released_s is not None and rest < -ROUNDING_S:
            wx, wy, wz = body.rates
            place = add_scaled(body.position, rest, body.velocity)
            body = body._replace(
                position=place,
                attitude=so3.rotate(body.attitude, (rest * wx, rest * wy, rest * wz)),
            )
        if self.released_s is not None and rest > ROUNDING_S:
            # Only a look into the step under way: the questions asked must not change the flight.
            flight_time = self._time - self.released_s
            body, _ = self._after(flight_time, rest)
            if down := self.floor.meets(body, flight_time):
                body = self.floor.slide(body, self._body, rest)
        p, v, q, thrust, rates = body
        return TrueState(time_s, p, v, q, rates, thrust, down)

    @property
    def attitude(self) -> Quat:
        """Where it has been advanced to: body FRD to world NED."""
        return self._body.attitude

    @property
    def velocity(self) -> Vec3:
        """Where it has been advanced to [m/s, NED]."""
        return self._body.velocity

    def advance(self, time_s: float) -> None:
        """Let the physics run until ``time_s`` [s], in whole steps."""
        if self.released_s is None:
            self._time = self._cut = max(self._time, time_s)
            return
        cut, h, released = self._cut, self._world.step_s, self.released_s
        for k in range(self._steps, int((time_s - cut) / h + 1e-9)):
            self._step(cut + k * h - released, h, cut + (k + 1) * h)
            self._steps = k + 1

    def _settle(self, time_s: float) -> None:
        """Cut the step under way at ``time_s`` [s], where something changes."""
        self.advance(time_s)
        rest = time_s - self._time
        if self.released_s is not None and rest > ROUNDING_S:
            self._step(self._time - self.released_s, rest, time_s)
        self._cut, self._steps = self._time, 0

    def _after(self, flight_time: float, h: float) -> tuple[Body, Actuators | None]:
        """The body ``h`` [s] after ``flight_time`` [s], as if there were no floor, and its
        actuators.
        """
        push = self._find_push(flight_time, h)
        thrust, rates = self._chain.compute_mean(self._time, h)
        body, actuators = self._body, None
        if self._tunnel is not None:
            rates = self._tunnel.turn(rates, body.velocity)
        if self._rotors is None:
            body = integrate(FLOATS, body, thrust, rates, push, h, self._physics)
        else:
            body, actuators = self._rotors.compute_turn(
                body, thrust, rates, self._chain.gain, push, h
            )
        if self.lead is not None and self.released_s is not None:
            body = self.lead(self.released_s + flight_time + h, body.thrust)
        return body, actuators

    def _find_push(self, flight_time: float, h: float) -> Vec3:
        """Acceleration beside thrust and weight in a step [m/s², NED]: wind, pull, ground effect,
        and drag.
        """
        world, body = self._world, self._body
        push = self._wind.at(flight_time + 0.5 * h)
        if self.pull is not None:
            x, y, z = self.pull(body)
            push = push[0] + x, push[1] + y, push[2] + z
        if world.ground_effect:
            cushion = (_ground_effect(world, body.position[2]) - 1.0) * body.thrust / world.mass_kg
            (x, y, z), (u, v, w) = so3.third_column(body.attitude), push
            push = u - cushion * x, v - cushion * y, w - cushion * z
        if self._drag is not None:
            tunnel, drag, (u, v, w) = world.tunnel, self._drag, push
            if tunnel.gust_m_s:
                north, east, down = drag.air
                north += tunnel.gust_m_s * math.sin(
                    tunnel.gust_rad_s * flight_time + tunnel.gust_phase_rad
                )
                drag = drag._replace(air=(north, east, down))
            x, y, z = compute_drag(FLOATS, body, drag)
            push = u + x, v + y, w + z
        return push

    def _step(self, flight_time: float, h: float, until_s: float) -> None:
        """One step of ``h`` [s] from ``flight_time`` [s] on.

        It ends at ``until_s`` [s, event loop's clock].
        """
        world, before, floor = self._world, self._body, self.floor
        body, actuators = self._after(flight_time, h)
        if floor.meets(body, flight_time):
            self._body = floor.stand(body, before, flight_time, h)
        else:
            floor.leave(body)
            self._body = body
        if self._rotors is not None and actuators is not None:
            self._rotors.keep(actuators, on_floor=floor.is_down)
            (u, v, w), (a, b, c) = before.velocity, self._body.velocity
            force = ((a - u) / h, (b - v) / h, (c - w) / h - world.gravity)
            self.specific_force = so3.to_body(self._body.attitude, force)
        if world.floor_hold_s > 0.0:
            floor.feel(before, self._body, h)
        self._time = until_s
        if self._on_step is not None:
            self._on_step(until_s, self._body.position)


def _ground_effect(world: World, down_m: float) -> float:
    """Thrust near the floor over thrust far from it: 1 / (1 - (R / 4 z)²), z the height of the
    rotors.

    Source: Cheeseman and Bennett, The effect of the ground on a helicopter rotor in forward flight,
        ARC R&M 3021, 1955.
    """
    radius = world.rotor_radius_m
    share = radius / (4.0 * (max(world.floor_z_m - down_m, 0.0) + STANDS_RADII * radius))
    return 1.0 / (1.0 - share * share)


LOOP_S = 0.004
"""Period of the autopilot's attitude loop [s]: telemetry has the newest result."""
WANDER_RAD = math.radians(0.5)
"""Tilt error of the autopilot's estimate on each axis, 1σ [rad]."""
TILT_WANDER_S = 10.0
"""Correlation time of that error [s]."""
UPRIGHT_PER_S = 0.1
"""Gain of the accelerometers' correction of the tilt [1/s]."""


class Horizon:
    """One vehicle's estimator."""

    def __init__(self, normals: Iterator[tuple[float, ...]], gravity: float) -> None:
        """``normals`` gives rows of three standard normal numbers; ``gravity`` is in m/s²."""
        self._normals = normals
        self._gravity = gravity
        self._truth: TrueState | None = None
        self._wander: Vec3 = _scale(WANDER_RAD, next(normals))
        self._pulled = (0.0, 0.0)

    def feel(self, truth: TrueState) -> tuple[Quat, Vec3]:
        """Attitude and body rates [rad/s] as estimated, while ``truth`` is so.

        Never earlier than before.
        """
        last, self._truth = self._truth, truth
        if last is not None and truth.time_s > last.time_s:
            self._go_on(last, truth, truth.time_s - last.time_s)
        age = math.fmod(truth.time_s, LOOP_S)
        rates = truth.rates_rad_s
        (a, b, c), (p, q, r), (north, east) = self._wander, rates, self._pulled
        attitude = so3.rotate(truth.attitude, (a - age * p, b - age * q, c - age * r))
        # Who accelerates north leans nose down, about west; so pulled upright is about east.
        return so3.multiply(so3.rotate(so3.IDENTITY, (-east, north, 0.0)), attitude), rates

    def _go_on(self, last: TrueState, truth: TrueState, since: float) -> None:
        """Wander and be pulled for ``since`` [s]."""
        keep = math.exp(-since / TILT_WANDER_S)
        a, b, c = self._wander
        x, y, z = _scale(WANDER_RAD * math.sqrt(1.0 - keep * keep), next(self._normals))
        self._wander = (keep * a + x, keep * b + y, keep * c + z)
        (u, v, _), (u0, v0, _) = truth.velocity_ned, last.velocity_ned
        north, east = (
            (0.0, 0.0)
            if truth.on_ground
            else ((u - u0) / (since * self._gravity), (v - v0) / (since * self._gravity))
        )
        pull = 1.0 - math.exp(-since * UPRIGHT_PER_S)
        a, b = self._pulled
        self._pulled = (a + pull * (north - a), b + pull * (east - b))


def _scale(by: float, row: tuple[float, ...]) -> Vec3:
    x, y, z = row
    return by * x, by * y, by * z


class SimulatedVehicle:
    """Implements :class:`sim.world.quadrotor.Airframe` on a :class:`Quadrotor`."""

    def __init__(
        self,
        plant: Quadrotor,
        world: World,
        noise: Iterator[tuple[float, ...]],
        wander: Iterator[tuple[float, ...]],
        horizon: Horizon | None = None,
    ) -> None:
        """Motors off; ``noise`` gives rows of six, ``wander`` of three standard normal numbers for
        :meth:`measure`.

        Without a ``horizon`` its attitude is that of :meth:`measure`, as where its own estimate
        serves as the poses.
        """
        self.plant = plant
        self._world = world
        self._noise = noise
        self._astray, self._resets = 0.0, 0
        self._wander = PositionWander(world, wander)
        self._horizon = horizon
        self._on = False

    def act(self, time_s: float, thrust_fraction: float, rates_rad_s: Vec3) -> None:
        """Follow a thrust signal (0..1) and body rates [rad/s, FRD] from ``time_s`` on."""
        if self._on:
            share = thrust(thrust_fraction, self._world.thrust_curve)
            self.plant.command(time_s, share * self._world.thrust_max_n, rates_rad_s)

    def power(self, time_s: float, on: bool) -> None:
        """Motors on or off."""
        self._on = on
        if not on:
            self.plant.command(time_s, 0.0, (0.0, 0.0, 0.0))

    def release(self, time_s: float) -> None:
        """Let go of the vehicle that is held in the air."""
        self.plant.release(time_s)

    def truth(self, time_s: float) -> TrueState:
        """The exact state."""
        return self.plant.truth(time_s)

    def measure(self, time_s: float) -> TrueState:
        """The state with the noise that the scenario gives to poses, as its own estimator has
        it.
        """
        truth = with_noise(self.plant.truth(time_s), self._world, next(self._noise))
        if self._world.floor_hold_s > 0.0:
            (north, east, down), (u, v, _), (higher, up) = (
                truth.position_ned,
                truth.velocity_ned,
                self.plant.floor.felt,
            )
            truth = msgspec.structs.replace(
                truth, position_ned=(north, east, down - higher), velocity_ned=(u, v, -up)
            )
        if any(bias := self._world.velocity_bias):
            (u, v, w), (i, j, k) = truth.velocity_ned, bias
            truth = msgspec.structs.replace(truth, velocity_ned=(u + i, v + j, w + k))
        truth = self._wander.distort(truth, self.plant.released_s)
        if not (self._astray or self._resets):
            return truth
        attitude = so3.multiply(
            so3.from_euler_zyx(0.0, 0.0, math.radians(self._astray)), truth.attitude
        )
        return msgspec.structs.replace(truth, attitude=attitude, resets=truth.resets + self._resets)

    def lead_heading_astray(self, off_deg: float) -> None:
        """Turn the estimator's heading by ``off_deg`` [deg], as a magnet does.

        The estimator does not notice.
        """
        self._astray = off_deg

    def reset_heading(self) -> None:
        """Have its estimator find its true heading, and say that it has turned it."""
        self._astray = 0.0
        self._resets += 1

    def feel(self, time_s: float) -> tuple[Quat, Vec3]:
        """Attitude and body rates as its own estimator has them."""
        if self._horizon is not None:
            truth = self.plant.truth(time_s)
            attitude, (p, q, r) = self._horizon.feel(truth)
            return attitude, (p, q, r)
        seen = self.measure(time_s)
        return seen.attitude, seen.rates_rad_s


def with_noise(truth: TrueState, world: World, normals: tuple[float, ...]) -> TrueState:
    """``truth`` with the scenario's noise on position and attitude, from six standard normal
    numbers.
    """
    n, a, jitter = world.pose_noise_m, world.attitude_noise_rad, world.pose_jitter_s
    if n == 0.0 and a == 0.0:
        return truth
    (x, y, z), (i, j, k, roll, pitch, yaw) = truth.position_ned, normals
    if jitter:
        # Of the attitude's noise about the thrust, which moves nothing: one number less to draw.
        late, (u, v, w) = jitter * yaw, truth.velocity_ned
        x, y, z = x + late * u, y + late * v, z + late * w
    return TrueState(
        truth.time_s,
        (x + n * i, y + n * j, z + n * k),
        truth.velocity_ned,
        so3.rotate(truth.attitude, (a * roll, a * pitch, a * yaw)),
        truth.rates_rad_s,
        truth.thrust_n,
        truth.on_ground,
        truth.resets,
    )


WANDER_S = 2.0
"""Time over which a wander is configured [s]."""
ESTIMATE_FORGETS_S = 40.0
"""Time constant with which a wander returns [s]."""
SPEED_PER_M = 1.5
"""Wander of the measured speed per wander of position [1/s]: PX4's is 5 cm/s in 0.5 s."""
SPEED_FORGETS_S = 5.0
"""Time constant of the speed's wander [s]."""


class PositionWander:
    """Wander of a measured position and yaw about the true ones."""

    def __init__(self, world: World, normals: Iterator[tuple[float, ...]]) -> None:
        """Nothing yet; ``normals`` gives rows of three standard normal numbers."""
        self._world = world
        self._normals = normals
        self._at_s: float | None = None
        self._off: Vec3 = (0.0, 0.0, 0.0)
        self._fast: Vec3 = (0.0, 0.0, 0.0)

    def distort(self, truth: TrueState, released_s: float | None) -> TrueState:
        """``truth`` as it is measured; times do not go backwards."""
        world = self._world
        if world.estimate_wander_m:
            elapsed = truth.time_s - (truth.time_s if self._at_s is None else self._at_s)
            self._at_s = truth.time_s
            keep = math.exp(-elapsed / ESTIMATE_FORGETS_S)
            step = world.estimate_wander_m * math.sqrt(elapsed / WANDER_S)
            (a, b, c), (i, j, k) = self._off, next(self._normals)
            self._off = a, b, c = (keep * a + step * i, keep * b + step * j, keep * c + step * k)
            fade = math.exp(-elapsed / SPEED_FORGETS_S)
            (d, e, f), step = self._fast, SPEED_PER_M * step
            self._fast = d, e, f = (fade * d + step * i, fade * e + step * j, fade * f + step * k)
            (x, y, z), (u, v, w) = truth.position_ned, truth.velocity_ned
            truth = msgspec.structs.replace(
                truth, position_ned=(x + a, y + b, z + c), velocity_ned=(u + d, v + e, w + f)
            )
        if world.estimate_yaw_step_deg:
            if released_s is not None and truth.time_s - released_s >= world.estimate_yaw_step_s:
                return msgspec.structs.replace(truth, resets=1)
            half = math.radians(-0.5 * world.estimate_yaw_step_deg)
            turned = so3.multiply((math.cos(half), 0.0, 0.0, math.sin(half)), truth.attitude)
            truth = msgspec.structs.replace(truth, attitude=turned)
        return truth
