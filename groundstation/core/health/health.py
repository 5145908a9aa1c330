"""Pose health: do the poses show this vehicle's present motion? One state from few tests. Sans-IO.

Poses are believed as long as they show a response to the commands. The tests, each derived in
docs/explanation/trust.md:

- response of attitude, position and height to the commands
  (:mod:`groundstation.core.health.pose_response`);
- acceleration beyond 1 g that no command explains
  (:class:`groundstation.core.health.pose_gate.PushMonitor`);
- frozen position: constant along a direction, though the model moves;
- yaw rate that no command explains;
- height behind the thrust, just off the floor.

In ``SUSPECT`` the pilot flies excitation tones until the response is known; nothing else changes.
``FAILED`` is final: the mission comes down by what still responds.
"""

import math
from collections import deque
from enum import IntEnum
from typing import NamedTuple

from groundstation.core.control import FIRST_CLIMB_M
from groundstation.core.estimation import SIGNIFICANT
from groundstation.core.geometry import Vec3, add, conjugate, multiply, rotation_vector, subtract
from groundstation.core.health.pose_gate import PUSH_BASE_S, PUSH_M_S2, PushMonitor
from groundstation.core.health.pose_response import (
    BLOCK_S,
    BLOCKS,
    DIAGONAL,
    LEAST_DISPLACEMENT_M,
    LEAST_TURN_RAD,
    LINE,
    OWN_HEIGHT,
    OWN_LATERAL,
    OWN_TURN,
    PASS_RAD_S,
    PLANE,
    POSE_GAP_S,
    SUSPECT_ALARM,
    TONE_MEMORY_S,
    Alarm,
    HighPass,
    LatenessMonitor,
    Response,
)
from groundstation.core.messages import ROUNDING_S, Pose, Sentence
from groundstation.core.vehicle import ActuatorResponse, Motion


class HealthState(IntEnum):
    """Trust in the poses."""

    OK = 0
    SUSPECT = 1
    FAILED = 2


class Failure(NamedTuple):
    """Failure of the poses, or commands too late to fly by, that ends a flight."""

    id: str
    """Id of the sentence."""
    reason: Sentence
    """Sentence for the operator."""


SHORTEST_S = BLOCKS[0] * BLOCK_S
"""Length of the shortest window, in which the beginning of a fault may be hidden [s]."""
CALM_ALARM = 0.25
"""Alarm below which nothing speaks against the poses [-]: should they fail later, the estimate of
that instant is the newest one that is trusted. Chosen."""
SUSPECT_M_S2 = 2.0
"""Difference of the estimated disturbance from its mean of the last seconds from which the poses
are suspect [m/s²]: gusts of `storm` come to 1.6."""
SUSPECT_S = 1.0
"""Longest duration of ``SUSPECT`` [s]. Chosen: with the larger tones the response is known after
0.6 s."""
SETTLE_S = 1.5 / PASS_RAD_S
"""Time after which positions are evaluated [s]: an error of 0.1 m/s of the initial speed is then
less than 1.5 mm behind the high pass."""

OUTAGE_INTERVALS = 3.0
"""Interval of poses, in mean intervals, from which a pose is not evaluated [-]: after an outage it
alone would decide the shortest window. Chosen."""
INTERVAL_SHARE = 0.2
"""Weight of the newest interval in their mean [-]. Chosen."""

STOPPED_S = 0.15
"""Time for which the position of a moving vehicle must be constant to be frozen [s]: wind that
reverses a motion keeps it within 2 mm for a shorter time."""
SPEED_S = 0.05
"""Time over which the speed before that is measured [s]: the model's alone is wrong after an outage
in gusts, and a difference of two poses is noise. Chosen."""
STOPPED_POSES = 4
"""Least number of poses at a constant position, after the first [-]: two poses around an outage may
agree by chance. Chosen."""
DRIVEN_S = 0.3
"""Time for which the position of a vehicle at rest must be constant, though commands accelerate it,
to be suspect [s]: wind that the law rejects has the same effect. Chosen."""
DRIVEN_M_S2 = 1.5
"""Mean acceleration of the model meanwhile, beside the wind before, from which the position is
frozen [m/s²]: wind that the law rejected came to 1.10 in 60 flights of `adverse` and `storm`."""
DRIVEN_RANGES = 10.0
"""Least displacement of the model meanwhile, as a multiple of the range that counts as constant
[-]. Chosen."""
STOP_S = 2.0 * DRIVEN_S
"""Time after which a constant position is a vehicle at rest, not a stop [s]: the model would drift
from it."""
STOPPED_M_S = 0.15
"""Least speed before a stop, and of the model since [m/s]: from one pose to the next wind reduces
a speed by less, and only a collision by more. Where positions within more than 1 mm count as
constant, it is the speed that ``PUSH_M_S2`` turns back within that range."""
MISTIMED_S = 0.025
"""Error of the configured delay of the commands that is tolerated [s]: a radio's frame period
(`alarms --floors`). The model's speed is then wrong by its acceleration times this."""

