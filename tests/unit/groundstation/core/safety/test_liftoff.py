"""Limits for a vehicle on its floor, and many draws of a vehicle in one dimension."""

import math
import random
from collections.abc import Callable
from typing import NamedTuple

import pytest

from groundstation.core.geometry import so3
from groundstation.core.messages import Pose
from groundstation.core.safety import Spool, SpoolUp, StandingPoses
from groundstation.core.safety.takeoff import LiftOff, StandingWander
from groundstation.core.vehicle import Vehicle

LEVEL = (1.0, 0.0, 0.0, 0.0)
G, PERIOD_S, STEP_S, LATENCY_S = 9.81, 0.01, 0.002, 0.02


class Spooled(NamedTuple):
    """How a spool-up ended."""

    fault: str
    """Empty where it flies."""
    height_m: float
    hover_share: float = 0.0
    climb_off_m_s: float = 0.0
    """What it is believed to climb with less what it does."""


def spooled(seed: int, *, hover_share: float, wander_m: float) -> Spooled:
    """Spool up a vehicle that hovers at a share of its told weight.

    Its poses wander by ``wander_m`` in 2 s, 1σ [m].
    """
    draw, lag_s, noise_m = random.Random(seed), 0.05, 0.0003
    vehicle = Vehicle(mass_kg=1.0 / G, thrust_max_n=2.0, thrust_lag_s=lag_s)
    standing, walked, number = StandingPoses(), 0.0, 0

    def pose(at_s: float, up_m: float) -> Pose:
        nonlocal walked, number
        number += 1
        walked += draw.gauss(0.0, wander_m * math.sqrt(PERIOD_S / 2.0))
        down = -(up_m + walked + draw.gauss(0.0, noise_m))
        return Pose(number, at_s, at_s + LATENCY_S, (draw.gauss(0.0, noise_m), 0.0, down), LEVEL)

    for k in range(600):
        standing.add(pose(PERIOD_S * (k - 600), 0.0))
    spool_up = SpoolUp(standing, Spool(1.0, 1.3, 1.0, 0.0, 0.0, lag_s), vehicle, 1.0, G, noise_m)
    height = speed = thrust = told = 0.0
    coming: list[Pose] = []
    newest = standing.poses[-1]
    for k in range(round(4.0 / STEP_S)):
        now = STEP_S * k
        while coming and coming[0].arrival_s <= now:
            newest = coming.pop(0)
            spool_up.add_pose(newest)
        if k % round(PERIOD_S / STEP_S) == 0:
            coming.append(pose(now, height))
            if (flies := spool_up.lift_off) is not None:
                return Spooled("", height, flies.hover_share, flies.climb_m_s - speed)
            if fault := spool_up.find_fault(now, newest, 0.25, None):
                return Spooled(str(fault), height)
            told = spool_up.compute_thrust_n(now)
        thrust += (told - thrust) * (1.0 - math.exp(-STEP_S / lag_s))
        speed += STEP_S * G * (thrust / hover_share - 1.0)
        height += STEP_S * speed
        if height <= 0.0:
            height, speed = 0.0, max(speed, 0.0)
    raise AssertionError("it neither flies nor ends")


def test_thrust_rises_on_the_floor_in_these_steps() -> None:
    """To 60 % of 10 N in 2 s, smooth at both ends.

    To 90 % in 0.1 s; to the limit of 13 N in 0.15 s less the lag.
    """
    spool = Spool(10.0, 13.0, 2.0, 1.0, 5.0, 0.05)
    times_s = (4.0, 5.0, 5.5, 6.0, 6.5, 7.0, 7.05, 7.1, 7.15, 7.2, 9.0)
    assert [spool.thrust_n(now_s) for now_s in times_s] == pytest.approx(
        [1.0, 1.0, 1.78125, 3.5, 5.21875, 6.0, 7.5, 9.0, 11.0, 13.0, 13.0]
    )
    assert (spool.sure_s, spool.near_s) == pytest.approx((7.0, 7.1))
    slow = Spool(10.0, 13.0, 2.0, 1.0, 5.0, 0.2)
    assert slow.thrust_n(7.125) == pytest.approx(11.0), "the rise takes 50 ms at least"
    weak = Spool(10.0, 5.0, 2.0, 8.0, 5.0, 0.05)
    assert [weak.thrust_n(now_s) for now_s in (5.0, 7.0, 8.0)] == [5.0, 5.0, 5.0]


