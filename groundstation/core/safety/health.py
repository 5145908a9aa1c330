"""Pose health: are the poses this vehicle's, and new? One state from few tests. Sans-IO.

A pose is believed as long as it answers what we command. The tests, each derived in docs/explanation/trust.md:

- response of attitude, place and height to the commands (:mod:`groundstation.core.safety.pose_response`);
- a picture that stopped dead: along a direction the place stands, though the model moves;
- a turn about the vertical that no command asked for;
- a height that stays behind the thrust, just off the floor.

``SUSPECT`` asks: the pilot flies excitation tones until the answer is known. It changes nothing else. ``FAILED`` is
final: the mission comes down by what still answers.
"""

import math
from collections import deque
from enum import IntEnum
from typing import NamedTuple

from groundstation.core.geometry import Vec3, conjugate, multiply, rotation_vector
from groundstation.core.messages import Pose, Sentence
from groundstation.core.safety.pose_response import (
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
    TURN_MEMORY_S,
    WAY_MEMORY_S,
    Alarm,
    HighPass,
    LatenessMonitor,
    Response,
)
from groundstation.core.vehicle import ActuatorResponse, Motion


class HealthState(IntEnum):
    """Trust in the poses."""

    OK = 0
    SUSPECT = 1
    FAILED = 2


class Failure(NamedTuple):
    """Why a flight ends because of its poses, or of commands that nobody could fly by."""

    id: str
    """Id of the sentence."""
    reason: Sentence
    """What the operator is told."""


SUSPECT_ALARM = 0.5
"""Share of an alarm from which on the poses are asked by tones [-]: half the standard errors that convict."""
SHORTEST_S = BLOCKS[0] * BLOCK_S
"""Length of the shortest window, which may hold the beginning of a fault unseen [s]."""
CALM_ALARM = 0.25
"""Share of an alarm below which the poses are above suspicion [-]: the estimate of that time may be returned to."""
SUSPECT_M_S2 = 2.0
"""Difference of the estimated disturbance from its mean of the last second from which on the poses are asked [m/s²]:
gusts of `storm` come to 1.6."""
ASK_S = 1.0
"""Longest time of one question [s]."""
GAP_S = 0.26
"""Interval of poses after which all tests begin anew [s]: flight.coast_s, after which the model is not believed."""
SETTLE_S = 1.5 / PASS_RAD_S
"""Time until the high pass has forgotten how it began well enough [s]: the speed that it begins
with is known to .1 m/s."""

OUTAGE_INTERVALS = 3.0
"""Time without a pose, in mean intervals, that the next pose does not stand for [-]: a window of .4 s would rest
on one sample of gust and tone."""
INTERVAL_SHARE = 0.2
"""Share of the newest interval in their mean [-]."""

STOPPED_S = 0.15
"""Time for which a moving vehicle's place must stand to be called stopped dead [s]: wind that
reverses a motion holds it within 2 mm for a shorter time."""
SEEN_S = 0.05
"""Time over which the speed of before is measured [s]: that of the model alone is wrong after an outage in
gusts, and a difference of two poses is noise."""
STOPPED_POSES = 4
"""Poses of a place that stands, at least [-]: two poses around an outage may show one place by chance."""
DRIVEN_S = 0.3
"""Time for which a place must stand that did not move before, though commands move the vehicle [s]: then
poses are asked. Wind that the law answers holds it as well."""
DRIVEN_M_S2 = 1.5
"""Mean acceleration of the model meanwhile, beside the wind of before, from which on it is called stopped
[m/s²]: wind that the law answered came to 1.05 in 80 flights of `adverse` and `storm`."""
DRIVEN_WAYS = 10.0
"""Way of the model meanwhile, as a multiple of the room in which a place stands [-]."""
STOP_S = 2.0 * DRIVEN_S
"""Time after which a place that stands is at rest, and no stop [s]: the model would drift from it."""
STOPPED_M_S = 0.15
"""Speed as a place begins to stand, and of the model since [m/s]: only what is struck loses so much
within a pose; slower, noise and wind explain it."""
MISTIMED_S = 0.025
"""Delay of the commands that may be configured wrong [s], and so the model's speed by as much of its acceleration: a
radio's frame period (`alarms --floors`)."""
STANDS_NOISES = 4.0
"""Noise of a place that stands, in standard deviations of one pose [-]: of the difference of two, 2.8 sigma."""

