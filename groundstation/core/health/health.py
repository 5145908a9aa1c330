"""Pose health: are the poses this vehicle's, and new? One state from few tests. Sans-IO.

A pose is believed as long as it responds to the commands. The tests, each derived in
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
    LEAST_TURN_RAD,
    LEAST_WAY_M,
    LINE,
    OWN_HEIGHT,
    OWN_TURN,
    OWN_WAY,
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
"""Alarm below which the poses are above suspicion [-]: the estimate of that time may be returned
to."""
SUSPECT_M_S2 = 2.0
"""Difference of the estimated disturbance from its mean of the last seconds from which the poses
are suspect [m/s²]: gusts of `storm` come to 1.6."""
SUSPECT_S = 1.0
"""Longest duration of ``SUSPECT`` [s]."""
SETTLE_S = 1.5 / PASS_RAD_S
"""Time until the initial speed of the high pass, known to .1 m/s, has no more effect [s]."""

OUTAGE_INTERVALS = 3.0
"""Interval from which a pose is after an outage, and not evaluated, in mean intervals [-]: a window
of .4 s would depend on one sample of gust and tone."""
INTERVAL_SHARE = 0.2
"""Weight of the newest interval in their mean [-]."""

STOPPED_S = 0.15
"""Time for which the position of a moving vehicle must be constant to be frozen [s]: wind that
reverses a motion keeps it within 2 mm for a shorter time."""
SPEED_S = 0.05
"""Time over which the speed before that is measured [s]: the model's alone is wrong after an outage
in gusts, and a difference of two poses is noise."""
STOPPED_POSES = 4
"""Least number of poses at a constant position [-]: two poses around an outage may agree by
chance."""
DRIVEN_S = 0.3
"""Time for which the position of a vehicle at rest must be constant, though commands accelerate it,
to be suspect [s]: wind that the law rejects has the same effect."""
DRIVEN_M_S2 = 1.5
"""Mean acceleration of the model meanwhile, beside the wind before, from which the position is
frozen [m/s²]: wind that the law rejected came to 1.10 in 60 flights of `adverse` and `storm`."""
DRIVEN_WAYS = 10.0
"""Displacement of the model meanwhile, as a multiple of the range that counts as constant [-]."""
STOP_S = 2.0 * DRIVEN_S
"""Time after which a constant position is a vehicle at rest, not a stop [s]: the model would drift
from it."""
STOPPED_M_S = 0.15
"""Least speed before a stop, and of the model since [m/s]: only a collision takes so much within a
pose; less is explained by wind. Where noise hides more than 1 mm, the speed counts that a push
turns back within it."""
MISTIMED_S = 0.025
"""Delay of the commands that may be configured wrong [s], and so the model's speed by as much of
its acceleration: a radio's frame period (`alarms --floors`)."""

YAW_RAD_S = 0.15
"""Mean yaw rate beyond the commanded ones that fails the poses [rad/s]: `storm` comes to .04."""
YAW_MEMORY_S = 1.0
"""Time constant of that mean [s]."""
YAW_LATE_S = 0.55
"""Largest delay of an autopilot's yaw behind its command [s]: PX4 and ArduPilot took .35 s
(`autopilots`)."""

BEHIND_M = 0.06
"""Height that may be missing there, beside noise [m]: the error of the hover thrust at lift-off."""
BEHIND_M_S2 = 1.2
"""Vertical acceleration that may be missing there [m/s²]: ground effect and vertical wind."""


class Standstill(NamedTuple):
    """One direction: the position at which it is constant, and the model's motion since then."""

    since_s: float
    poses: int
    """Poses since then."""
    position_m: float
    moved_m_s: float
    """Speed before that, by the model and by the poses [m/s]: the smaller."""
    disturbance_m_s2: float
    """Disturbance before that: what is learnt later may be the fault itself."""
    way_m: float
    """Displacement of the model since then [m]."""
    speed_m_s: float
    """Speed of the model now [m/s]."""


