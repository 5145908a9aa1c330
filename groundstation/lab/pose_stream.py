"""Pose stream: its rate, age, jitter, gaps, place, noise, and what the moves of a carried vehicle
say of it. Sans-IO.

Axis calibration: poses are taken in the tracker's own axes: which those are is what the moves are
to tell. The turns alone tell how the tracked body lies on the vehicle, R_FB: v_F = R_FB v_B for
every rotation vector, where v_F is the autopilot's, or else the shown one. That and the first rest
tell how the lab lies, R_NL = R_FB R_LBᵀ, north being where the nose was. What is left is a check:
the shifts must go where the turns say that up, forward and right are. A mirrored tracker turns all
of them around at once, as turns are axial vectors and shifts are not. Wahba's problem by singular
values: F. L. Markley, J. Astronautical Sciences 36 (1988).
"""

import math
import operator
from collections import Counter, deque
from itertools import pairwise
from statistics import fmean, pstdev
from typing import TYPE_CHECKING, Any, Literal, get_args

import msgspec
import numpy as np

from groundstation.core.estimation import SIGNIFICANT, fourth_difference
from groundstation.core.geometry import (
    Alignment,
    Body,
    Frames,
    Quat,
    Vec3,
    World,
    axes,
    conjugate,
    euler_zyx,
    multiply,
    rotation_vector,
    so3,
)
from groundstation.core.health import PoseLatency
from groundstation.core.messages import Excess, Pose, PoseStatus, notice
from links.core import Attitude
from links.text import Sentence

if TYPE_CHECKING:
    from numpy.typing import NDArray


WINDOW_S = 2.0
"""Jitter and noise are those of the last so many seconds [s]."""
REST_M = 0.002
"""At rest, the means of the window's two halves differ by less than this, plus ``SIGNIFICANT``
times the noise of one pose [m]."""
KEPT_EVENTS = 5
"""Newest events kept: as many as are shown below the table."""


class PoseStreamSummary(msgspec.Struct, frozen=True, kw_only=True):
    """A stream of poses as it is now."""

    poses: int
    """That have passed the gate."""
    rate_hz: float
    """Arrivals per second, over the window [1/s]."""
    source_rate_hz: float
    """Rate by the source's own stamps [1/s]; 0 where there are too few."""
    age_s: float | None
    """Time since the newest pose was true [s]; None before the first, and of a recording."""
    latency_s: float
    """Mean time from the instant of a pose to its arrival [s]."""
    latency_max_s: float
    """The longest [s]."""
    jitter_s: float
    """Standard deviation of the time from one arrival to the next [s]."""
    longest_s: float
    """The longest time from one arrival to the next, of all [s]."""
    gaps: int
    """Number of gaps."""
    clock_steps: int
    """Number of steps and restarts of the source's clock."""
    drift: float | None
    """Drift of the source's clock: slower than ours by this share [-]; None of a recording."""
    advice: str
    """The source's finding why no poses come; empty where there is none."""
    stamp_fault: str
    """Fault of the time stamps, unit or clock; empty where there is none."""
    position_ned: Vec3 | None
    """[m]"""
    floor_z_m: float
    """Down coordinate of the floor, from which heights count [m]."""
    roll_pitch_yaw_deg: Vec3 | None
    at_rest: bool
    """Whether the vehicle stood still for the whole window."""
    noise_m: Vec3 | None
    """Standard deviation north, east, down while at rest [m]; None where it moves."""
    noise_deg: Vec3 | None
    """Attitude noise about the body's axes forward, right, down, 1σ [deg]."""
    dropped: dict[str, int]
    """Counts by reason."""
    excesses: dict[str, Excess]
    """Value and limit of the newest drop by reason, where there is a limit."""
    bodies: tuple[str, ...]
    """Names that the source has told, where ours was not among them or it tells all."""
    events: tuple[str, ...]
    """The newest, oldest first, each ``12.3 text`` with the seconds since the start."""

    @property
    def ok(self) -> bool:
        """Whether poses arrive now, of one sender, and their stamps show their age."""
        return (
            not self.stamp_fault
            and not self.advice
            and self.age_s is not None
            and self.rate_hz > 0.0
        )