YAW_RAD_S = 0.15
"""Turn about the vertical beyond all that was asked that fails [rad/s]: averaged, `storm` comes to .04."""
YAW_MEMORY_S = 1.0
"""Time constant of that average [s]."""
YAW_LATE_S = 0.55
"""Delay of an autopilot's yaw behind its command [s], at most: PX4 and ArduPilot took .35 s (`autopilots`)."""

CLIMB_M = 0.25
"""Height up to which the height is compared with the thrust directly [m]: the state at lift-off is known."""
BEHIND_M = 0.06
"""Height by which it may stay behind its thrust there, beside noise [m]: the error of the hover thrust at lift-off."""
BEHIND_M_S2 = 1.2
"""The same that grows with the time squared [m/s²]: ground effect and vertical wind."""

STOP_DIRECTIONS = 5
"""Directions along which a place may stand while it moves across them; see :func:`_project`."""


class Stand(NamedTuple):
    """One direction: the place at which it stands, and the model's motion since then."""

    since_s: float
    poses: int
    """Poses since then."""
    place_m: float
    moved_m_s: float
    """Speed before it stood, by the model and by the poses [m/s]: the smaller."""
    disturbance_m_s2: float
    """Disturbance at that time: what is learnt later may be the lie itself."""
    way_m: float
    """Way of the model since then [m]."""
    speed_m_s: float
    """Speed of the model now [m/s]."""


class StopDetector:
    """Detects a place that stopped dead while the model moves on."""

    def __init__(self) -> None:
        self.is_driven = False
        """Whether a place stands that did not move before, though the model moves on."""
        self._stands: list[Stand | None] = [None] * STOP_DIRECTIONS
        self._recent = deque[tuple[float, tuple[float, ...]]]()

    def see(
        self, pose: Pose, before: Motion, push: Vec3, disturbance: Vec3, dt_s: float, noise_m: float
    ) -> float | None:
        """Take one pose; return since when a direction has stood against the model [s], None where none does.

        Args:
            pose: the newest one.
            before: motion at the pose before it, which a stop has not touched yet.
            push: mean acceleration since then by commands and gravity [m/s², NED].
            disturbance: the estimate's before the pose [m/s², NED].
            dt_s: time since then [s].
            noise_m: noise of positions, 1 sigma per axis [m].
        """
        stopped_s, now_s, stands, self.is_driven = None, pose.time_s, self._stands, False
        slow_m_s = max(STOPPED_M_S, 2.0 * STANDS_NOISES * noise_m / STOPPED_S)  # noise alone hides such a way
        places, pushes = _project(pose.position_ned), _project(push)
        others, speeds, recent = _project(disturbance), _project(before.velocity), self._recent
        while len(recent) > 1 and recent[1][0] <= now_s - SEEN_S:
            recent.popleft()
        then_s, from_places = recent[0] if recent else (now_s - dt_s, places)
        recent.append((now_s, places))
        for i, place in enumerate(places):
            stand = stands[i]
            if stand is None or not self._stands_at(stand, now_s, place, noise_m):
                began, other = speeds[i], others[i]
                seen = (place - from_places[i]) / (now_s - then_s)
                moved = min(began, seen, key=abs) if began * seen > 0.0 else 0.0
                speed = moved + dt_s * (pushes[i] + other)
                stands[i] = Stand(now_s, 0, place, moved, other, 0.0, speed)
                continue
            since_s, poses, stood, moved, other, way, speed = stand
            pushed = pushes[i] + other
            way, speed = way + dt_s * (speed + 0.5 * dt_s * pushed), speed + dt_s * pushed
            stands[i] = Stand(since_s, poses + 1, stood, moved, other, way, speed)
            lasts_s = now_s - since_s
            if lasts_s < STOPPED_S or poses < STOPPED_POSES - 1:
                continue
            room_m = STANDS_NOISES * noise_m
            least_m_s = slow_m_s + MISTIMED_S * abs(pushed)
            if abs(speed) <= least_m_s or abs(way) <= max(3.0 * room_m, STOPPED_M_S * lasts_s):
                continue
            driven = lasts_s >= DRIVEN_S and abs(way) > DRIVEN_WAYS * room_m
            self.is_driven |= driven
            if abs(moved) > least_m_s or (driven and abs(way) > 0.5 * DRIVEN_M_S2 * lasts_s * lasts_s):
                stopped_s = since_s
        return stopped_s

    def _stands_at(self, stand: Stand, time_s: float, place_m: float, noise_m: float) -> bool:
        lasts_s = time_s - stand.since_s
        return lasts_s <= STOP_S and abs(place_m - stand.place_m) <= STANDS_NOISES * noise_m