def standing(
    wander_m: float = 0.0, climb_m_s: float | None = None, resets: tuple[int, ...] = ()
) -> StandingPoses:
    """Three seconds at 50 Hz that step by ``wander_m`` aside and down, and back, each 0.5 s."""
    found = StandingPoses()
    for k in range(151):
        at_s, number, step = 0.02 * k, k // 25, k // 25 % 2
        velocity = None if climb_m_s is None else (0.0, 0.0, climb_m_s * step)
        place = (wander_m * step, -2.0 * wander_m * step, 3.0 * wander_m * step)
        count = resets[number] if resets else 0
        found.add(Pose(k, at_s, at_s, place, LEVEL, velocity_ned=velocity, reset_count=count))
    return found


@pytest.mark.parametrize(
    ("poses", "wander"),
    [
        (standing(), (0.0, 0.0, 0.0)),
        # steps of 1, 2 and 3 mm, twice a second: the worse axis counts
        (standing(0.001), (2.0 * 4e-6, 2.0 * 9e-6, 0.0)),
        (standing(0.001, 0.02), (2.0 * 4e-6, 2.0 * 9e-6, 2.0 * 4e-4)),
        # from one origin to another nothing has wandered
        (standing(0.001, resets=(0, 0, 1, 1, 2, 2, 2)), (2.0 * 4e-6, 2.0 * 9e-6, 0.0)),
        (StandingPoses(), (0.0, 0.0, 0.0)),
    ],
)
def test_the_wander_at_rest_is_the_growth_of_the_variance(
    poses: StandingPoses, wander: tuple[float, ...]
) -> None:
    assert tuple(poses.wander) == pytest.approx(wander)


@pytest.mark.parametrize(
    ("roll_deg", "aside_m", "light_s", "wander_m", "says"),
    [
        (5.9, 0.0, 0.0, 0.0, None),
        (6.1, 0.0, 0.0, 0.0, "tips: 6°"),
        (0.0, 0.049, 0.0, 0.0, None),
        (0.0, 0.051, 0.0, 0.0, "slides"),
        (0.0, 0.051, 0.1, 0.0, None),  # wind may move a light vehicle: 2.5 m/s² t²
        (0.0, 0.149, 0.2, 0.0, None),
        (0.0, 0.151, 0.2, 0.0, "slides"),
        (0.0, 0.061, 0.0, 0.001, None),  # four of a second's wander, 2.8 mm
        (0.0, 0.062, 0.0, 0.001, "slides"),
    ],
)
def test_a_vehicle_on_its_floor_neither_tips_nor_slides(
    roll_deg: float, aside_m: float, light_s: float, wander_m: float, says: str | None
) -> None:
    tilted = so3.from_euler_zyx(0.1, -0.1, 0.5)
    at_rest = standing(wander_m)
    at_rest.poses[-1] = Pose(151, 3.0, 3.0, (0.0, 0.0, 0.0), tilted)
    attitude = so3.multiply(tilted, so3.from_euler_zyx(math.radians(roll_deg), 0.0, 0.0))
    pose = Pose(152, 3.02, 3.02, (0.6 * aside_m, -0.8 * aside_m, 0.3), attitude)
    found = at_rest.find_disturbance(pose, (0.0, 0.0, 0.0), light_s)
    assert (found is None) is (says is None)
    assert (says or "") in str(found)
    moved = Pose(152, 3.02, 3.02, (9.0, 0.0, 0.0), LEVEL, reset_count=1)
    after = at_rest.find_disturbance(moved, (0.0, 0.0, 0.0), light_s)
    assert after is None, "the source has moved its origin"


Shown = Callable[[float], tuple[float, float | None] | None]
"""Height [m] and speed upwards [m/s] of the pose that shows a time [s]; None where none comes."""
NOT_MOVED, NOT_LEFT = "the poses did not move", "did not leave the floor"
SPOOL_UPS: dict[str, tuple[Shown, float | None, str | None]] = {
    "a true lift-off": (lambda s: (max(s - 1.15, 0.0) ** 2, None), None, None),
    "upwards at rest already": (lambda s: (0.0, 0.3), 1.4, NOT_MOVED),
    # 0.25 s after the newest
    "no pose after a while": (lambda s: (0.0, None) if s <= 0.5 else None, 0.76, "no pose for 26"),
    # 0.3 s after thrust had 90 % of the weight
    "the floor": (lambda s: (0.0, None), 1.40, NOT_MOVED),
    "a rise for a moment": (lambda s: (0.004 * (1.18 < s < 1.26), None), 1.40, NOT_MOVED),
    "jumps of 0.2 m": (
        lambda s: (0.2 * (s > 1.05 and round(100.0 * s) % 8 < 4), None), None, "jumps",
    ),
    # 0.25 s, and twice the time to 0.35 m at g/4, after it moved
    "a rise that an autopilot felt": (
        lambda s: (0.004, 0.12) if 1.18 < s < 1.26 else (0.0, 0.0), 2.52, NOT_LEFT,
    ),
}  # fmt: skip
"""What poses show; when the spool-up ends [s]; and why, where it does not fly."""