YAW_RAD_S = 0.15
"""Mean yaw rate beyond the commanded ones that fails the poses [rad/s]: `storm` comes to .04."""
YAW_MEMORY_S = 1.0
"""Time constant of that mean [s]. Chosen."""
YAW_LATE_S = 0.55
"""Largest delay of an autopilot's yaw behind its command [s]. Chosen: 0.2 s more than PX4 and
ArduPilot took (`groundstation-sim dev autopilots`)."""

BEHIND_M = 0.06
"""Height by which a climb may be behind its thrust just off the floor, beside noise [m]: the error
of the hover thrust at lift-off. Chosen."""
BEHIND_M_S2 = 1.2
"""Vertical acceleration by which it may be behind [m/s²]: ground effect and vertical wind.
Chosen."""


class StandstillMonitor:
    """Monitor of the position along one direction: is it constant while the model moves on?"""

    def __init__(self) -> None:
        self.since_s = -math.inf
        """Instant since which the position is constant [s]."""
        self.has_stopped = False
        """Whether the vehicle cannot be at rest: it moved before, or is accelerated meanwhile."""
        self.is_driven = False
        """Whether the model has moved far since then, so that a vehicle at rest would have to be
        held."""
        self._position_m = self._before_m_s = self._disturbance_m_s2 = 0.0
        """Constant position [m]; speed [m/s] and disturbance [m/s²] before it: a disturbance that
        is estimated later may be the fault itself."""
        self._model_m = self._model_m_s = 0.0
        """Displacement of the model since then [m], and its present speed [m/s]."""
        self._poses = 0
        """Poses at this position, after the first."""
        self._recent: deque[tuple[float, float]] = deque()
        """Instants [s] and positions [m] of the last ``SPEED_S``."""

    def add_pose(
        self,
        time_s: float,
        position_m: float,
        model_m_s: float,
        commanded_m_s2: float,
        disturbance_m_s2: float,
        dt_s: float,
        range_m: float,
    ) -> None:
        """Take one pose.

        Args:
            time_s: its instant [s].
            position_m: its position [m].
            model_m_s: speed of the model at the pose before [m/s].
            commanded_m_s2: mean acceleration since then by commands and gravity [m/s²].
            disturbance_m_s2: estimated disturbance at the pose before [m/s²].
            dt_s: time since then [s].
            range_m: largest difference of positions that counts as constant [m].
        """
        measured_m_s = self._measure_speed(time_s, position_m, dt_s)
        self.has_stopped = self.is_driven = False
        is_same = abs(position_m - self._position_m) <= range_m
        if is_same and time_s - self.since_s <= STOP_S:
            acceleration_m_s2 = commanded_m_s2 + self._disturbance_m_s2
            self._model_m += dt_s * (self._model_m_s + 0.5 * dt_s * acceleration_m_s2)
            self._model_m_s += dt_s * acceleration_m_s2
            self._poses += 1
            self._judge(time_s - self.since_s, acceleration_m_s2, range_m)
            return
        self.since_s, self._position_m, self._poses = time_s, position_m, 0
        self._disturbance_m_s2 = disturbance_m_s2
        is_moving = model_m_s * measured_m_s > 0.0
        self._before_m_s = min(model_m_s, measured_m_s, key=abs) if is_moving else 0.0
        self._model_m = 0.0
        self._model_m_s = self._before_m_s + dt_s * (commanded_m_s2 + disturbance_m_s2)

    def _measure_speed(self, time_s: float, position_m: float, dt_s: float) -> float:
        """Return the mean speed of the last ``SPEED_S`` by the poses [m/s]; 0 at first."""
        recent = self._recent
        while len(recent) > 1 and recent[1][0] <= time_s - SPEED_S:
            recent.popleft()
        then_s, then_m = recent[0] if recent else (time_s - dt_s, position_m)
        recent.append((time_s, position_m))
        return (position_m - then_m) / (time_s - then_s)

    def _judge(self, lasts_s: float, acceleration_m_s2: float, range_m: float) -> None:
        """Decide whether the model contradicts a position that has been constant for ``lasts_s``
        [s].
        """
        if lasts_s < STOPPED_S or self._poses < STOPPED_POSES:
            return
        # PUSH_M_S2 turns a slower motion back within the range.
        least_m_s = max(STOPPED_M_S, math.sqrt(2.0 * PUSH_M_S2 * range_m))
        least_m_s += MISTIMED_S * abs(acceleration_m_s2)
        least_m = max(3.0 * range_m, STOPPED_M_S * lasts_s)
        if abs(self._model_m_s) <= least_m_s or abs(self._model_m) <= least_m:
            return
        self.is_driven = lasts_s >= DRIVEN_S and abs(self._model_m) > DRIVEN_RANGES * range_m
        is_accelerated = self.is_driven and abs(self._model_m_s) > DRIVEN_M_S2 * lasts_s
        self.has_stopped = abs(self._before_m_s) > least_m_s or is_accelerated


