"""The obedience monitor on made-up poses and commands: what convicts, how soon, and what never does."""

import math
import random
from collections.abc import Callable
from typing import NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.core.geometry import Quat, Vec3, multiply, rotate, third_column
from groundstation.core.messages import Pose
from groundstation.core.safety import NODE_S, Obedience
from groundstation.core.safety.obedience import GAP_S, HEADING_SUSPECTS, SUSPECTS
from groundstation.core.safety.rivals import EXPANDS, ImageFilter
from groundstation.core.vehicle import ActuatorResponse, Motion

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
        self.counts = True
        """False near the floor."""
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
        """Where it is in truth [m, NED]."""
        return self._past[-1].position

    @property
    def sinks_m_s(self) -> float:
        """How fast it goes down in truth [m/s]."""
        return self._velocity[2]

    @sinks_m_s.setter
    def sinks_m_s(self, speed: float) -> None:
        self._velocity = (*self._velocity[:2], speed)

    @property
    def attitude(self) -> Quat:
        """How it leans in truth."""
        return self._past[-1].attitude

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
            self.monitor.pose(self._seen, motion, made, elapsed, NOISE_M, counts=self.counts)
            self.highest = max(self.highest, self.share)
            motion, made = self._begin()

    def convicts_s(self, within_s: float, demand: Callable[[float], Demand] = lively, *, picture: Picture) -> float:
        """How long until the poses are convicted [s]; infinity where they are not ``within_s`` [s]."""
        for step in range(1, round(within_s / PERIOD_S) + 1):
            self.fly(PERIOD_S, demand, picture=picture)
            if self.share >= 1.0:
                return step * PERIOD_S
        return math.inf

    def _begin(self) -> tuple[Motion, ActuatorResponse]:
        """As the estimate is at the newest pose."""
        attitude = self._seen.attitude
        weight = MASS_KG * G
        return (
            Motion(self._seen.position_ned, self._velocity, attitude, weight, ORIGIN),
            (attitude, weight, ORIGIN, ORIGIN, ORIGIN),
        )

    def _commands(self, demand: Demand) -> tuple[Vec3, float]:
        """Body rates [rad/s] and thrust [N], by what is seen."""
        x, y, _ = third_column(self._seen.attitude)
        w, *_, z = self._seen.attitude
        k = self._stiff
        return (k * (demand.roll + y), k * (demand.pitch - x), -2.0 * k * z * w), demand.thrust * MASS_KG * G

    def _driven(self, made: ActuatorResponse, rates: Vec3, push: float) -> ActuatorResponse:
        attitude, _, _, (ix, iy, iz), (sx, sy, sz) = made
        h, (x, y, z) = PERIOD_S, third_column(attitude)
        fx, fy, fz = push * x, push * y, push * z
        return (
            rotate(attitude, (h * rates[0], h * rates[1], h * rates[2])), push, rates,
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
        self._past.append(Truth(there, rotate(truth.attitude, turn)))
        self.now += h

    def _pose(self, picture: Picture, late_s: float, resets: int) -> Pose:
        (x, y, z), attitude = picture(self._past[-1 - min(round(late_s / PERIOD_S), len(self._past) - 1)])
        gauss = self._draw.gauss
        place = x + gauss(0.0, NOISE_M), y + gauss(0.0, NOISE_M), z + gauss(0.0, NOISE_M)
        seen = rotate(attitude, (gauss(0.0, NOISE_RAD), gauss(0.0, NOISE_RAD), gauss(0.0, NOISE_RAD)))
        return Pose(self._seen.id + 1, self.now, self.now, place, seen, reset_count=resets)


@given(
    st.tuples(*[st.floats(-5.0, 5.0)] * 3),
    st.floats(NODE_S, 1.5 * NODE_S),
)
def test_a_parabola_leaves_no_innovation_in_a_filter_that_has_settled(path: Vec3, step_s: float) -> None:
    x, v, a = path
    follows = ImageFilter((x, v, 0.0), (0.0, x, v))
    for k in range(1, 60):
        t = k * step_s
        p, q = x + v * t + 0.5 * a * t * t, v + a * t
        off = follows.innovations((p, q, 0.0), (0.0, p, q), step_s)
        assert k <= EXPANDS or max(abs(each) for one in off for each in one) < 1e-9


def test_what_leaves_its_parabola_leaves_an_innovation() -> None:
    follows = ImageFilter((0.0, 1.0, 2.0), (3.0, 2.0, 1.0))
    for k in range(1, 30):
        follows.innovations((0.5 * k, 1.0, 2.0 - 0.1 * k), (3.0, 2.0, 1.0 + k), NODE_S)
    seen, told = follows.innovations((15.0 + 0.1, 1.0, -1.0 - 0.2), (3.0, 2.5, 31.0 - 0.3), NODE_S)
    assert seen == pytest.approx((0.1, 0.0, -0.2))
    assert told == pytest.approx((0.0, 0.5, -0.3))


def vigorous(time_s: float) -> Demand:
    """A flight that accelerates and brakes hard, along one horizontal axis more than the other."""
    pitch = 0.25 * math.cos(5.3 * time_s) + 0.10 * math.sin(8.3 * time_s)
    return Demand(0.10 * math.sin(7.1 * time_s), pitch, 1.0 + 0.3 * math.sin(6.7 * time_s))


def hold(_: float) -> Demand:
    """Nothing is wanted; what the pilot does answers the noise of the poses."""
    return Demand(0.0, 0.0)


def attitude_mirrored_in_roll(truth: Truth) -> Truth:
    """As where the sign of one axis of the tracker's body is wrong."""
    w, x, y, z = truth.attitude
    return Truth(truth.position, (w, -x, y, z))


def under_way(seed: int, demand: Callable[[float], Demand] = lively) -> Watched:
    """A vehicle that has flown for some seconds, with nothing against it."""
    vehicle = Watched(seed)
    vehicle.fly(SETTLED_S + 0.077 * seed, demand)
    assert vehicle.highest < SUSPECTS
    return vehicle


@pytest.mark.parametrize(
    ("gain", "bias_rad_s"),
    [(0.6, 0.0), (0.6, 0.03), (0.6, -0.03), (1.0, 0.0), (1.0, -0.05), (1.0, 0.1), (1.5, 0.0), (1.5, -0.05)],
)
@pytest.mark.parametrize("demand", [lively, vigorous, hold])
def test_a_vehicle_that_obeys_is_never_suspected(
    demand: Callable[[float], Demand], gain: float, bias_rad_s: float
) -> None:
    for seed in range(3):
        vehicle = Watched(seed, gain=gain, bias_rad_s=bias_rad_s)
        vehicle.fly(60.0, demand)
        assert vehicle.highest < SUSPECTS
        assert vehicle.monitor.windows > 0.9 * 60.0 / NODE_S


def test_an_attitude_that_stands_while_commands_turn_convicts_within_a_second() -> None:
    for seed in range(12):
        vehicle = under_way(seed)
        stood = vehicle.attitude

        def stands(truth: Truth, stood: Quat = stood) -> Truth:
            return Truth(truth.position, stood)

        took_s = vehicle.convicts_s(3.0, picture=stands)
        assert took_s <= 1.0, seed


def roll_alone(time_s: float) -> Demand:
    """Nothing but roll moves."""
    return lively(time_s)._replace(pitch=0.0)


@pytest.mark.parametrize(("demand", "within_s"), [(roll_alone, 0.5), (lively, 1.0), (vigorous, 1.0)])
def test_a_mirrored_roll_convicts_at_once_and_soon_where_pitch_obeys(
    demand: Callable[[float], Demand], within_s: float
) -> None:
    for seed in range(12):
        took_s = under_way(seed, demand).convicts_s(3.0, demand, picture=attitude_mirrored_in_roll)
        assert took_s <= within_s, seed


IMAGES: dict[str, Callable[[Vec3], Vec3]] = {
    "north mirrored": lambda at: (-at[0], at[1], at[2]),
    "east mirrored": lambda at: (at[0], -at[1], at[2]),
    "down mirrored": lambda at: (at[0], at[1], -at[2]),
    "north and east swapped": lambda at: (at[1], at[0], at[2]),
    "turned by 90": lambda at: (-at[1], at[0], at[2]),
    "turned by 180": lambda at: (-at[0], -at[1], at[2]),
}


@pytest.mark.parametrize("image", IMAGES)
def test_positions_along_wrong_axes_convict(image: str) -> None:
    wrong = IMAGES[image]
    for seed in range(6):
        vehicle = Watched(seed)
        took_s = vehicle.convicts_s(6.0, vigorous, picture=lambda truth: Truth(wrong(truth.position), truth.attitude))
        assert vehicle.monitor.evidence.axes >= 1.0, seed
        assert took_s <= 2.0, seed


@pytest.mark.parametrize("late_s", [0.1, 0.15, 0.2, 0.3, 0.4])
def test_how_late_poses_are_is_found_from_what_they_do(late_s: float) -> None:
    for seed in range(6):
        vehicle = Watched(seed, stiff_1_s=2.0)
        vehicle.fly(3.0, late_s=late_s)
        assert vehicle.monitor.lateness_s() == pytest.approx(late_s, abs=NODE_S)


def test_poses_that_come_in_time_are_not_called_late() -> None:
    for demand in (lively, vigorous, hold):
        for seed in range(6):
            vehicle = Watched(seed)
            for _ in range(20):
                vehicle.fly(0.5, demand)
                assert vehicle.monitor.lateness_s() == 0.0


DIRECTIONS = [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (-0.7, 0.7, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)]


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_a_gust_in_a_hold_convicts_nobody(direction: Vec3) -> None:
    north, east, down = (4.0 * one for one in direction)
    for seed in range(6):
        vehicle = under_way(seed, hold)
        begun_s = vehicle.now

        def leans(time_s: float, begun_s: float = begun_s) -> Demand:
            """The pilot leans and thrusts against it, a quarter of a second later."""
            if time_s < begun_s + 0.25:
                return hold(time_s)
            return Demand(-math.atan(east / G), math.atan(north / G), 1.0 + down / G)

        vehicle.fly(5.0, leans, air=lambda _: (north, east, down))
        assert vehicle.highest < 1.0, seed


def test_a_reset_of_the_source_s_estimate_is_no_evidence() -> None:
    def reset(truth: Truth) -> Truth:
        """The origin leaps, and the heading by 19°."""
        north, east, down = truth.position
        return Truth((north + 0.5, east, down - 0.3), multiply(truth.attitude, (0.98629, 0.0, 0.0, 0.16505)))

    for seed in range(6):
        vehicle = under_way(seed)
        vehicle.fly(5.0, picture=reset, resets=1)
        assert vehicle.highest < SUSPECTS


def test_what_happens_while_no_pose_comes_is_no_evidence() -> None:
    for seed in range(6):
        vehicle = under_way(seed, vigorous)
        for _ in range(5):
            vehicle.fly(GAP_S + 0.1, vigorous, air=lambda _: (3.0, 0.0, 0.0), silent=True)
            vehicle.fly(1.0, vigorous)
        assert vehicle.highest < SUSPECTS


def test_near_the_floor_and_after_a_fresh_start_nothing_counts() -> None:
    vehicle = under_way(1)
    assert vehicle.convicts_s(3.0, picture=attitude_mirrored_in_roll) < math.inf
    vehicle.monitor.restart()
    assert vehicle.share == 0.0
    vehicle.counts, vehicle.highest = False, 0.0
    vehicle.fly(3.0, picture=attitude_mirrored_in_roll)
    assert vehicle.highest == 0.0


def leaps(missing: int, leaps_at: int) -> bool:
    """Whether a pose that leaps by 1 cm at a step of 20 ms is suspect; each ``missing``-th is lost after 0.8 s."""
    monitor, level, last = Obedience(MASS_KG, G), Motion(ORIGIN, ORIGIN, LEVEL, 0.0, ORIGIN), 0.0
    for k in range(1, leaps_at + 6):
        if k >= 40 and k % missing == 0:
            continue
        time_s = 0.02 * k
        dt, last = time_s - last, time_s
        given = (LEVEL, MASS_KG * G, ORIGIN, (0.0, 0.0, MASS_KG * G * dt), ORIGIN)
        off_m = 0.01 if k >= leaps_at else 0.0
        monitor.pose(Pose(k, time_s, time_s, ORIGIN, LEVEL), level, given, dt, NOISE_M, counts=True, off_m=off_m)
    return monitor.evidence.suspicious


def test_what_leaps_after_a_lost_pose_is_suspect_where_poses_are_lost_all_the_time() -> None:
    assert leaps(1000, 51), "none is lost"
    assert leaps(5, 51), "the one before is lost, as some are in each second"
    assert not leaps(50, 51), "the one before is the first that is lost: commands may be, too"


def headings(asked: Callable[[float], float], answer_s: float, stray_rad_s: float) -> float:
    """Largest statistic of the heading in 10 s, where yaw follows what is ``asked`` [rad/s] with a lag and strays."""
    monitor, level, heading = Obedience(MASS_KG, G), Motion(ORIGIN, ORIGIN, LEVEL, 0.0, ORIGIN), 0.0
    rate, attitude, largest = 0.0, LEVEL, 0.0
    for k in range(1000):
        time_s = PERIOD_S * k
        told = rotate(LEVEL, (0.0, 0.0, asked(time_s) * PERIOD_S))
        given = (told, MASS_KG * G, ORIGIN, (0.0, 0.0, MASS_KG * G * PERIOD_S), ORIGIN)
        pose = Pose(k, time_s, time_s, ORIGIN, attitude)
        monitor.pose(pose, level, given, PERIOD_S, NOISE_M, counts=True)
        largest = max(largest, monitor.evidence.heading)
        rate += (asked(time_s) - rate) * PERIOD_S / answer_s
        heading += (rate + stray_rad_s) * PERIOD_S
        attitude = (math.cos(0.5 * heading), 0.0, 0.0, math.sin(0.5 * heading))
    return largest


def test_a_slow_answer_about_the_vertical_is_no_stray() -> None:
    def asked(time_s: float) -> float:
        return 1.4 if 3.0 < time_s < 4.5 else 0.0

    assert headings(asked, 0.35, 0.0) < HEADING_SUSPECTS


@pytest.mark.parametrize("held", [0.0, 1.0])
def test_a_heading_that_turns_by_itself_convicts_even_where_the_law_holds_it(held: float) -> None:
    stray = math.radians(20.0)
    assert headings(lambda time_s: -held * stray, 0.05, stray) > 1.0


def rested(place: Callable[[random.Random, float], float]) -> Obedience:
    """A monitor that has seen a vehicle stand for 20 s, and then fly for one."""
    rng, monitor, x = random.Random(3), Obedience(MASS_KG, G), 0.0
    level, given = (
        Motion(ORIGIN, ORIGIN, LEVEL, 0.0, ORIGIN),
        (LEVEL, MASS_KG * G, ORIGIN, (0.0, 0.0, MASS_KG * G * PERIOD_S), ORIGIN),
    )
    for k in range(2100):
        x = place(rng, x)
        pose = Pose(k, PERIOD_S * k, PERIOD_S * k, (x, x, x), LEVEL)
        if k < 2000:
            monitor.rest(pose)
        else:
            monitor.pose(pose, level, given, PERIOD_S, NOISE_M, counts=True)
    return monitor


def test_an_estimate_that_wanders_on_the_floor_may_have_gone_far_by_the_landing() -> None:
    wanders = rested(lambda rng, x: x + rng.gauss(0.0, 0.0035))
    assert wanders.astray_m(30.0) == pytest.approx(2.0 * 0.0035 * math.sqrt(3000.0), rel=0.3)
    assert wanders.astray_m(1e4) == 0.5


def test_a_camera_does_not_wander() -> None:
    assert rested(lambda rng, _: rng.gauss(0.0, NOISE_M)).astray_m(30.0) == 0.0
