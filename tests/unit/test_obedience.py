"""The obedience monitor on made-up poses and commands: what convicts, how soon, and what never does."""

import math
import random
from collections.abc import Callable
from typing import NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from groundstation.control.model import Driven, Motion
from groundstation.control.obedience import EXPANDS, GAP_S, NODE_S, SUSPECTS, Filter, Obedience
from groundstation.ops import Quat, Vec3
from groundstation.poses.port import Pose
from groundstation.so3 import multiply, third_column, turned

G, MASS_KG, PERIOD_S = 9.81, 0.5, 0.01
NOISE_M, NOISE_RAD = 0.0005, 0.002
ORIGIN, LEVEL = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
SETTLED_S = 5.0


class Truth(NamedTuple):
    """Where the vehicle is and how it leans."""

    position: Vec3
    attitude: Quat


class Demand(NamedTuple):
    """What the pilot wants: roll and pitch [rad], and thrust as a share of the weight."""

    roll: float
    pitch: float
    thrust: float = 1.0


Picture = Callable[[Truth], Truth]
"""What the poses show of the truth."""
Air = Callable[[float], Vec3]
"""What pushes the vehicle at a time, beside the commands [m/s², NED]."""


def true(truth: Truth) -> Truth:
    """Poses that don't lie."""
    return truth


def calm(_: float) -> Vec3:
    """No wind."""
    return ORIGIN


def lively(time_s: float) -> Demand:
    """A flight that excites all axes, as one along a course does in gusts."""
    roll = 0.10 * math.sin(5.1 * time_s) + 0.05 * math.sin(9.7 * time_s + 1.0)
    pitch = 0.10 * math.cos(4.3 * time_s) + 0.05 * math.sin(8.3 * time_s)
    return Demand(roll, pitch, 1.0 + 0.15 * math.sin(4.7 * time_s) + 0.05 * math.sin(8.9 * time_s))