class StopDetector:
    """Detector of a position that stops dead while the model moves on, along each direction of
    :func:`_project`.
    """

    def __init__(self) -> None:
        self._monitors = tuple(StandstillMonitor() for _ in _project((0.0, 0.0, 0.0)))

    @property
    def is_driven(self) -> bool:
        """Whether along a direction the model has moved far since the position is constant."""
        return any(monitor.is_driven for monitor in self._monitors)

    def add_pose(
        self,
        pose: Pose,
        before: Motion,
        commanded: Vec3,
        disturbance: Vec3,
        dt_s: float,
        noise_m: float,
    ) -> float | None:
        """Take one pose; return since when a direction has been frozen [s], None if none is.

        Args:
            pose: the newest one.
            before: motion at the pose before it, which a stop has not affected yet.
            commanded: mean acceleration since then by commands and gravity [m/s², NED].
            disturbance: estimated disturbance before the pose [m/s², NED].
            dt_s: time since then [s].
            noise_m: noise of positions, 1 sigma per axis [m].
        """
        vectors = pose.position_ned, before.velocity, commanded, disturbance
        frozen_since_s = None
        for monitor, *components in zip(self._monitors, *map(_project, vectors), strict=True):
            monitor.add_pose(pose.time_s, *components, dt_s, SIGNIFICANT * noise_m)
            if monitor.has_stopped:
                frozen_since_s = monitor.since_s
        return frozen_since_s


def _project(vector: Vec3) -> tuple[float, ...]:
    """Return the components of a vector [NED] along five directions: north, east, both diagonals of
    these, and down.
    """
    x, y, z = vector
    p, q = DIAGONAL * x, DIAGONAL * y
    return (x, y, p + q, q - p, z)


class YawMonitor:
    """Monitor of the yaw rate beyond all those commanded within the last ``YAW_LATE_S``."""

    def __init__(self) -> None:
        self._commands: deque[tuple[float, float]] = deque()
        """Times [s] and commanded yaw rates [rad/s] of the last ``YAW_LATE_S``."""
        self._rate = 0.0

    def add_pose(
        self, time_s: float, measured_rad_s: float, commanded_rad_s: float, dt_s: float
    ) -> float:
        """Take one pose; return the recent mean of the rate beyond them [rad/s]."""
        commands = self._commands
        commands.append((time_s, commanded_rad_s))
        while commands[0][0] < time_s - YAW_LATE_S:
            commands.popleft()
        rates = [rate for _, rate in commands]
        beyond = min(measured_rad_s - min(rates), 0.0) + max(measured_rad_s - max(rates), 0.0)
        self._rate += min(dt_s / YAW_MEMORY_S, 1.0) * (beyond - self._rate)
        return abs(self._rate)