class PoseStreamMonitor:
    """Remembers what it takes to say that; times are on the event loop's clock [s]."""

    def __init__(self, begun_s: float, *, floor_z_m: float = 0.0) -> None:
        """Begin at ``begun_s`` [s]; ``floor_z_m`` is the down coordinate of the floor [m]."""
        self._floor_z_m = floor_z_m
        self._begun_s = begun_s
        self._recent: deque[Pose] = deque()
        self._events: deque[str] = deque(maxlen=KEPT_EVENTS)
        self._longest_s = 0.0
        self._poses = 0

    def pose(self, pose: Pose) -> None:
        """One more."""
        if self._recent:
            self._longest_s = max(self._longest_s, pose.arrival_s - self._recent[-1].arrival_s)
        self._poses += 1
        self._recent.append(pose)
        while len(self._recent) > 2 and self._recent[0].arrival_s < pose.arrival_s - WINDOW_S:
            self._recent.popleft()

    def event(self, event: Sentence, now_s: float) -> None:
        """Something happened to them."""
        self._events.append(f"{now_s - self._begun_s:.1f} {event}")

    def summarize(
        self,
        now_s: float,
        status: PoseStatus,
        bodies: tuple[str, ...] = (),
        *,
        stamp_fault: str = "",
    ) -> PoseStreamSummary:
        """All of it; ``status`` and ``bodies`` are the source's, ``stamp_fault`` is what is wrong
        with its stamps.
        """
        newest = self._recent[-1] if self._recent else None
        recent = [pose for pose in self._recent if pose.arrival_s > now_s - WINDOW_S]
        apart = [b.arrival_s - a.arrival_s for a, b in pairwise(recent)]
        window_s = min(WINDOW_S, now_s - self._begun_s)
        noise = _at_rest(recent) if window_s >= WINDOW_S else None
        return PoseStreamSummary(
            poses=self._poses,
            rate_hz=(
                len(apart) / sum(apart)
                if len(recent) > 1 and now_s - recent[-1].arrival_s < 1.0
                else 0.0
            ),
            source_rate_hz=status.rate_hz,
            age_s=None if newest is None else now_s - newest.time_s,
            latency_s=status.latency_s,
            latency_max_s=status.latency_max_s,
            jitter_s=pstdev(apart) if apart else 0.0,
            longest_s=self._longest_s,
            gaps=status.gaps,
            clock_steps=status.clock_steps + status.clock_restarts,
            drift=status.drift,
            advice=status.advice,
            stamp_fault=stamp_fault,
            floor_z_m=self._floor_z_m,
            position_ned=None if newest is None else newest.position_ned,
            roll_pitch_yaw_deg=None if newest is None else _degrees(euler_zyx(newest.attitude)),
            at_rest=noise is not None,
            noise_m=None if noise is None else noise[0],
            noise_deg=None if noise is None else noise[1],
            dropped=dict(sorted(Counter(status.dropped).items())),
            excesses=dict(status.excesses),
            bodies=bodies,
            events=tuple(self._events),
        )


def _at_rest(poses: list[Pose]) -> tuple[Vec3, Vec3] | None:
    """Noise of place [m] and attitude [deg] where the vehicle does not move.

    None where it does, or who knows.
    """
    if len(poses) < 10:
        return None
    places = [pose.position_ned for pose in poses]
    fives = zip(places, places[1:], places[2:], places[3:], places[4:], strict=False)
    noise = math.sqrt(fmean(fourth_difference(range(5), five)[0] for five in fives))
    half = len(places) // 2
    if math.dist(_mean(places[:half]), _mean(places[half:])) > REST_M + SIGNIFICANT * noise:
        return None
    back = conjugate(poses[0].attitude)
    turns = [_degrees(rotation_vector(multiply(back, pose.attitude))) for pose in poses]
    return _deviation(places), _deviation(turns)


def _mean(vectors: list[Vec3]) -> Vec3:
    x, y, z = (fmean(axis) for axis in zip(*vectors, strict=True))
    return x, y, z


def _deviation(vectors: list[Vec3]) -> Vec3:
    x, y, z = (pstdev(axis) for axis in zip(*vectors, strict=True))
    return x, y, z


def _degrees(angles: Vec3) -> Vec3:
    x, y, z = map(math.degrees, angles)
    return x, y, z


SHIFT_M = 0.3
"""A move has begun once the vehicle is this far from where it was [m]."""
TURN_DEG = 25.0
"""A turn has begun once the vehicle is turned by this much [deg]."""
REST_S = 0.6
"""A move is over once the vehicle is held still for this long [s]."""
STANDS_M = 0.04
"""The vehicle is held still while it moves by less than this [m]."""
REST_DEG = 5.0
"""The vehicle is held still while it turns by less than this [deg]."""