def spool_up_at(at_rest: StandingPoses, begun_s: float, noise_m: float = 0.0003) -> SpoolUp:
    spool = Spool(1.0, 1.3, 1.0, 0.0, begun_s, 0.05)
    return SpoolUp(at_rest, spool, Vehicle(mass_kg=1.0 / G), 1.0, G, noise_m)


@pytest.mark.parametrize(("shows", "ends_s", "says"), SPOOL_UPS.values(), ids=SPOOL_UPS)
def test_a_spool_up_ends_for_these_reasons_at_these_times(
    shows: Shown, ends_s: float | None, says: str | None
) -> None:
    def pose(since_s: float) -> Pose | None:
        if (shown := shows(since_s)) is None:
            return None
        number, at_s, place = 200 + round(100.0 * since_s), 3.0 + since_s, (0.0, 0.0, -shown[0])
        velocity = None if shown[1] is None else (0.0, 0.0, -shown[1])
        return Pose(number, at_s, at_s, place, LEVEL, velocity_ned=velocity)

    newest, since_s = pose(0.0), 0.0
    assert newest is not None
    at_rest = standing(climb_m_s=None if newest.velocity_ned is None else 0.0)
    at_rest.add(newest)
    spool_up = spool_up_at(at_rest, 3.0)
    for k in range(1, 300):
        since_s = 0.01 * k
        if (seen := pose(since_s)) is not None:
            newest = seen
            spool_up.add_pose(newest)
        assert spool_up.compute_thrust_n(3.0 + since_s) <= 1.3
        if spool_up.lift_off is not None:
            break
        if fault := spool_up.find_fault(3.0 + since_s, newest, 0.25, None):
            assert says is not None and says in fault.text
            assert ends_s is None or since_s == pytest.approx(ends_s, abs=0.025)
            return
    assert says is None and spool_up.lift_off is not None
    assert spool_up.lift_off.climb_m_s == pytest.approx(2.0 * (since_s - 1.15), abs=0.3)


@pytest.mark.parametrize(
    ("step_m", "elapsed_s", "noise_m", "resets", "stranger"),
    [
        (0.08, 0.02, 0.0003, 0, True),  # another body has its name
        (0.02, 0.02, 0.0003, 0, False),
        (0.08, 0.02, 0.0003, 1, False),  # the source has moved its origin, and says so
        (0.08, 0.02, 0.02, 0, False),  # noise
        (0.08, 0.1, 0.0003, 0, False),  # wind, as it becomes light
    ],
)
def test_what_leaps_aside_on_the_floor_as_no_vehicle_does_stops_the_motors(
    step_m: float, elapsed_s: float, noise_m: float, resets: int, stranger: bool
) -> None:
    standing = StandingPoses()
    for k in range(100):
        standing.add(Pose(k, 0.02 * k, 0.02 * k, (0.0, 0.0, 0.0), LEVEL))
    spool_up = spool_up_at(standing, 1.8, noise_m)
    at_s = 1.98 + elapsed_s + 0.8  # thrust is at 60 % of the weight
    aside = (step_m, 0.0, 0.0)
    after = Pose(102, at_s + 0.01, at_s + 0.01, aside, LEVEL, reset_count=resets)
    spool_up.add_pose(Pose(100, at_s - elapsed_s, at_s, (0.0, 0.0, 0.0), LEVEL))
    spool_up.add_pose(Pose(101, at_s, at_s, aside, LEVEL, reset_count=resets))
    spool_up.add_pose(after)
    fault = spool_up.find_fault(at_s + 0.01, after, 0.25, None)
    assert ("from one pose to the next" in str(fault)) is stranger


@pytest.mark.tried(2)  # loads, with and without an estimate that wanders
@pytest.mark.parametrize("wander_m", [0.0, 0.01, 0.05])
@pytest.mark.parametrize("hover_share", [0.75, 0.9, 1.0, 1.1])
def test_a_vehicle_that_lifts_is_seen_to_fly_and_its_hover_thrust_and_speed_are_found(
    hover_share: float, wander_m: float
) -> None:
    seen = [spooled(seed, hover_share=hover_share, wander_m=wander_m) for seed in range(40)]
    flown = [one for one in seen if not one.fault]
    if hover_share <= 1.0:
        assert len(flown) >= (40 if wander_m < 0.05 else 20)
    assert all(one.height_m < 0.4 for one in flown)
    exact = 0.12 if wander_m == 0.0 else 0.3
    assert all(abs(one.hover_share - hover_share) < exact for one in flown)
    assert all(abs(one.climb_off_m_s) < 2.0 * exact for one in flown)


