"""Quadrotor in time: held, released, flying, on the floor. Its physics are in plant.py.

It advances when it is asked for a later instant, in steps of ``world.step_s`` that begin anew with
every command. An autopilot commands it through :class:`sim.world.airframe.Airframe`. With
``world.plant = "rotors"`` another autopilot may drive the rotors themselves: it steps as long as
its own loop, and each time reads ``truth(now)`` (rates for its gyro) and ``specific_force`` (for
its accelerometer), and then calls ``drive_rotors(now, signals)``.
"""

import copy
import math
from collections import deque
from collections.abc import Callable, Iterator
from itertools import repeat

import msgspec

from groundstation.core.geometry import FLOATS, Quat, Vec3, add_scaled, so3
from groundstation.core.messages import ROUNDING_S
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


HOP_M = 0.005
"""Height above the floor below which a vehicle has not left it [m]: no touchdown follows.
Chosen."""
ROTOR_HEIGHT_RADII = 0.85
"""Height of the rotors above the floor of a vehicle that rests on it, in rotor radii [-]. Chosen:
ground effect raises its thrust by 9 %."""
LIFTING_SHARE = 0.2
"""Mean signal of the rotors above which a held vehicle is released [-]. Chosen: above idling, which
is below 0.1."""
LEVELLING_S = 0.02
"""Time constant with which the floor levels a vehicle that comes down tilted [s]. Chosen."""
HELD_SPEED_S = 0.15
"""Time constant with which the error of an autopilot's own speed decays while the floor holds the
vehicle [s]. By a take-off of ArduCopter's SITL, whose estimate stayed at 0.4 m/s for 0.4 s and then
rose to 1.7."""
HELD_HEIGHT_S = 2.0
"""Time constant with which the error of its own height decays then [s]. Chosen."""


class DelayLine:
    """Commands that begin to act some time after they come, each until the next one acts."""

    def __init__(self, delay_s: float, first: tuple[float, ...]) -> None:
        """Delay commands by ``delay_s`` [s].

        ``first`` acts until the first one has come through.
        """
        self._delay_s = delay_s
        self._now = first
        self._coming: deque[tuple[float, tuple[float, ...]]] = deque()

    def put(self, time_s: float, command: tuple[float, ...]) -> None:
        """Take a command that comes at ``time_s`` [s]."""
        self._coming.append((time_s + self._delay_s, command))

    def compute_mean(self, start_s: float, span_s: float) -> tuple[float, ...]:
        """Return the mean of the acting commands over ``span_s`` [s] from ``start_s`` on.

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
    """Gain, limits and dead times between commanded thrust and rates and those that act."""

    def __init__(self, world: World, thrust: float) -> None:
        """Begin with ``thrust`` [N], which acts until a command does, where commands act late."""
        self._world = world
        x, y, z = world.rate_limits_deg_s
        self._limits: Vec3 = (math.radians(x), math.radians(y), math.radians(z))
        self.newest: tuple[float, Vec3] = (0.0, (0.0, 0.0, 0.0))
        """Newest command: thrust [N] and rates [rad/s, FRD]."""
        self.strength = 1.0
        """Thrust of the rotors, as a share of the healthy ones' [-]."""
        self.gain = world.thrust_gain
        """Thrust as a share of the commanded one, at the newest command [-]."""
        self._thrust = 0.0
        self._rates: Vec3 = (0.0, 0.0, 0.0)
        self._late_thrust = (
            DelayLine(world.thrust_delay_s, (thrust,)) if world.thrust_delay_s else None
        )
        self._late_rates = (
            DelayLine(world.rate_delay_s, (0.0, 0.0, 0.0)) if world.rate_delay_s else None
        )

    def command(self, time_s: float, flown_s: float | None, thrust_n: float, rates: Vec3) -> None:
        """Take a command at ``time_s`` [s], ``flown_s`` [s] after the release (None before it)."""
        self.newest = thrust_n, rates
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
        """Return the thrust as a share of the commanded one [-], ``flown_s`` [s] after the release:
        batteries sag.
        """
        gain, sag = self.strength * self._world.thrust_gain, self._world.thrust_sag
        if sag and flown_s is not None:
            gain *= 1.0 - sag * min(1.0, flown_s / 60.0)
        return gain

    def compute_mean(self, start_s: float, span_s: float) -> tuple[float, Vec3]:
        """Return the means of thrust [N] and rates [rad/s, FRD] that act over ``span_s`` [s] from
        ``start_s`` on.
        """
        thrust, rates = self._thrust, self._rates
        if self._late_thrust is not None:
            (thrust,) = self._late_thrust.compute_mean(start_s, span_s)
        if self._late_rates is not None:
            p, q, r = self._late_rates.compute_mean(start_s, span_s)
            rates = (p, q, r)
        return thrust, rates

    def continue_from(self, other: "ActuationChain") -> None:
        """Continue with the commands of ``other``, by the limits and delays of its own world."""
        self.newest, self.strength, self.gain = other.newest, other.strength, other.gain
        self._thrust, self._rates = other._thrust, other._rates
        self._late_thrust, self._late_rates = copy.deepcopy((other._late_thrust, other._late_rates))