class CarryMove(msgspec.Struct, frozen=True):
    """One move."""

    name: str
    kind: Literal["still", "shift", "turn", "back"]
    """``still``; ``shift`` along ``axis``; ``turn`` about it; ``back``: a turn undone."""
    axis: Vec3
    """Unit vector forward, right, down on the vehicle; turns are right-handed."""
    say: str
    """Instruction to the operator."""


MOVES = (
    CarryMove(
        "still",
        "still",
        (0.0, 0.0, 0.0),
        "Stand it level on the floor, its nose to where north shall be.",
    ),
    CarryMove(
        "up", "shift", (0.0, 0.0, -1.0), "Lift it straight up by half a metre, and hold it still."
    ),
    CarryMove(
        "forward",
        "shift",
        (1.0, 0.0, 0.0),
        "Carry it forward along its nose by half a metre, and hold it still.",
    ),
    CarryMove(
        "right",
        "shift",
        (0.0, 1.0, 0.0),
        "Carry it to its right by half a metre, and hold it still.",
    ),
    CarryMove(
        "nose down",
        "turn",
        (0.0, -1.0, 0.0),
        "Tip its nose down by some 40 degrees, and hold it still.",
    ),
    CarryMove("level", "back", (0.0, 1.0, 0.0), "Level it again, and hold it still."),
    CarryMove(
        "roll right",
        "turn",
        (1.0, 0.0, 0.0),
        "Tip its right side down by some 40 degrees, and hold it still.",
    ),
    CarryMove("level again", "back", (-1.0, 0.0, 0.0), "Level it again, and hold it still."),
    CarryMove(
        "turn right",
        "turn",
        (0.0, 0.0, 1.0),
        "Keep it level, turn its nose right by a quarter, and hold it still.",
    ),
)


class Rest(msgspec.Struct, frozen=True):
    """The vehicle held still after a move, as the tracker saw it."""

    from_s: float
    until_s: float
    """On our clock [s]."""
    position: Vec3
    attitude: Quat


class Sample(msgspec.Struct, frozen=True, gc=False):
    """One pose in the tracker's own axes."""

    time_s: float
    attitude: Quat
    position: Vec3


class Carry:
    """Follows the moves, one after the other."""

    def __init__(self) -> None:
        self.rests: list[Rest] = []
        """One for each move that is over."""
        self.samples: list[Sample] = []
        """Every pose."""
        self._recent: deque[Sample] = deque()
        self._moved = True

    @property
    def move(self) -> CarryMove | None:
        """The one that is to be made now; None when all are over."""
        return MOVES[len(self.rests)] if len(self.rests) < len(MOVES) else None

    def pose(self, sample: Sample) -> bool:
        """Take one pose; True where it has ended a move."""
        move = self.move
        if move is None or (self.samples and sample.time_s <= self.samples[-1].time_s):
            return False
        self.samples.append(sample)
        recent = self._recent
        recent.append(sample)
        while len(recent) > 1 and recent[1].time_s <= sample.time_s - REST_S:
            recent.popleft()
        if not self._moved:
            self._moved = self._has_moved(move, sample)
            recent.clear()
            return False
        if sample.time_s - recent[0].time_s < REST_S or not _is_still(recent):
            return False
        self.rests.append(_rest(recent))
        self._moved = False
        recent.clear()
        return True

    def _has_moved(self, move: CarryMove, sample: Sample) -> bool:
        before = self.rests[-1]
        if move.kind == "shift":
            return math.dist(sample.position, before.position) > SHIFT_M
        return angle_deg(before.attitude, sample.attitude) > TURN_DEG


def angle_deg(a: Quat, b: Quat) -> float:
    """Return the angle between two attitudes [deg]."""
    return math.degrees(math.hypot(*so3.turn_between(a, b)))


def mean_attitude(attitudes: list[Quat]) -> Quat:
    """Return the mean of attitudes that are near each other."""
    first = attitudes[0]
    signs = [math.copysign(1.0, sum(map(operator.mul, first, q))) for q in attitudes]
    w, x, y, z = (fmean(map(operator.mul, signs, parts)) for parts in zip(*attitudes, strict=True))
    return so3.normalize((w, x, y, z))


def _is_still(recent: deque[Sample]) -> bool:
    first = recent[0]
    return all(
        math.dist(sample.position, first.position) < STANDS_M
        and angle_deg(first.attitude, sample.attitude) < REST_DEG
        for sample in recent
    )


def _rest(recent: deque[Sample]) -> Rest:
    position = _mean([sample.position for sample in recent])
    return Rest(
        recent[0].time_s,
        recent[-1].time_s,
        position,
        mean_attitude([sample.attitude for sample in recent]),
    )