class StopDetector:
    """Detector of a position that stops dead while the model moves on, along each direction of
    :func:`_project`.
    """

    def __init__(self) -> None:
        self.is_driven = False
        """Whether a position at rest stays constant, though the model moves on."""
        self._stops: list[Standstill] = []
        """One for each direction; empty before the first pose."""
        self._recent = deque[tuple[float, tuple[float, ...]]]()

    def add_pose(
        self, pose: Pose, before: Motion, push: Vec3, disturbance: Vec3, dt_s: float, noise_m: float
    ) -> float | None:
        """Take one pose; return since when a direction has been frozen [s], None if none is.

        Args:
            pose: the newest one.
            before: motion at the pose before it, which a stop has not affected yet.
            push: mean acceleration since then by commands and gravity [m/s², NED].
            disturbance: estimated disturbance before the pose [m/s², NED].
            dt_s: time since then [s].
            noise_m: noise of positions, 1 sigma per axis [m].
        """
        stopped_s, now_s, room_m, self.is_driven = None, pose.time_s, SIGNIFICANT * noise_m, False
        # A push turns a slower motion back within it.
        slow_m_s = max(STOPPED_M_S, math.sqrt(2.0 * PUSH_M_S2 * room_m))
        positions, pushes = _project(pose.position_ned), _project(push)
        others, speeds, recent = _project(disturbance), _project(before.velocity), self._recent
        while len(recent) > 1 and recent[1][0] <= now_s - SPEED_S:
            recent.popleft()
        then_s, from_positions = recent[0] if recent else (now_s - dt_s, positions)
        recent.append((now_s, positions))
        stops, self._stops = self._stops, []
        for i, position in enumerate(positions):
            stop = stops[i] if stops else None
            is_same = stop is not None and abs(position - stop.position_m) <= room_m
            if stop is None or not is_same or now_s - stop.since_s > STOP_S:
                began, other = speeds[i], others[i]
                measured = (position - from_positions[i]) / (now_s - then_s)
                moved = min(began, measured, key=abs) if began * measured > 0.0 else 0.0
                speed = moved + dt_s * (pushes[i] + other)
                self._stops.append(Standstill(now_s, 0, position, moved, other, 0.0, speed))
                continue
            since_s, poses, _, moved, other, way, speed = stop
            pushed = pushes[i] + other
            way, speed = way + dt_s * (speed + 0.5 * dt_s * pushed), speed + dt_s * pushed
            self._stops.append(stop._replace(poses=poses + 1, way_m=way, speed_m_s=speed))
            lasts_s = now_s - since_s
            if lasts_s < STOPPED_S or poses < STOPPED_POSES - 1:
                continue
            least_m_s = slow_m_s + MISTIMED_S * abs(pushed)
            if abs(speed) <= least_m_s or abs(way) <= max(3.0 * room_m, STOPPED_M_S * lasts_s):
                continue
            driven = lasts_s >= DRIVEN_S and abs(way) > DRIVEN_WAYS * room_m
            self.is_driven |= driven
            is_pushed = driven and abs(speed) > DRIVEN_M_S2 * lasts_s
            if abs(moved) > least_m_s or is_pushed:
                stopped_s = since_s
        return stopped_s


def _project(vector: Vec3) -> tuple[float, ...]:
    """Components of a vector [NED] along five directions: the axes, and both diagonals of north and
    east.
    """
    x, y, z = vector
    p, q = DIAGONAL * x, DIAGONAL * y
    return (x, y, p + q, q - p, z)


