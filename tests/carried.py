"""A simulated carry: the moves by hand, not quite as shown, before a tracker and an autopilot."""

import math
import random
from collections.abc import Callable, Sequence

from groundstation.core.geometry import Quat, Vec3, so3
from groundstation.lab import MOVES, CarryMove
from groundstation.lab.pose_stream import Carry, Sample
from links.core import Attitude
from sim.world import HOLD_S, MOVE_S, make_hand

START: tuple[Vec3, Quat] = ((0.7, -0.4, -0.1), so3.IDENTITY)
"""Place [m, NED] and attitude in which a vehicle stands before it is carried."""
Measure = Callable[[Vec3, Quat], tuple[Vec3, Quat]]
"""What a tracker says of a true pose, NED and FRD."""


def lasts_s(moves: Sequence[CarryMove] = MOVES) -> float:
    return len(moves) * (MOVE_S + HOLD_S) + HOLD_S


def carried(
    measure: Measure,
    *,
    seed: int = 0,
    moves: Sequence[CarryMove] = MOVES,
    late_s: float = 0.0,
    noise_m: float = 5e-4,
    noise_rad: float = 3e-3,
) -> tuple[Carry, list[Attitude]]:
    """Moves by a 50 Hz tracker, stamped ``late_s`` late, and attitudes at 100 Hz."""
    draw = random.Random(seed + 1)
    at, carry, attitudes = make_hand(seed, *START, moves), Carry(), []
    turn = so3.from_euler_zyx(0.0, 0.0, math.radians(30.0))

    def noisy(q: Quat) -> Quat:
        return so3.rotate(
            q, (draw.gauss(0.0, noise_rad), draw.gauss(0.0, noise_rad), draw.gauss(0.0, noise_rad))
        )

    for n in range(int(100 * lasts_s(moves))):
        time_s = 0.01 * n
        place, attitude, rates = at(time_s)
        attitudes.append(Attitude(time_s, noisy(so3.multiply(turn, attitude)), rates))
        if n % 2 == 0:
            x, y, z = (p + draw.gauss(0.0, noise_m) for p in place)
            position, measured = measure((x, y, z), noisy(attitude))
            carry.pose(Sample(time_s + late_s, measured, position))
    return carry, attitudes