class Watched:
    """A vehicle that leans as a pilot wants who sees it by its poses, and the monitor that watches these."""

    def __init__(self, seed: int, *, gain: float = 1.0, bias_rad_s: float = 0.0, stiff_1_s: float = 5.0) -> None:
        """It turns with ``gain`` times the rates that it is told, and with a bias in roll and pitch.

        The pilot turns it back at ``stiff_1_s`` for each radian that it is off [1/s].
        """
        self.monitor = Obedience(MASS_KG, G)
        self.now = 0.0
        self.highest = 0.0
        """Largest share of what convicts so far."""
        self._draw = random.Random(seed)
        self._gain, self._bias, self._stiff = gain, bias_rad_s, stiff_1_s
        self._velocity: Vec3 = ORIGIN
        self._past = [Truth(ORIGIN, LEVEL)]
        self._seen = Pose(0, 0.0, 0.0, ORIGIN, LEVEL)

    @property
    def share(self) -> float:
        """Of what convicts, the most that is against the poses now."""
        evidence = self.monitor.evidence
        return max(evidence.attitude, evidence.axes, evidence.heading)

    @property
    def place(self) -> Vec3:
        """Where it is [m]."""
        return self._past[-1].position

    def fly(
        self, duration_s: float, demand: Callable[[float], Demand] = lively, *, picture: Picture = true,
        air: Air = calm, late_s: float = 0.0, resets: int = 0, silent: bool = False,
    ) -> None:  # fmt: skip
        """Fly on; poses are ``late_s`` older than they say, or ``silent``: none comes but the last."""
        steps = round(duration_s / PERIOD_S)
        motion, made = self._begin()
        for left in reversed(range(steps)):
            rates, push = self._commands(demand(self.now))
            made = self._driven(made, rates, push)
            self._move(rates, push, air(self.now))
            if silent and left:
                continue
            before, self._seen = self._seen, self._pose(picture, late_s, resets)
            elapsed = self._seen.time_s - before.time_s
            self.monitor.pose(self._seen, motion, made, elapsed, NOISE_M, counts=True)
            self.highest = max(self.highest, self.share)
            motion, made = self._begin()

    def convicts_s(self, within_s: float, demand: Callable[[float], Demand] = lively, **told: Picture) -> float:
        """How long until the poses are convicted [s]; infinity where they are not ``within_s`` [s]."""
        for step in range(1, round(within_s / PERIOD_S) + 1):
            self.fly(PERIOD_S, demand, **told)
            if self.share >= 1.0:
                return step * PERIOD_S
        return math.inf

    def _begin(self) -> tuple[Motion, Driven]:
        """As the estimate is at the newest pose."""
        attitude = self._seen.attitude
        weight = MASS_KG * G
        return (
            Motion(self._seen.position_ned, self._velocity, attitude, weight, ORIGIN),
            Driven(attitude, weight, ORIGIN, ORIGIN, ORIGIN),
        )

    def _commands(self, demand: Demand) -> tuple[Vec3, float]:
        """Body rates [rad/s] and thrust [N], by what is seen."""
        x, y, _ = third_column(self._seen.attitude)
        w, *_, z = self._seen.attitude
        k = self._stiff
        return (k * (demand.roll + y), k * (demand.pitch - x), -2.0 * k * z * w), demand.thrust * MASS_KG * G

    def _driven(self, made: Driven, rates: Vec3, push: float) -> Driven:
        h, (x, y, z), (ix, iy, iz), (sx, sy, sz) = PERIOD_S, third_column(made.attitude), made.impulse, made.reach
        fx, fy, fz = push * x, push * y, push * z
        return Driven(
            turned(made.attitude, (h * rates[0], h * rates[1], h * rates[2])), push, rates,
            (ix + h * fx, iy + h * fy, iz + h * fz),
            (sx + h * (ix + 0.5 * h * fx), sy + h * (iy + 0.5 * h * fy), sz + h * (iz + 0.5 * h * fz)),
        )  # fmt: skip

    def _move(self, rates: Vec3, push: float, air: Vec3) -> None:
        h, truth, g, b = PERIOD_S, self._past[-1], self._gain, self._bias
        (tx, ty, tz), a = third_column(truth.attitude), push / MASS_KG
        ax, ay, az = air[0] - a * tx, air[1] - a * ty, air[2] + G - a * tz
        (x, y, z), (vx, vy, vz) = truth.position, self._velocity
        there = x + h * (vx + 0.5 * h * ax), y + h * (vy + 0.5 * h * ay), z + h * (vz + 0.5 * h * az)
        self._velocity = vx + h * ax, vy + h * ay, vz + h * az
        turn = h * (g * rates[0] + b), h * (g * rates[1] + b), h * g * rates[2]
        self._past.append(Truth(there, turned(truth.attitude, turn)))
        self.now += h

    def _pose(self, picture: Picture, late_s: float, resets: int) -> Pose:
        (x, y, z), attitude = picture(self._past[-1 - min(round(late_s / PERIOD_S), len(self._past) - 1)])
        m, rad = (self._draw.gauss(0.0, NOISE_M) for _ in range(3)), [self._draw.gauss(0.0, NOISE_RAD) for _ in range(3)]
        place = x + next(m), y + next(m), z + next(m)
        seen = turned(attitude, (rad[0], rad[1], rad[2]))
        return Pose(self._seen.id + 1, self.now, self.now, place, seen, reset_count=resets)


@given(
    st.tuples(*[st.floats(-5.0, 5.0)] * 3),
    st.floats(NODE_S, 1.5 * NODE_S),
)
def test_a_parabola_leaves_no_innovation_in_a_filter_that_has_settled(path: Vec3, step_s: float) -> None:
    x, v, a = path
    follows = Filter(x)
    for k in range(1, 60):
        t = k * step_s
        off = follows.innovation(x + v * t + 0.5 * a * t * t, step_s)
        assert k <= EXPANDS or abs(off) < 1e-9


def test_what_leaves_its_parabola_leaves_an_innovation() -> None:
    follows = Filter(0.0)
    for k in range(1, 30):
        follows.innovation(0.5 * k, NODE_S)
    assert follows.innovation(15.0 + 0.1, NODE_S) == pytest.approx(0.1)


@pytest.mark.parametrize("bias_rad_s", [0.0, 0.03, -0.1, 0.1])
@pytest.mark.parametrize("gain", [0.6, 1.0, 1.5])
@pytest.mark.parametrize("demand", [lively, lambda _: Demand(0.0, 0.0)], ids=["lively", "hold"])
def test_a_vehicle_that_obeys_is_not_suspected(
    demand: Callable[[float], Demand], gain: float, bias_rad_s: float
) -> None:
    for seed in range(3):
        vehicle = Watched(seed, gain=gain, bias_rad_s=bias_rad_s)
        vehicle.fly(60.0, demand)
        assert vehicle.highest < SUSPECTS
        assert vehicle.monitor.windows > 0.9 * 60.0 / NODE_S