WRONG_DEG = 40.0
"""A hand is no gauge: a move may be off by this much [deg]."""
APART_DEG = 15.0
"""Largest difference between tracker and autopilot about one turn [deg]."""
ALIGNED_DEG = 12.0
"""A vehicle that is put down by hand stands level, and its nose along the lab's own axis, within
this [deg]."""
SNAP_DEG = 1.0
"""Smaller angles of the body on the vehicle are none [deg]."""


class CarryFailure(Exception):
    """The carry can't go on, or its moves do not fit together.

    The sentence says why, and what to do.
    """

    def __init__(self, move: str, says: Sentence) -> None:
        """``move`` by its name; empty where it is not a single one."""
        super().__init__(says.text)
        self.move = move
        self.says = says


class AxisCalibration(msgspec.Struct, frozen=True, kw_only=True):
    """Values for the configuration."""

    world: World
    body: Body
    lab_rotation_deg: Vec3
    """See :class:`groundstation.core.geometry.Alignment`; only its yaw is measured."""
    body_rotation_deg: Vec3
    """All zero without an autopilot: a hand is no gauge."""
    late_s: float | None
    """Delay of each pose's stamp after its instant by the autopilot, negative for earlier [s]; None
    where it is unknown, or too small to tell."""
    autopilot_north_deg: float | None
    """Direction of the autopilot's north, to the right of ours [deg]."""


def solve_axes(
    rests: list[Rest], poses: list[Sample], autopilot: list[Attitude]
) -> AxisCalibration:
    """Solve for the axes by all moves.

    ``poses`` are in the tracker's own axes; ``autopilot``, which may be empty, are attitudes FRD to
    its NED. Stamps are on our clock [s].

    Raises:
        CarryFailure: they do not fit together.
    """
    theirs = [_autopilot_at(rest, autopilot) for rest in rests] if autopilot else None
    body = _body(rests, theirs)
    ned_of_lab = body @ _matrix(so3.conjugate(rests[0].attitude))
    _check_shifts(rests, body)
    world_name, lab_askew = _nearest_axes(ned_of_lab, get_args(World))
    body_name, body_askew = _nearest_axes(body, get_args(Body))
    roll, pitch, yaw = lab_askew
    askew = max(abs(roll), abs(pitch))
    if askew > ALIGNED_DEG:
        raise CarryFailure("still", notice("carry.lab_askew", angle_deg=askew))
    if theirs is None:
        askew = max(map(abs, body_askew))
        if askew > 0.5 * WRONG_DEG:
            raise CarryFailure("", notice("carry.body_askew", angle_deg=askew))
        body_askew = (0.0, 0.0, 0.0)
    lab_yaw = yaw if abs(yaw) > ALIGNED_DEG else 0.0
    north = None
    if theirs is not None:  # the nose's bearing by our north, less that by the autopilot's
        north = math.remainder(lab_yaw - yaw - math.degrees(so3.euler_zyx(theirs[0])[2]), 360.0)
    lab_deg, body_deg = (0.0, 0.0, round(lab_yaw, 1)), _snap_angles(body_askew)
    frames = Frames(
        world_name, body_name, Alignment(lab_rotation_deg=lab_deg, body_rotation_deg=body_deg)
    )
    return AxisCalibration(
        world=world_name,
        body=body_name,
        lab_rotation_deg=lab_deg,
        body_rotation_deg=body_deg,
        late_s=_find_lateness(poses, autopilot, frames),
        autopilot_north_deg=north,
    )


def _autopilot_at(rest: Rest, autopilot: list[Attitude]) -> Quat:
    held = [sample.attitude for sample in autopilot if rest.from_s <= sample.time_s <= rest.until_s]
    if not held:
        raise CarryFailure("", notice("carry.attitude_stopped"))
    return mean_attitude(held)


def _body(rests: list[Rest], theirs: list[Quat] | None) -> "NDArray[Any]":
    """R_FB, of the tracked body on the vehicle, by the turns."""
    seen, true, names = [], [], []
    for index, move in enumerate(MOVES):
        if move.kind not in ("turn", "back"):
            continue
        turn = so3.turn_between(rests[index - 1].attitude, rests[index].attitude)
        shown = tuple(math.hypot(*turn) * part for part in move.axis)
        told = shown if theirs is None else so3.turn_between(theirs[index - 1], theirs[index])
        _check_turn(move, turn, (told[0], told[1], told[2]))
        seen.append(turn)
        true.append(told)
        names.append(move.name)
    a, b = np.array(seen), np.array(true)
    u, _, v = np.linalg.svd(b.T @ a)
    body: NDArray[Any] = u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v
    allowed = WRONG_DEG if theirs is None else APART_DEG
    off = [_between_deg(body @ x, y) for x, y in zip(a, b, strict=True)]
    if max(off) > allowed:
        worst = names[off.index(max(off))]
        raise CarryFailure(worst, notice("carry.misfit", move=worst, angle_deg=max(off)))
    return body