def _project(vector: Vec3) -> tuple[float, ...]:
    """Components of a vector [NED] along the ``STOP_DIRECTIONS``: the axes, and both diagonals of north and east."""
    x, y, z = vector
    p, q = DIAGONAL * x, DIAGONAL * y
    return (x, y, p + q, q - p, z)


class YawMonitor:
    """Averages the turn about the vertical beyond all that was asked of late."""

    def __init__(self) -> None:
        self._times: deque[float] = deque()
        self._asked: deque[float] = deque()
        self._rate = 0.0

    def see(self, time_s: float, seen_rad_s: float, asked_rad_s: float, dt_s: float) -> float:
        """Take one pose; return the averaged rate [rad/s]."""
        times, asked = self._times, self._asked
        times.append(time_s)
        asked.append(asked_rad_s)
        while times[0] < time_s - YAW_LATE_S:
            times.popleft()
            asked.popleft()
        low, high = min(asked), max(asked)
        beyond = min(seen_rad_s - low, 0.0) + max(seen_rad_s - high, 0.0)
        self._rate += min(dt_s / YAW_MEMORY_S, 1.0) * (beyond - self._rate)
        return abs(self._rate)


class ClimbMonitor:
    """Compares the height just off the floor with the thrust."""

    def __init__(self, hover_share: float, climb_m_s: float, gravity: float) -> None:
        """``hover_share``: the thrust that hovers as a share of the weight as configured."""
        self._share, self._speed, self._gravity = hover_share, climb_m_s, gravity
        self._seen_m = self._expected_m = self._since_s = 0.0

    @property
    def is_over(self) -> bool:
        """Whether it has climbed out of the range of this test."""
        return self._seen_m > CLIMB_M

    def see(self, rise_m: float, impulse_m_s: float, reach_m: float, dt_s: float, noise_m: float) -> bool:
        """Take one pose; return whether the height is behind its thrust.

        Args:
            rise_m: height gained since the pose before [m].
            impulse_m_s: speed downwards that the thrust has given since, below 0 [m/s], and
            reach_m: the way of that [m]; both for the mass as configured.
            dt_s: time since then [s].
            noise_m: noise of positions, 1 sigma per axis [m].
        """
        share, g = self._share, self._gravity
        self._seen_m += rise_m
        self._expected_m += dt_s * self._speed - reach_m / share - 0.5 * g * dt_s * dt_s
        self._speed -= impulse_m_s / share + g * dt_s
        self._since_s += dt_s
        room = BEHIND_M + 3.0 * noise_m + 0.5 * BEHIND_M_S2 * self._since_s**2
        return self._expected_m - self._seen_m > room


