"""The moves by which a vehicle is carried, and when each of them is over. Sans-IO.

Poses are taken in the tracker's own axes: which those are is what the moves are to tell.
"""

import math
from collections import deque
from statistics import fmean
from typing import Literal

import msgspec

from groundstation.core.geometry import Quat, Vec3, so3

SHIFT_M, TURN_DEG = 0.3, 25.0
"""A move has begun once the vehicle is this far, or this much turned, from where it was."""
REST_S = 0.6
"""It is over once the vehicle is held still for so long [s]."""
REST_M, REST_DEG = 0.04, 5.0
"""Still is a hand that moves it by no more than this meanwhile."""


class Move(msgspec.Struct, frozen=True):
    """One move."""

    name: str
    kind: Literal["still", "shift", "turn", "back"]
    """``still``: it stands; ``shift`` along ``axis``; ``turn`` about it; ``back``: a turn undone."""
    axis: Vec3
    """Unit vector forward, right, down on the vehicle; turns are right-handed."""
    say: str
    """What the operator is to do."""


MOVES = (
    Move("still", "still", (0.0, 0.0, 0.0), "Stand it level on the floor, its nose to where north shall be."),
    Move("up", "shift", (0.0, 0.0, -1.0), "Lift it straight up by half a metre, and hold it still."),
    Move("forward", "shift", (1.0, 0.0, 0.0), "Carry it forward along its nose by half a metre, and hold it still."),
    Move("right", "shift", (0.0, 1.0, 0.0), "Carry it to its right by half a metre, and hold it still."),
    Move("nose down", "turn", (0.0, -1.0, 0.0), "Tip its nose down by some 40 degrees, and hold it still."),
    Move("level", "back", (0.0, 1.0, 0.0), "Level it again, and hold it still."),
    Move("roll right", "turn", (1.0, 0.0, 0.0), "Tip its right side down by some 40 degrees, and hold it still."),
    Move("level again", "back", (-1.0, 0.0, 0.0), "Level it again, and hold it still."),
    Move("turn right", "turn", (0.0, 0.0, 1.0), "Keep it level, turn its nose right by a quarter, and hold it still."),
)


class Rest(msgspec.Struct, frozen=True):
    """The vehicle held still after a move, as the tracker saw it."""

    from_s: float
    until_s: float
    """On our clock [s]."""
    position: Vec3
    attitude: Quat


class Sample(msgspec.Struct, frozen=True, gc=False):
    """One pose in the tracker's own axes, or one attitude of the autopilot."""

    time_s: float
    attitude: Quat
    position: Vec3 = (0.0, 0.0, 0.0)


class Carry:
    """Follows the moves, one after the other."""

    def __init__(self) -> None:
        """Before the first."""
        self.rests: list[Rest] = []
        """One for each move that is over."""
        self.samples: list[Sample] = []
        """Every pose."""
        self._recent: deque[Sample] = deque()
        self._moved = True

    @property
    def move(self) -> Move | None:
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

    def _has_moved(self, move: Move, sample: Sample) -> bool:
        before = self.rests[-1]
        if move.kind == "shift":
            return math.dist(sample.position, before.position) > SHIFT_M
        return angle_deg(before.attitude, sample.attitude) > TURN_DEG


def angle_deg(a: Quat, b: Quat) -> float:
    """From one attitude to the other [deg]."""
    return math.degrees(math.hypot(*so3.rotation_vector(so3.multiply(so3.conjugate(a), b))))


def mean_attitude(attitudes: list[Quat]) -> Quat:
    """Of attitudes that are near each other."""
    first = attitudes[0]
    signed = [q if sum(a * b for a, b in zip(first, q, strict=True)) >= 0.0 else _negative(q) for q in attitudes]
    w, x, y, z = (fmean(parts) for parts in zip(*signed, strict=True))
    return so3.normalized((w, x, y, z))


def _negative(q: Quat) -> Quat:
    w, x, y, z = q
    return (-w, -x, -y, -z)


def _is_still(recent: deque[Sample]) -> bool:
    first = recent[0]
    return all(
        math.dist(sample.position, first.position) < REST_M and angle_deg(first.attitude, sample.attitude) < REST_DEG
        for sample in recent
    )


def _rest(recent: deque[Sample]) -> Rest:
    x, y, z = (fmean(axis) for axis in zip(*(sample.position for sample in recent), strict=True))
    attitude = mean_attitude([sample.attitude for sample in recent])
    return Rest(recent[0].time_s, recent[-1].time_s, (x, y, z), attitude)