class Rotors:
    """Four rotors. Our rate loop drives them, or another autopilot does."""

    def __init__(
        self, world: World, thrust: float, gyro: Iterator[tuple[float, ...]] | None
    ) -> None:
        """Begin at the speeds that give ``thrust`` [N] in all; ``gyro``: see :class:`Quadrotor`."""
        self._frame, self._gains = describe_rotors(world)
        self._gyro = repeat((0.0, 0.0, 0.0)) if gyro is None else gyro
        self._gyro_noise_rad_s = world.rotors.gyro_noise_rad_s
        self._gyro_noise = self._draw_noise()
        self.actuators: Actuators = begin_rotors(thrust, self._gains)
        self.signals: FourRotors | None = None
        """Signals of another autopilot; None while our rate loop drives the rotors."""

    def compute_turn(
        self, body: Body, thrust: float, rates: Vec3, gain: float, disturbance: Vec3, h: float
    ) -> tuple[Body, Actuators]:
        """Return ``body`` and actuators after ``h`` [s], and keep nothing of it.

        Arguments as in :func:`sim.world.plant.turn_rotors`.
        """
        old, gains = self.actuators, self._gains
        if self.signals is None:
            noise = self._gyro_noise
            return turn_rotors(
                body, old, thrust, rates, noise, gain, disturbance, h, self._frame, gains
            )
        full = gain * gains.full_n
        body, speeds = integrate_rotors(
            body, old.speeds, self.signals, full, rates, disturbance, h, self._frame
        )
        return body, old._replace(speeds=speeds)

    def keep(self, actuators: Actuators, *, on_floor: bool) -> None:
        """Keep the ``actuators`` of a step that is done. On the floor the rate loop's integral is
        reset: it would wind up.
        """
        if on_floor:
            actuators = actuators._replace(loop=actuators.loop._replace(integral=(0.0, 0.0, 0.0)))
        self.actuators = actuators
        self._gyro_noise = self._draw_noise()

    def _draw_noise(self) -> Vec3:
        (a, b, c), noise = next(self._gyro), self._gyro_noise_rad_s
        return noise * a, noise * b, noise * c