class TurnTests:
    """Tests of the turns: the answer of roll and pitch, their latency, and the turn about the vertical."""

    def __init__(self) -> None:
        self._pass = HighPass(2, 6)
        self._response = Response(PLANE, TURN_MEMORY_S, LEAST_TURN_RAD, OWN_TURN)
        self._lateness, self._yaw = LatenessMonitor(), YawMonitor()
        self.yaw_alarm = 0.0
        """Turn about the vertical as a share of what fails [-]."""

    def add(self, time_s: float, seen: Vec3, turn: Vec3, asked_rad: tuple[float, float], dt_s: float) -> None:
        """Take the turn ``seen`` since the pose before, that of the model, and the tones' in roll and pitch [rad]."""
        x, y, model_x, model_y, u, v = self._pass.step([*seen[:2], *turn[:2], *asked_rad], dt_s)
        self._response.add((x - model_x, y - model_y), (u, v), (model_x - u, model_y - v), dt_s)
        self._lateness.add(time_s, (x, y), (model_x, model_y), dt_s)
        self.yaw_alarm = self._yaw.see(time_s, seen[2] / dt_s, turn[2] / dt_s, dt_s) / YAW_RAD_S

    def look(self) -> Alarm:
        """Return the alarm of all windows that end now."""
        return self._response.look(LEAST_TURN_RAD)

    @property
    def is_late(self) -> bool:
        """Whether the turns come later than the model's."""
        return self._lateness.late_s > 0.0


class PlaceTests:
    """Tests of the places: the answer across, and that of the height."""

    def __init__(self) -> None:
        self._pass = HighPass(3, 9)
        self._speed: Vec3 = (0.0, 0.0, 0.0)
        self._settled_s = self._interval_s = 0.0
        self.forget()

    def forget(self) -> None:
        """Begin all windows anew."""
        self._across = Response(PLANE, WAY_MEMORY_S, LEAST_WAY_M, OWN_WAY)
        self._height = Response(LINE, WAY_MEMORY_S, LEAST_WAY_M, OWN_HEIGHT)

    def begin(self, speed: Vec3) -> None:
        """Begin with ``speed`` [m/s, NED]."""
        self._speed = speed

    def add(self, seen: Vec3, push: Vec3, way: Vec3, asked_m: Vec3 | None, dt_s: float) -> None:
        """Take one pose.

        Args:
            seen: way since the pose before [m, NED].
            push: speed that commands and gravity have given since [m/s, NED].
            way: their way beside that of the speed before [m, NED].
            asked_m: way of the tones [m, NED]; None where all that commands make is asked for.
            dt_s: time since then [s].
        """
        u, v, w = self._speed
        model = (dt_s * u + way[0], dt_s * v + way[1], dt_s * w + way[2])
        self._speed = (u + push[0], v + push[1], w + push[2])
        sx, sy, sz, mx, my, mz, ux, uy, uz = self._pass.step([*seen, *model, *(asked_m or model)], dt_s)
        if asked_m is None:
            ux, uy, uz = mx, my, mz
        self._settled_s += dt_s
        mean_s = self._interval_s or dt_s
        self._interval_s = mean_s + INTERVAL_SHARE * (dt_s - mean_s)
        if self._settled_s > SETTLE_S and dt_s <= OUTAGE_INTERVALS * mean_s:
            self._across.add((sx - mx, sy - my), (ux, uy), (mx - ux, my - uy), dt_s)
            self._height.add((sz - mz,), (uz,), (mz - uz,), dt_s)

    def look(self, noise_m: float) -> tuple[Alarm, Alarm]:
        """Return the alarms across and of the height, of all windows that end now."""
        return self._across.look(noise_m), self._height.look(noise_m)