@pytest.mark.tried(1)  # lightest
@pytest.mark.parametrize("hover_share", [0.25, 0.4, 0.5, 0.55])
def test_a_vehicle_that_no_configured_thrust_should_lift_yet_is_stopped_just_above_the_floor(
    hover_share: float,
) -> None:
    seen = [spooled(seed, hover_share=hover_share, wander_m=0.0) for seed in range(10)]
    assert all("leaves the floor by 60 % of its configured weight" in one.fault for one in seen)
    assert all(one.height_m < 0.15 for one in seen)


def test_the_lightest_vehicle_that_may_fly_is_not_too_light() -> None:
    seen = [spooled(seed, hover_share=0.7, wander_m=0.0) for seed in range(40)]
    assert not any(one.fault for one in seen)


@pytest.mark.tried(1)  # 50 of 200 seeds
@pytest.mark.parametrize("first", range(0, 200, 50))
def test_heights_that_wander_alone_fly_hardly_ever(first: int) -> None:
    """The estimate wanders by 5 cm in 2 s; the vehicle stands, too heavy for its rotors."""
    seeds = range(first, first + 50)
    flown = [seed for seed in seeds if not spooled(seed, hover_share=1.6, wander_m=0.05).fault]
    assert len(flown) <= 1


@pytest.mark.parametrize("hover_share", [0.8, 1.0, 1.2])
def test_hover_thrust_and_climb_of_an_exact_motion_are_found(hover_share: float) -> None:
    """At 1.5 of the weight from the first pose on, without lag: a = g (1.5 / share - 1)."""
    at_rest, wander = Pose(0, 0.0, 0.0, (0.0, 0.0, 0.0), LEVEL), StandingWander(0.0, 0.0, 0.0)
    lift = LiftOff(at_rest, 0.0, 1.0, 0.0, G, wander, 0.0003)
    lift.add_command(0.0, 1.5)
    acceleration = G * (1.5 / hover_share - 1.0)
    for k in range(1, 21):
        time_s = 0.02 * k
        lift.add_pose(Pose(k, time_s, time_s, (0.0, 0.0, -0.5 * acceleration * time_s**2), LEVEL))
    assert lift.is_flying and not lift.has_jumped
    assert lift.hover_share == pytest.approx(hover_share, rel=0.005)
    assert lift.climb_m_s == pytest.approx(0.4 * acceleration, rel=0.01)
    is_fast = 0.4 * acceleration > 1.0  # what rushes up gets no more than its hover thrust
    lead = 1.0 if is_fast else 1.1
    assert lift.climbing_share == pytest.approx(lead * hover_share, rel=0.005)


def climbing(count: int, *, thrust_n: float, acceleration_m_s2: float) -> LiftOff:
    """``count`` poses with a velocity, 20 ms apart, of a vehicle of 1 N that begins to rise."""
    at_rest = Pose(0, 0.0, 0.0, (0.0, 0.0, 0.0), LEVEL, velocity_ned=(0.0, 0.0, 0.0))
    lift = LiftOff(at_rest, 0.0, 1.0, 0.0, G, StandingWander(0.0, 0.0, 0.0), 0.0003)
    lift.add_command(0.0, thrust_n)
    for k in range(1, count + 1):
        time_s = 0.02 * k
        down = -0.5 * acceleration_m_s2 * time_s**2
        speed = (0.0, 0.0, -acceleration_m_s2 * time_s)
        lift.add_pose(Pose(k, time_s, time_s, (0.0, 0.0, down), LEVEL, velocity_ned=speed))
    return lift


def test_an_estimate_that_moves_its_origin_up_has_not_lifted_the_vehicle() -> None:
    lift = climbing(30, thrust_n=1.1, acceleration_m_s2=0.1 * G)  # 0.18 m high
    assert lift.is_moving and not lift.is_high
    speed = (0.0, 0.0, -0.06 * G)
    lift.add_pose(Pose(31, 0.62, 0.62, (0.0, 0.0, -1.2), LEVEL, velocity_ned=speed, reset_count=1))
    assert not lift.is_high


def test_an_estimate_whose_speed_is_reset_on_the_floor_does_not_move() -> None:
    lift = climbing(20, thrust_n=1.1, acceleration_m_s2=0.0)  # the vehicle is heavier than told
    for k in range(21, 46):
        time_s, speed = 0.02 * k, (0.0, 0.0, -1.0)
        lift.add_pose(
            Pose(k, time_s, time_s, (0.0, 0.0, 0.0), LEVEL, velocity_ned=speed, reset_count=1)
        )
        assert not lift.is_moving