def _check_turn(move: CarryMove, seen: Vec3, told: Vec3) -> None:
    """The autopilot must have felt the shown turn, and as much of it as the tracker has seen."""
    if _between_deg(told, move.axis) > WRONG_DEG:
        raise CarryFailure(
            move.name, notice("carry.turned_otherwise", move=move.name, way=_in_words(told))
        )
    far, felt = math.degrees(math.hypot(*seen)), math.degrees(math.hypot(*told))
    if abs(far - felt) > APART_DEG:
        raise CarryFailure(
            move.name, notice("carry.turned_apart", move=move.name, seen_deg=far, felt_deg=felt)
        )


def _check_shifts(rests: list[Rest], body: "NDArray[Any]") -> None:
    off = {}
    for index, move in enumerate(MOVES):
        if move.kind == "shift":
            before, after = rests[index - 1], rests[index]
            way = np.array(after.position) - np.array(before.position)
            # F = R_FB R_LBᵀ: what is along the lab's axes, along the vehicle's.
            off[move] = body @ _matrix(so3.conjugate(before.attitude)) @ way
    wrong = {move: way for move, way in off.items() if _between_deg(way, move.axis) > WRONG_DEG}
    if len(wrong) == len(off) and all(
        _between_deg(-way, move.axis) < WRONG_DEG for move, way in wrong.items()
    ):
        raise CarryFailure("", notice("carry.left_handed"))
    for move, way in wrong.items():
        way_words = _in_words(way, shift=True)
        raise CarryFailure(move.name, notice("carry.went_otherwise", move=move.name, way=way_words))


def _nearest_axes(matrix: "NDArray[Any]", names: tuple[str, ...]) -> tuple[Any, Vec3]:
    """The name whose axes are nearest to the columns of ``matrix``, and roll, pitch, yaw of what is
    left [deg].
    """
    best = max(names, key=lambda name: float(np.sum(np.array(axes(name)).T * matrix)))
    left = matrix @ np.array(axes(best))
    rows = tuple((float(a), float(b), float(c)) for a, b, c in left)
    roll, pitch, yaw = map(
        math.degrees, so3.euler_zyx(so3.from_matrix((rows[0], rows[1], rows[2])))
    )
    return best, (roll, pitch, yaw)


def _find_lateness(poses: list[Sample], autopilot: list[Attitude], frames: Frames) -> float | None:
    """Excess of the poses' stamps [s], by the autopilot's attitude.

    None where it is too small to tell.
    """
    latency = PoseLatency(math.inf)
    for seen in sorted([*autopilot, *poses], key=operator.attrgetter("time_s")):
        match seen:
            case Attitude():
                latency.add_attitude(seen)
            case Sample(time_s, attitude, position):
                latency.add_pose(Pose(0, time_s, time_s, *frames.to_ours(position, attitude)))
    return latency.late_s


def _matrix(q: Quat) -> "NDArray[Any]":
    return np.array(so3.matrix(q))


def _between_deg(a: Any, b: Any) -> float:
    length = math.hypot(*a) * math.hypot(*b)
    cosine = sum(p * q for p, q in zip(a, b, strict=True)) / length if length > 0.0 else 0.0
    return so3.angle_deg(cosine)


def _in_words(vector: Any, *, shift: bool = False) -> str:
    """Where a vector forward, right, down points mostly: as a way, or as the axis of a turn."""
    ways = (("forward", "backward"), ("right", "left"), ("down", "up"))
    turns = (
        ("roll right", "roll left"),
        ("tip its nose up", "tip its nose down"),
        ("turn right", "turn left"),
    )
    axis = max(range(3), key=lambda n: abs(vector[n]))
    return (ways if shift else turns)[axis][int(vector[axis] < 0.0)]


def _snap_angles(angles: Vec3) -> Vec3:
    x, y, z = (round(angle, 1) if abs(angle) >= SNAP_DEG else 0.0 for angle in angles)
    return x, y, z