class YawMonitor:
    """Mean yaw rate of late beyond the commanded ones."""

    def __init__(self) -> None:
        self._commands: deque[tuple[float, float]] = deque()
        """Times [s] and commanded yaw rates [rad/s] of the last ``YAW_LATE_S``."""
        self._rate = 0.0

    def add_pose(
        self, time_s: float, measured_rad_s: float, commanded_rad_s: float, dt_s: float
    ) -> float:
        """Take one pose; return the mean rate [rad/s]."""
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
        """``hover_share``: hover thrust as a share of the configured weight [-].

        ``climb_m_s``: climb speed [m/s].
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
        room = BEHIND_M + 3.0 * noise_m + 0.5 * BEHIND_M_S2 * self._since_s**2
        return self._expected_m - self._measured_m > room


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
        """Take the ``measured`` turn since the pose before, the model's, and the tones' in roll and
        pitch [rad].
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


class PlaceTests:
    """Tests of the positions: the lateral response, and that of the height."""

    def __init__(self) -> None:
        self._pass = HighPass(3)
        self._speed: Vec3 = (0.0, 0.0, 0.0)
        self._settled_s = self._interval_s = 0.0
        self.model_m: Vec3 = (0.0, 0.0, 0.0)
        """Displacement of the model since the begin [m, NED]."""
        self.forget()

    def forget(self) -> None:
        """Begin all windows anew."""
        self._across = Response(PLANE, TONE_MEMORY_S, LEAST_WAY_M, OWN_WAY)
        self._height = Response(LINE, TONE_MEMORY_S, LEAST_WAY_M, OWN_HEIGHT)

    def begin(self, speed: Vec3) -> None:
        """Begin with ``speed`` [m/s, NED]."""
        self._speed = speed

    def add(self, measured: Vec3, push: Vec3, way: Vec3, tones_m: Vec3 | None, dt_s: float) -> None:
        """Take one pose.

        Args:
            measured: displacement since the pose before [m, NED].
            push: speed that commands and gravity have given since [m/s, NED].
            way: their displacement beside that by the speed before [m, NED].
            tones_m: displacement by the tones [m, NED]; None where no command depends on the
                position, so that all motion counts as the tones'.
            dt_s: time since then [s].
        """
        u, v, w = self._speed
        model = (dt_s * u + way[0], dt_s * v + way[1], dt_s * w + way[2])
        self._speed = (u + push[0], v + push[1], w + push[2])
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
            self._across.add((sx - mx, sy - my), (ux, uy), (mx - ux, my - uy), dt_s)
            self._height.add((sz - mz,), (uz,), (mz - uz,), dt_s)

    def look(self, noise_m: float) -> tuple[Alarm, Alarm]:
        """Return the alarms of the lateral position and of the height, of all windows that end
        now.
        """
        return self._across.look(noise_m), self._height.look(noise_m)