class PoseHealth:
    """Health of one flight's poses. Times are on the event loop's clock [s]."""

    def __init__(self, mass_kg: float, gravity: float) -> None:
        """Begin before the flight; mass [kg] as configured, g [m/s²]."""
        self._per_newton, self._gravity = -1.0 / mass_kg, gravity
        self.state = HealthState.OK
        self.reason_id = ""
        """Id of the sentence that says why the poses failed or are suspected; empty while they are not."""
        self.attitude_alarm = self.position_alarm = self.alarm = 0.0
        """Evidence against attitude, position, and the larger of all, as shares of what convicts [-]."""
        self.is_confirmed = False
        """Whether the newest answers are known, and say that the poses are true."""
        self.calm_s = -math.inf
        """Newest instant at which the poses were above suspicion [s]."""
        self.believed_until_s = -math.inf
        """Instant up to which the estimate is believed, should the poses fail now [s]."""
        self.attitude_answers = self.position_answers = True
        """Whether attitude, and place with heading, may be flown by: no evidence has contradicted them, or they have
        answered since then."""
        self.windows = 0
        """Evaluations so far."""
        self.autopilot_agrees: bool | None = None
        """Whether the autopilot's own attitude agrees with the poses; None where it does not tell."""
        self.turn: Vec3 = (0.0, 0.0, 0.0)
        """Turn by the modelled rates since the pose before, body axes [rad]."""
        self._climb: ClimbMonitor | None = None
        self._reset_count = 0
        self._asked_s = -math.inf
        self._hover_share = 1.0
        self.restart()

    def restart(self) -> None:
        """Forget the poses so far: the vehicle is let go, or its commands did not arrive."""
        self._turns, self._places, self._stops = TurnTests(), PlaceTests(), StopDetector()
        self._last: Pose | None = None
        self._block_s = 0.0
        self.is_confirmed = False
        self.attitude_alarm = self.position_alarm = self.alarm = 0.0

    def lift_off(self, hover_share: float, climb_m_s: float) -> None:
        """Take the state at lift-off: thrust that hovers as a share of the weight, and speed upwards [m/s]."""
        self.restart()
        self._hover_share = hover_share
        self._climb = ClimbMonitor(hover_share, climb_m_s, self._gravity)

    @property
    def has_failed(self) -> bool:
        """Whether the poses are not believed any more."""
        return self.state is HealthState.FAILED

    @property
    def asks(self) -> bool:
        """Whether the poses are to be asked by tones."""
        return self.state is HealthState.SUSPECT

    def see(
        self,
        pose: Pose,
        before: Motion,
        given: ActuatorResponse,
        asked_m: Vec3,
        asked_rad: tuple[float, float],
        disturbance: Vec3,
        effectiveness: float,
        noise_m: float,
        *,
        counts: bool,
        may_stop: bool = True,
        is_blind: bool = False,
    ) -> None:
        """Take one believed pose.

        Args:
            pose: the newest one.
            before: motion at the pose before it.
            given: what the commands have made of that motion since.
            asked_m: way of the tones since then [m, NED].
            asked_rad: roll and pitch of the tones since then [rad].
            disturbance: estimated disturbance at the pose before [m/s², NED].
            effectiveness: estimated thrust scale [-].
            noise_m: noise of positions as measured, 1 sigma per axis [m].
            counts: False near the floor, which holds the vehicle.
            may_stop: False where the floor may stop it dead.
            is_blind: whether no command follows the place: then all that they make is asked for from outside.
        """
        turn = rotation_vector(multiply(conjugate(before.attitude), given[0]))
        self.turn = turn
        last, self._last = self._last, pose
        dt = 0.0 if last is None else pose.time_s - last.time_s
        moved, self._reset_count = pose.reset_count != self._reset_count, pose.reset_count
        if last is None or not 0.0 < dt <= GAP_S or moved or not counts:
            self.restart()
            self._places.begin(before.velocity)
            self._last, self.turn = pose, turn
            return
        seen = rotation_vector(multiply(conjugate(last.attitude), pose.attitude))
        self._turns.add(pose.time_s, seen, turn, asked_rad, dt)
        self._see_place(pose, last, given, None if is_blind else asked_m, dt, noise_m)
        per_kg, (x, y, z) = effectiveness * self._per_newton / dt, given[3]
        push = (per_kg * x, per_kg * y, per_kg * z + self._gravity)
        # An estimate with a speed of its own rests on inertial sensors: it wanders, and does not stop dead.
        if may_stop and pose.velocity_ned is None:
            since_s = self._stops.see(pose, before, push, disturbance, dt, noise_m)
            if since_s is not None:
                self._accuse("pose.stopped_dead", since_s - dt)
            elif self._stops.is_driven:
                self.suspect(pose.time_s)
        self._block_s += dt
        if self._block_s >= BLOCK_S - 1e-6:
            self._block_s -= BLOCK_S
            self._look(pose.time_s, noise_m)

    def _see_place(
        self, pose: Pose, last: Pose, given: ActuatorResponse, asked_m: Vec3 | None, dt: float, noise_m: float
    ) -> None:
        # A thrust scale that is configured wrong shows in the thrust that hovers; the model's push is scaled by it.
        m, g = self._per_newton / self._hover_share, self._gravity
        _, _, _, impulse, reach = given
        push = (m * impulse[0], m * impulse[1], m * impulse[2] + g * dt)
        way = (m * reach[0], m * reach[1], m * reach[2] + 0.5 * g * dt * dt)
        (px, py, pz), (qx, qy, qz) = pose.position_ned, last.position_ned
        seen = (px - qx, py - qy, pz - qz)
        if self._climb is not None:
            per_n = self._per_newton
            behind = self._climb.see(-seen[2], per_n * impulse[2], per_n * reach[2], dt, noise_m)
            self._climb = None if self._climb.is_over else self._climb
            if behind:
                self._accuse("pose.height_behind", -math.inf)
        self._places.add(seen, push, way, asked_m, dt)

    def _look(self, now_s: float, noise_m: float) -> None:
        """Evaluate all windows that end now."""
        self.windows += 1
        turns, (places, heights) = self._turns.look(), self._places.look(noise_m)
        self.attitude_alarm = 0.0 if self.autopilot_agrees else max(turns.asked, turns.own)
        answers, images = max(places.asked, heights.asked), max(places.own, heights.own)
        self.position_alarm = max(answers, images, self._turns.yaw_alarm)
        self.alarm = max(self.attitude_alarm, self.position_alarm)
        self.is_confirmed = turns.is_known and places.is_known and self.alarm < SUSPECT_ALARM
        if self.attitude_answers and self.alarm < CALM_ALARM:
            self.position_answers = self.position_answers or (places.is_known and heights.is_known)
        if self.alarm < CALM_ALARM and not self.has_failed:
            self.calm_s = now_s
            self.believed_until_s = now_s - SHORTEST_S
        before_s = self.believed_until_s
        if self._turns.is_late and not self.autopilot_agrees:
            self._accuse("pose.late", before_s, attitude=True)
        elif self.attitude_alarm >= 1.0:
            self._accuse("pose.attitude_no_answer", before_s, attitude=True)
        elif self.attitude_alarm >= SUSPECT_ALARM and self.autopilot_agrees is False:
            self._accuse("pose.autopilot_disagrees", before_s, attitude=True)
        elif self._turns.yaw_alarm >= 1.0:
            self._accuse("pose.yaw_unasked", before_s)
        elif images >= 1.0:
            self._accuse("pose.position_mirrored", before_s)
        elif answers >= 1.0:
            self._accuse("pose.position_no_answer", before_s)
        elif self.alarm >= SUSPECT_ALARM:
            self.suspect(now_s)
        if self.state is HealthState.SUSPECT and (self.is_confirmed or now_s - self._asked_s >= ASK_S):
            self.state, self.reason_id = HealthState.OK, ""

    def suspect(self, now_s: float) -> None:
        """Ask the poses by tones, for ``ASK_S`` at most."""
        if self.state is HealthState.OK:
            self.state, self.reason_id, self._asked_s = HealthState.SUSPECT, "pose.suspect", now_s

    def _accuse(self, reason_id: str, since_s: float, *, attitude: bool = False) -> None:
        """Take evidence against the position, or the ``attitude`` and so both, since ``since_s`` [s]."""
        self.attitude_answers = self.attitude_answers and not attitude
        self.position_answers = False
        self._places.forget()
        self.fail(reason_id, since_s)

    def fail(self, reason_id: str, since_s: float) -> None:
        """End the flight for the sentence ``reason_id``; what poses showed after ``since_s`` [s] is not believed."""
        if self.state is not HealthState.FAILED:
            self.state, self.reason_id = HealthState.FAILED, reason_id
            self.believed_until_s = min(self.believed_until_s, since_s)