class ClimbMonitor:
    """Comparison of the height just off the floor with the thrust."""

    def __init__(self, hover_share: float, climb_m_s: float, gravity: float) -> None:
        """Begin at lift-off.

        Args:
            hover_share: hover thrust as a share of the configured weight [-].
            climb_m_s: climb speed [m/s].
            gravity: g [m/s²].
        """
        self._share, self._speed, self._gravity = hover_share, climb_m_s, gravity
        self._measured_m = self._expected_m = self._since_s = 0.0

    @property
    def is_over(self) -> bool:
        """Whether the vehicle has climbed out of the range of this test."""
        return self._measured_m > FIRST_CLIMB_M

    def add_pose(
        self, rise_m: float, impulse_m_s: float, reach_m: float, dt_s: float, noise_m: float
    ) -> bool:
        """Take one pose; return whether the height is behind its thrust.

        Args:
            rise_m: height gained since the pose before [m].
            impulse_m_s: downward speed that the thrust has given since, below 0, for the configured
                mass [m/s].
            reach_m: displacement by that speed [m].
            dt_s: time since then [s].
            noise_m: noise of positions, 1 sigma per axis [m].
        """
        share, g = self._share, self._gravity
        self._measured_m += rise_m
        self._expected_m += dt_s * self._speed - reach_m / share - 0.5 * g * dt_s * dt_s
        self._speed -= impulse_m_s / share + g * dt_s
        self._since_s += dt_s
        tolerance_m = BEHIND_M + 3.0 * noise_m + 0.5 * BEHIND_M_S2 * self._since_s**2
        return self._expected_m - self._measured_m > tolerance_m


class TurnTests:
    """Tests of the turns: the response of roll and pitch, their latency, and the yaw rate."""

    def __init__(self) -> None:
        self._pass = HighPass(2)
        self._response = Response(PLANE, TONE_MEMORY_S, LEAST_TURN_RAD, OWN_TURN)
        self._lateness, self._yaw = LatenessMonitor(), YawMonitor()
        self.yaw_alarm = 0.0
        """Mean yaw rate as a share of what fails the poses [-]."""

    def add(
        self, time_s: float, measured: Vec3, turn: Vec3, tones_rad: tuple[float, float], dt_s: float
    ) -> None:
        """Take one pose.

        Args:
            time_s: its instant [s].
            measured: measured turn since the pose before, body axes [rad].
            turn: turn by the model's rates since then, body axes [rad].
            tones_rad: part of it by the tones, in roll and pitch [rad].
            dt_s: time since then [s].
        """
        x, y, model_x, model_y, u, v = self._pass.step([*measured[:2], *turn[:2], *tones_rad], dt_s)
        self._response.add((x - model_x, y - model_y), (u, v), (model_x - u, model_y - v), dt_s)
        self._lateness.add(time_s, (x, y), (model_x, model_y), dt_s)
        self.yaw_alarm = (
            self._yaw.add_pose(time_s, measured[2] / dt_s, turn[2] / dt_s, dt_s) / YAW_RAD_S
        )

    def look(self) -> Alarm:
        """Return the alarm of all windows that end now."""
        return self._response.look(LEAST_TURN_RAD)

    @property
    def is_late(self) -> bool:
        """Whether the turns are later than the model's."""
        return self._lateness.late_s > 0.0


