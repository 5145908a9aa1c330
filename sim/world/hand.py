"""Simulated hand: it carries a vehicle along the moves of ``groundstation carry``, inexactly."""

import math
import random
from collections.abc import Callable, Sequence

from groundstation.core.geometry import Quat, Vec3, so3
from groundstation.lab import MOVES, CarryMove

MOVE_S = 1.6
"""Duration of one move [s]. Chosen, as the other figures of the hand."""
HOLD_S = 1.2
"""Pause after a move [s]."""
SHIFT_M = 0.55
"""Length of a shift [m]."""
TURN_RAD = math.radians(42.0)
"""Angle of a turn [rad]."""
RATES_BASE_S = 0.01
"""Time over which body rates are differences of the attitude [s]."""
AXIS_DEVIATION = 0.08
"""Standard deviation of each component of a move's axis, a unit vector [-]: some 8 degrees
aside."""
SIZES = (0.9, 1.1)
"""Range of a move's size, as a share of the shown one [-]."""
TREMOR_M = 2e-3
"""Amplitude of the tremor along each axis [m]."""
TREMOR_RAD_S = 9.0
"""Frequency of the tremor [rad/s]."""
TREMOR_RAD_PER_M = 4.0
"""Turn by the tremor per displacement [rad/m]."""


def make_hand(
    seed: int, place: Vec3, attitude: Quat, moves: Sequence[CarryMove] = MOVES
) -> Callable[[float], tuple[Vec3, Quat, Vec3]]:
    """Return a function of the time [s] to the true position [m, NED], attitude and body rates
    [rad/s].

    From ``place`` [m, NED] and ``attitude`` on the hand makes the ``moves``, with errors by
    ``seed``.
    """
    draw = random.Random(seed)
    stops = [(place, attitude)]
    for move in moves:
        x, y, z = (part + draw.gauss(0.0, AXIS_DEVIATION) for part in move.axis)
        size = draw.uniform(*SIZES)
        if move.kind == "shift":
            dx, dy, dz = so3.to_world(attitude, (x, y, z))
            place = (
                place[0] + SHIFT_M * size * dx,
                place[1] + SHIFT_M * size * dy,
                place[2] + SHIFT_M * size * dz,
            )
        elif move.kind in ("turn", "back"):
            # A quarter turn is shown for the nose, half of it for tilts.
            angle = TURN_RAD * size * (2.0 if move.name == "turn right" else 1.0)
            attitude = _turn(attitude, (angle * x, angle * y, angle * z))
        stops.append((place, attitude))

    def pose(time_s: float) -> tuple[Vec3, Quat]:
        leg = min(int(time_s / (MOVE_S + HOLD_S)), len(stops) - 2)
        share = min(max(time_s - leg * (MOVE_S + HOLD_S), 0.0) / MOVE_S, 1.0)
        # The quintic from rest to rest, without a step of the acceleration.
        share = share**3 * (10.0 - 15.0 * share + 6.0 * share * share)
        (p, q), (r, s) = stops[leg], stops[leg + 1]
        tremor = tuple(
            TREMOR_M * math.sin(TREMOR_RAD_S * time_s + phase) for phase in (0.0, 1.0, 2.0)
        )
        dx, dy, dz = so3.turn_between(q, s)
        turn = _turn(q, (share * dx, share * dy, share * dz))
        k = TREMOR_RAD_PER_M
        turn = so3.rotate(turn, (k * tremor[1], k * tremor[2], k * tremor[0]))
        x, y, z = (a + share * (b - a) + t for a, b, t in zip(p, r, tremor, strict=True))
        return (x, y, z), turn

    def at(time_s: float) -> tuple[Vec3, Quat, Vec3]:
        before, after = (pose(time_s + part * RATES_BASE_S)[1] for part in (-0.5, 0.5))
        p, q, r = so3.turn_between(before, after)
        return *pose(time_s), (p / RATES_BASE_S, q / RATES_BASE_S, r / RATES_BASE_S)

    return at


def _turn(q: Quat, angle: Vec3) -> Quat:
    """Turn ``q`` as :func:`groundstation.core.geometry.so3.rotate`, also by large angles [rad]."""
    size = math.hypot(*angle)
    k = math.sin(0.5 * size) / size if size > 1e-9 else 0.5
    return so3.multiply(q, (math.cos(0.5 * size), k * angle[0], k * angle[1], k * angle[2]))