class PoseHealth:
    """Health of one flight's poses. Times are on the event loop's clock [s]."""

    def __init__(self, mass_kg: float, gravity: float) -> None:
        """Begin before the flight; configured mass [kg], g [m/s²]."""
        self._per_newton, self._gravity = -1.0 / mass_kg, gravity
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
        """Newest instant at which the poses were above suspicion [s]."""
        self.believed_until_s = -math.inf
        """Instant up to which the estimate is believed, should the poses fail now [s]."""
        self.is_attitude_usable = self.is_position_usable = True
        """Whether attitude, and position with heading, may be flown by: no evidence has
        contradicted them, or they have responded since then."""
        self.windows = 0
        """Evaluations so far."""
        self.autopilot_agrees: bool | None = None
        """Whether the autopilot's own attitude agrees with the poses; None if that is not known."""
        self.turn: Vec3 = (0.0, 0.0, 0.0)
        """Turn by the modelled rates since the pose before, body axes [rad]."""
        self._climb: ClimbMonitor | None = None
        self._reset_count = 0
        self._suspect_s = -math.inf
        self._hover_share = 1.0
        self.restart()

    def restart(self) -> None:
        """Forget the poses so far: the vehicle was released, or its commands did not arrive."""
        self._turns, self._places, self._stops = TurnTests(), PlaceTests(), StopDetector()
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
            counts: False near the floor, which may hold the vehicle.
            may_stop: False where the floor may stop the vehicle dead.
            is_blind: whether no command depends on the position.
        """
        turn = rotation_vector(multiply(conjugate(before.attitude), response.attitude))
        self.turn = turn
        last, self._last = self._last, pose
        dt = 0.0 if last is None else pose.time_s - last.time_s
        moved, self._reset_count = pose.reset_count != self._reset_count, pose.reset_count
        if last is None or not 0.0 < dt <= POSE_GAP_S or moved or not counts:
            self.restart()
            self._places.begin(before.velocity)
            self._last, self.turn = pose, turn
            return
        measured = rotation_vector(multiply(conjugate(last.attitude), pose.attitude))
        self._turns.add(pose.time_s, measured, turn, tones_rad, dt)
        self._add_position(pose, last, response, None if is_blind else tones_m, dt, noise_m)
        self.push_alarm = self._pushes.add(
            pose.time_s, pose.position_ned, self._places.model_m, moving_noise_m
        )
        if may_stop and self.push_alarm >= 1.0:
            self._fail_part("pose.position_mirrored", pose.time_s - 2.0 * PUSH_BASE_S)
        # An estimate with a velocity of its own uses inertial sensors: it wanders, and does not
        # stop dead.
        if may_stop and pose.velocity_ned is None:
            per_kg, (x, y, z) = effectiveness * self._per_newton / dt, response.impulse
            push = (per_kg * x, per_kg * y, per_kg * z + self._gravity)
            self._check_stop(pose, before, push, disturbance, dt, noise_m)
        self._block_s += dt
        if self._block_s >= BLOCK_S - ROUNDING_S:
            self._block_s -= BLOCK_S
            self._look(pose.time_s, moving_noise_m)

    def _check_stop(
        self, pose: Pose, before: Motion, push: Vec3, disturbance: Vec3, dt: float, noise_m: float
    ) -> None:
        """Fail the position where the poses stopped dead; suspect it where they seem to."""
        since_s = self._stops.add_pose(pose, before, push, disturbance, dt, noise_m)
        if since_s is not None:
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
        # The hover thrust contains the error of the configured thrust scale; the model's
        # acceleration is scaled by it.
        m, g = self._per_newton / self._hover_share, self._gravity
        impulse, reach = response.impulse, response.reach
        push = (m * impulse[0], m * impulse[1], m * impulse[2] + g * dt)
        way = (m * reach[0], m * reach[1], m * reach[2] + 0.5 * g * dt * dt)
        measured = subtract(pose.position_ned, last.position_ned)
        if self._climb is not None:
            per_n = self._per_newton
            behind = self._climb.add_pose(
                -measured[2], per_n * impulse[2], per_n * reach[2], dt, noise_m
            )
            self._climb = None if self._climb.is_over else self._climb
            if behind:
                self._fail_part("pose.height_behind", -math.inf)
        self._places.add(measured, push, way, tones_m, dt)

    def _look(self, now_s: float, noise_m: float) -> None:
        """Evaluate all windows that end now."""
        self.windows += 1
        turns, (places, heights) = self._turns.look(), self._places.look(noise_m)
        self.attitude_alarm = 0.0 if self.autopilot_agrees else max(turns.tones, turns.own)
        tones, own = max(places.tones, heights.tones), max(places.own, heights.own)
        self.position_alarm = max(tones, own, self._turns.yaw_alarm)
        self.alarm = max(self.attitude_alarm, self.position_alarm)
        is_position_known = places.is_known and heights.is_known
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
        elif tones >= 1.0:
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
        self._places.forget()
        self.fail(reason_id, since_s)

    def fail(self, reason_id: str, since_s: float) -> None:
        """End the flight for the sentence ``reason_id``.

        Poses after ``since_s`` [s] are not believed.
        """
        if self.state is not HealthState.FAILED:
            self.state, self.reason_id = HealthState.FAILED, reason_id
            self.believed_until_s = min(self.believed_until_s, since_s)