class PositionTests:
    """Tests of the positions: the lateral response, and that of the height."""

    def __init__(self) -> None:
        self._pass = HighPass(3)
        self._velocity: Vec3 = (0.0, 0.0, 0.0)
        """Velocity of the model [m/s, NED]."""
        self._settled_s = self._interval_s = 0.0
        """Time since the high pass began, and mean interval of the poses [s]."""
        self.model_m: Vec3 = (0.0, 0.0, 0.0)
        """Displacement of the model since the beginning [m, NED]."""
        self.forget()

    def forget(self) -> None:
        """Begin all windows anew."""
        self._lateral = Response(PLANE, TONE_MEMORY_S, LEAST_DISPLACEMENT_M, OWN_LATERAL)
        self._height = Response(LINE, TONE_MEMORY_S, LEAST_DISPLACEMENT_M, OWN_HEIGHT)

    def begin(self, velocity: Vec3) -> None:
        """Begin with ``velocity`` [m/s, NED]."""
        self._velocity = velocity

    def add(
        self,
        measured: Vec3,
        gained_m_s: Vec3,
        gained_m: Vec3,
        tones_m: Vec3 | None,
        dt_s: float,
    ) -> None:
        """Take one pose.

        Args:
            measured: displacement since the pose before [m, NED].
            gained_m_s: change of the velocity by commands and gravity since then [m/s, NED].
            gained_m: displacement by that change [m, NED].
            tones_m: displacement by the tones [m, NED]; None where no command depends on the
                position, so that all motion counts as the tones'.
            dt_s: time since then [s].
        """
        u, v, w = self._velocity
        model = add((dt_s * u, dt_s * v, dt_s * w), gained_m)
        self._velocity = add(self._velocity, gained_m_s)
        self.model_m = add(self.model_m, model)
        sx, sy, sz, mx, my, mz, ux, uy, uz = self._pass.step(
            [*measured, *model, *(tones_m or model)], dt_s
        )
        if tones_m is None:
            ux, uy, uz = mx, my, mz
        self._settled_s += dt_s
        mean_s = self._interval_s or dt_s
        self._interval_s = mean_s + INTERVAL_SHARE * (dt_s - mean_s)
        if self._settled_s > SETTLE_S and dt_s <= OUTAGE_INTERVALS * mean_s:
            self._lateral.add((sx - mx, sy - my), (ux, uy), (mx - ux, my - uy), dt_s)
            self._height.add((sz - mz, 0.0), (uz, 0.0), (mz - uz, 0.0), dt_s)

    def look(self, noise_m: float) -> tuple[Alarm, Alarm]:
        """Return the alarms of the lateral position and of the height, of all windows that end
        now.
        """
        return self._lateral.look(noise_m), self._height.look(noise_m)