class FloorContact:
    """Contact of one vehicle with its floor: touchdowns, friction, and a floor that holds it."""

    def __init__(self, world: World) -> None:
        """Begin without contact."""
        self._world = world
        self.is_down = False
        """True while it rests on the floor (not while it is held in the air)."""
        self._highest_m = 0.0
        """Largest height since the last contact [m]."""
        self._held_s: float | None = None
        """Since when the floor has held a vehicle whose thrust lifts it [s of flight]."""
        self.touchdown_m_s: float | None = None
        """Sink rate at the first touchdown [m/s]."""
        self.hardest_m_s: float | None = None
        """Largest sink rate of all touchdowns [m/s]: a vehicle may hop."""
        self.own_estimate = (0.0, 0.0)
        """Autopilot's own estimate: the error of its height [m], and its upward speed [m/s]. Only
        with ``sim.floor_hold_s``."""

    def meets(self, body: Body, flight_time: float) -> bool:
        """Return whether ``body`` is on the floor after a step from ``flight_time`` [s] on."""
        hold_s = self._world.floor_hold_s
        held = (
            self.is_down
            and hold_s > 0.0
            and (self._held_s is None or flight_time - self._held_s < hold_s)
        )
        return held or body.position[2] >= self._world.floor_z_m

    def stand(self, body: Body, before: Body, flight_time: float, h: float) -> Body:
        """Return ``body`` after ``h`` [s] on the floor; it was ``before`` at their start."""
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
        """Return ``body`` after ``h`` [s] on the floor: it does not sink, slides against friction,
        levels out, and does not turn.
        """
        (x, y, _), (u, v, w) = body.position, body.velocity
        speed = math.hypot(u, v)
        # The floor takes the sink rate w, and by friction a share of it from the horizontal speed.
        lost = self._world.floor_friction * max(w, 0.0)
        slides = 1.0 - lost / speed if lost < speed else 0.0
        if not slides:
            x, y, _ = before.position
        roll, pitch, yaw = so3.euler_zyx(body.attitude)
        keep = math.exp(-h / LEVELLING_S)
        return Body(
            (x, y, self._world.floor_z_m),
            (slides * u, slides * v, min(w, 0.0)),
            so3.from_euler_zyx(keep * roll, keep * pitch, yaw),
            body.thrust,
            (0.0, 0.0, 0.0),
        )

    def leave(self, body: Body) -> None:
        """Note that ``body`` is in the air."""
        self.is_down, self._held_s = False, None
        height = self._world.floor_z_m - body.position[2]
        self._highest_m = max(self._highest_m, height)

    def update_own_estimate(self, before: Body, body: Body, h: float) -> None:
        """Update ``own_estimate`` by the ``h`` [s] from ``before`` to ``body``."""
        higher, up = self.own_estimate
        moves = 0.0 if self.is_down else -body.velocity[2]
        gained_m_s = before.velocity[2] - body.velocity[2]
        up += gained_m_s + (moves - up) * h / HELD_SPEED_S
        self.own_estimate = higher * math.exp(-h / HELD_HEIGHT_S) + (up - moves) * h, up

    def continue_from(self, other: "FloorContact") -> None:
        """Continue with the contact of ``other``."""
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
        """Instant from which whole steps are counted [s]: the newest command."""
        self._steps = 0
        """Whole steps since then."""
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
        """A hand that holds it: time [s] and thrust [N] → its body, whatever its motors do."""
        self.partner: Quadrotor | None = None
        """Another one that gets the same commands."""

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

    def find_max_thrust_n(self, time_s: float) -> float:
        """Return the thrust of the full signal at ``time_s`` [N]: of weak rotors, a sagging
        battery.
        """
        return self._chain.compute_gain(self._flown_s(time_s)) * self._world.thrust_max_n

    def weaken(self, time_s: float, share: float) -> None:
        """Reduce the rotors' thrust to ``share`` of the healthy one from ``time_s`` on."""
        self._chain.strength = share
        self.command(time_s, *self._chain.newest)

    def release(self, time_s: float) -> None:
        """Release the vehicle; does nothing the second time."""
        if self.released_s is None:
            self.advance(time_s)
            self.released_s = time_s
            self._body = msgspec.structs.replace(self._body, velocity=self._world.start_velocity)
        if self.partner is not None:
            self.partner.release(time_s)

    def twin(self, time_s: float, world: World, wind: Wind) -> "Quadrotor":
        """Return another quadrotor in the same state at ``time_s`` [s], with its own ``world`` and
        ``wind``.
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
        """Return the exact state at ``time_s`` [s].

        In real time a tracker may wake up late, after a command has come: the state is then moved
        back by speed and rates.
        """
        self.advance(time_s)
        body, down, rest = self._body, self.floor.is_down, time_s - self._time
        if self.released_s is not None and rest < -ROUNDING_S:
            wx, wy, wz = body.rates
            place = add_scaled(body.position, rest, body.velocity)
            body = msgspec.structs.replace(
                body,
                position=place,
                attitude=so3.rotate(body.attitude, (rest * wx, rest * wy, rest * wz)),
            )
        if self.released_s is not None and rest > ROUNDING_S:
            # A trial within the present step, which is not kept: questions must not change the
            # flight.
            flight_time = self._time - self.released_s
            body, _ = self._after(flight_time, rest)
            if down := self.floor.meets(body, flight_time):
                body = self.floor.slide(body, self._body, rest)
        return TrueState(
            time_s, body.position, body.velocity, body.attitude, body.rates, body.thrust, down
        )

    @property
    def attitude(self) -> Quat:
        """Attitude at the newest step, body FRD to world NED."""
        return self._body.attitude

    @property
    def velocity(self) -> Vec3:
        """Velocity at the newest step [m/s, NED]."""
        return self._body.velocity

    def advance(self, time_s: float) -> None:
        """Advance the physics to ``time_s`` [s], in whole steps."""
        if self.released_s is None:
            self._time = self._cut = max(self._time, time_s)
            return
        cut, h, released = self._cut, self._world.step_s, self.released_s
        for k in range(self._steps, int((time_s - cut) / h + 1e-9)):
            self._step(cut + k * h - released, h, cut + (k + 1) * h)
            self._steps = k + 1

    def _settle(self, time_s: float) -> None:
        """End the present step at ``time_s`` [s], where a command changes, and count steps from
        there.
        """
        self.advance(time_s)
        rest = time_s - self._time
        if self.released_s is not None and rest > ROUNDING_S:
            self._step(self._time - self.released_s, rest, time_s)
        self._cut, self._steps = self._time, 0

    def _after(self, flight_time: float, h: float) -> tuple[Body, Actuators | None]:
        """Return the body ``h`` [s] after ``flight_time`` [s], as if there were no floor, and its
        actuators.
        """
        disturbance = self._find_disturbance(flight_time, h)
        thrust, rates = self._chain.compute_mean(self._time, h)
        body, actuators = self._body, None
        if self._tunnel is not None:
            rates = self._tunnel.turn(rates, body.velocity)
        if self._rotors is None:
            body = integrate(FLOATS, body, thrust, rates, disturbance, h, self._physics)
        else:
            body, actuators = self._rotors.compute_turn(
                body, thrust, rates, self._chain.gain, disturbance, h
            )
        if self.lead is not None and self.released_s is not None:
            body = self.lead(self.released_s + flight_time + h, body.thrust)
        return body, actuators

    def _find_disturbance(self, flight_time: float, h: float) -> Vec3:
        """Return the acceleration beside thrust and weight in a step [m/s², NED]: wind, pull,
        ground effect, and drag.
        """
        world, body = self._world, self._body
        total = self._wind.at(flight_time + 0.5 * h)
        if self.pull is not None:
            x, y, z = self.pull(body)
            total = total[0] + x, total[1] + y, total[2] + z
        if world.ground_effect:
            cushion = (_ground_effect(world, body.position[2]) - 1.0) * body.thrust / world.mass_kg
            (x, y, z), (u, v, w) = so3.third_column(body.attitude), total
            total = u - cushion * x, v - cushion * y, w - cushion * z
        if self._drag is not None:
            tunnel, drag, (u, v, w) = world.tunnel, self._drag, total
            if tunnel.gust_m_s:
                north, east, down = drag.air
                north += tunnel.gust_m_s * math.sin(
                    tunnel.gust_rad_s * flight_time + tunnel.gust_phase_rad
                )
                drag = drag._replace(air=(north, east, down))
            x, y, z = compute_drag(FLOATS, body, drag)
            total = u + x, v + y, w + z
        return total

    def _step(self, flight_time: float, h: float, until_s: float) -> None:
        """Make one step of ``h`` [s] from ``flight_time`` [s] on, which ends at ``until_s`` [s,
        event loop's clock].
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
            floor.update_own_estimate(before, self._body, h)
        self._time = until_s
        if self._on_step is not None:
            self._on_step(until_s, self._body.position)


def _ground_effect(world: World, down_m: float) -> float:
    """Return thrust near the floor over thrust far from it [-]: 1 / (1 - (R / 4 z)²), with the
    rotors' height z and radius R.

    Source: Cheeseman and Bennett, The effect of the ground on a helicopter rotor in forward flight,
        ARC R&M 3021, 1955.
    """
    radius = world.rotor_radius_m
    share = radius / (4.0 * (max(world.floor_z_m - down_m, 0.0) + ROTOR_HEIGHT_RADII * radius))
    return 1.0 / (1.0 - share * share)