class PoseHealth:
    """Health of one flight's poses. Times are on the event loop's clock [s]."""

    def __init__(self, mass_kg: float, gravity: float) -> None:
        """Begin before the flight, with the configured mass [kg] and g [m/s²]."""
        self._per_newton, self._gravity = -1.0 / mass_kg, gravity
        """Acceleration down by one newton of thrust up [m/s² per N], and g [m/s²]."""
        self.state = HealthState.OK
        self.reason_id = ""
        """Id of the sentence why the poses are suspect or have failed; empty while they are OK."""
        self.attitude_alarm = self.position_alarm = self.alarm = 0.0
        """Evidence against attitude, position, and the larger of all, as shares of what fails the
        poses [-]."""
        self.push_alarm = 0.0
        """Acceleration that no command explains, as a share of what fails the position [-]."""
        self.is_confirmed = False
        """Whether the newest responses are known, and confirm the poses."""
        self.calm_s = -math.inf
        """Newest instant at which nothing spoke against the poses [s]."""
        self.believed_until_s = -math.inf
        """Instant up to which the estimate is trusted, should the poses fail now [s]."""
        self.is_attitude_usable = self.is_position_usable = True
        """Whether attitude, and position with heading, may be flown by: no evidence has
        contradicted them, or they have responded since then."""
        self.windows = 0
        """Number of evaluations so far, one each ``BLOCK_S``."""
        self.autopilot_agrees: bool | None = None
        """Whether the autopilot's own attitude agrees with the poses; None if that is not known."""
        self.turn: Vec3 = (0.0, 0.0, 0.0)
        """Turn by the modelled rates since the pose before, body axes [rad]."""
        self._climb: ClimbMonitor | None = None
        self._reset_count = 0
        self._suspect_s = -math.inf
        """Begin of the newest ``SUSPECT`` [s]."""
        self._hover_share = 1.0
        self.restart()

    def set_autopilot_agreement(self, agrees: bool | None) -> None:
        """Set whether the autopilot's own attitude agrees with the poses; None if not known."""
        self.autopilot_agrees = agrees

    def restart(self) -> None:
        """Forget the poses so far: the vehicle was released, or its commands did not arrive."""
        self._turns, self._positions, self._stops = TurnTests(), PositionTests(), StopDetector()
        self._pushes = PushMonitor()
        self._last: Pose | None = None
        self._block_s = 0.0
        self.is_confirmed = False
        self.attitude_alarm = self.position_alarm = self.alarm = self.push_alarm = 0.0

    def lift_off(self, hover_share: float, climb_m_s: float) -> None:
        """Take the state at lift-off: hover thrust as a share of the weight [-], and climb speed
        [m/s].
        """
        self.restart()
        self._hover_share = hover_share
        self._climb = ClimbMonitor(hover_share, climb_m_s, self._gravity)

    @property
    def has_failed(self) -> bool:
        """Whether the poses are not believed any more."""
        return self.state is HealthState.FAILED

    @property
    def is_calm(self) -> bool:
        """Whether nothing speaks against the poses."""
        return self.state is HealthState.OK and max(self.alarm, self.push_alarm) < CALM_ALARM

    @property
    def is_suspect(self) -> bool:
        """Whether the poses are suspect, so that tones are needed."""
        return self.state is HealthState.SUSPECT

    def add_pose(
        self,
        pose: Pose,
        before: Motion,
        response: ActuatorResponse,
        tones_m: Vec3,
        tones_rad: tuple[float, float],
        disturbance: Vec3,
        effectiveness: float,
        noise_m: float,
        moving_noise_m: float,
        *,
        counts: bool,
        may_stop: bool = True,
        is_blind: bool = False,
    ) -> None:
        """Take one believed pose.

        Args:
            pose: the newest one.
            before: motion at the pose before it.
            response: response of the modelled actuators to the commands since.
            tones_m: displacement by the tones since then [m, NED].
            tones_rad: roll and pitch by the tones since then [rad].
            disturbance: estimated disturbance at the pose before [m/s², NED].
            effectiveness: estimated thrust scale [-].
            noise_m: measured noise of positions, 1 sigma per axis [m].
            moving_noise_m: the same with that of the stamps at this speed.
            counts: False where the response says nothing: near the floor, which may hold the
                vehicle, and while the link stalls. All tests begin anew.
            may_stop: False near the floor, which may stop or push the vehicle: stops and pushes
                are not evaluated.
            is_blind: whether no command depends on the position.
        """
        turn = rotation_vector(multiply(conjugate(before.attitude), response.attitude))
        self.turn = turn
        last, self._last = self._last, pose
        dt = 0.0 if last is None else pose.time_s - last.time_s
        is_reset, self._reset_count = pose.reset_count != self._reset_count, pose.reset_count
        if last is None or not 0.0 < dt <= POSE_GAP_S or is_reset or not counts:
            self.restart()
            self._positions.begin(before.velocity)
            self._last, self.turn = pose, turn
            return
        measured = rotation_vector(multiply(conjugate(last.attitude), pose.attitude))
        self._turns.add(pose.time_s, measured, turn, tones_rad, dt)
        self._add_position(pose, last, response, None if is_blind else tones_m, dt, noise_m)
        self.push_alarm = self._pushes.add(
            pose.time_s, pose.position_ned, self._positions.model_m, moving_noise_m
        )
        if may_stop and self.push_alarm >= 1.0:
            # The push was measured over two successive times of PUSH_BASE_S.
            self._fail_part("pose.position_mirrored", pose.time_s - 2.0 * PUSH_BASE_S)
        # An estimate with a velocity of its own uses inertial sensors: it wanders, and does not
        # stop dead.
        if may_stop and pose.velocity_ned is None:
            per_kg, (x, y, z) = effectiveness * self._per_newton / dt, response.impulse
            commanded = (per_kg * x, per_kg * y, per_kg * z + self._gravity)
            self._check_stop(pose, before, commanded, disturbance, dt, noise_m)
        self._block_s += dt
        if self._block_s >= BLOCK_S - ROUNDING_S:
            self._block_s -= BLOCK_S
            self._look(pose.time_s, moving_noise_m)

    def _check_stop(
        self,
        pose: Pose,
        before: Motion,
        commanded: Vec3,
        disturbance: Vec3,
        dt: float,
        noise_m: float,
    ) -> None:
        """Fail the position where it is frozen; suspect it where a vehicle at rest may be held."""
        since_s = self._stops.add_pose(pose, before, commanded, disturbance, dt, noise_m)
        if since_s is not None:
            # Believed are the poses before the first one at the frozen position.
            self._fail_part("pose.stopped_dead", since_s - dt)
        elif self._stops.is_driven:
            self.suspect(pose.time_s)

    def _add_position(
        self,
        pose: Pose,
        last: Pose,
        response: ActuatorResponse,
        tones_m: Vec3 | None,
        dt: float,
        noise_m: float,
    ) -> None:
        """Compare the displacement from ``last`` to ``pose`` with that by the commands; arguments
        as in :meth:`add_pose`.
        """
        # The hover thrust contains the error of the configured thrust scale; the model's
        # acceleration is scaled by it.
        m, g = self._per_newton / self._hover_share, self._gravity
        impulse, reach = response.impulse, response.reach
        gained_m_s = (m * impulse[0], m * impulse[1], m * impulse[2] + g * dt)
        gained_m = (m * reach[0], m * reach[1], m * reach[2] + 0.5 * g * dt * dt)
        measured = subtract(pose.position_ned, last.position_ned)
        if self._climb is not None:
            per_n = self._per_newton
            behind = self._climb.add_pose(
                -measured[2], per_n * impulse[2], per_n * reach[2], dt, noise_m
            )
            self._climb = None if self._climb.is_over else self._climb
            if behind:
                self._fail_part("pose.height_behind", -math.inf)
        self._positions.add(measured, gained_m_s, gained_m, tones_m, dt)

    def _look(self, now_s: float, noise_m: float) -> None:
        """Evaluate all windows that end now."""
        self.windows += 1
        turns, (lateral, height) = self._turns.look(), self._positions.look(noise_m)
        # An autopilot that measures the same attitude proves that of the poses.
        self.attitude_alarm = 0.0 if self.autopilot_agrees else max(turns.tones, turns.own)
        tones, own = max(lateral.tones, height.tones), max(lateral.own, height.own)
        self.position_alarm = max(tones, own, self._turns.yaw_alarm)
        self.alarm = max(self.attitude_alarm, self.position_alarm)
        is_position_known = lateral.is_known and height.is_known
        self.is_confirmed = turns.is_known and is_position_known and self.alarm < SUSPECT_ALARM
        if self.is_attitude_usable and self.alarm < CALM_ALARM:
            self.is_position_usable = self.is_position_usable or is_position_known
        if self.alarm < CALM_ALARM and not self.has_failed:
            self.calm_s = now_s
            self.believed_until_s = now_s - SHORTEST_S
        before_s = self.believed_until_s
        if self._turns.is_late and not self.autopilot_agrees:
            self._fail_part("pose.late", before_s, attitude=True)
        elif self.attitude_alarm >= 1.0:
            self._fail_part("pose.attitude_no_answer", before_s, attitude=True)
        elif self.attitude_alarm >= SUSPECT_ALARM and self.autopilot_agrees is False:
            self._fail_part("pose.autopilot_disagrees", before_s, attitude=True)
        elif self._turns.yaw_alarm >= 1.0:
            self._fail_part("pose.yaw_unasked", before_s)
        elif own >= 1.0:
            self._fail_part("pose.position_mirrored", before_s)
        # One window may err: poses that are OK become suspect first, and larger tones follow.
        elif tones >= 1.0 and self.state is not HealthState.OK:
            self._fail_part("pose.position_no_answer", before_s)
        elif self.alarm >= SUSPECT_ALARM:
            self.suspect(now_s)
        if self.state is HealthState.SUSPECT and (
            self.is_confirmed or now_s - self._suspect_s >= SUSPECT_S
        ):
            self.state, self.reason_id = HealthState.OK, ""

    def suspect(self, now_s: float) -> None:
        """Suspect the poses, for ``SUSPECT_S`` at most."""
        if self.state is HealthState.OK:
            self.state, self.reason_id, self._suspect_s = HealthState.SUSPECT, "pose.suspect", now_s

    def _fail_part(self, reason_id: str, since_s: float, *, attitude: bool = False) -> None:
        """Fail the position, or the ``attitude`` and so both, since ``since_s`` [s]."""
        self.is_attitude_usable = self.is_attitude_usable and not attitude
        self.is_position_usable = False
        self._positions.forget()
        self.fail(reason_id, since_s)

    def fail(self, reason_id: str, since_s: float) -> None:
        """End the flight for the sentence ``reason_id``.

        Poses after ``since_s`` [s] are not believed.
        """
        if self.state is not HealthState.FAILED:
            self.state, self.reason_id = HealthState.FAILED, reason_id
            self.believed_until_s = min(self.believed_until_s, since_s)
