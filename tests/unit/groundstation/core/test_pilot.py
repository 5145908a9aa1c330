"""The pilot's own bounds, on made-up poses: how far it leans off the figure, and from where it comes down."""

import math
from typing import Any

import pytest

from groundstation.core import Pilot, pilot
from groundstation.core.control import Gains, plan_model_descent, push, sine_error
from groundstation.core.geometry import Quat, Vec3
from groundstation.core.messages import Pose, SwitchRecord
from groundstation.core.trajectory import Hold, Reference
from groundstation.core.vehicle import Motion, Vehicle

G, PERIOD_S = 9.81, 0.01
VEHICLE = Vehicle()
LEVEL = (1.0, 0.0, 0.0, 0.0)
FARTHEST = math.sin(math.radians(40.0))


class Always(Hold):
    """A reference that is the same at all times, and need not rest."""

    def __init__(self, reference: Reference) -> None:
        super().__init__(reference.position_ned, 0.0)
        self._always = reference

    def at(self, time_s: float) -> Reference:
        """That."""
        return self._always


def leaning(degrees: float, azimuth_deg: float) -> Quat:
    """The attitude that leans so far, about a horizontal axis."""
    half, azimuth = 0.5 * math.radians(degrees), math.radians(azimuth_deg)
    return math.cos(half), math.sin(half) * math.cos(azimuth), math.sin(half) * math.sin(azimuth), 0.0


FAR = 20.0, -20.0, -5.0
"""It wants to go there with all that it has [m, NED]."""
NORTHWARDS = 4.0, 0.0, 0.0
"""An acceleration that a reference asks for [m/s², NED]."""
EVERYWHERE = range(0, 360, 30)


def turns_back(
    degrees: float, azimuth_deg: float, acceleration: Vec3, *, eased: bool, apart_s: float = 0.0
) -> tuple[float, float]:
    """How fast its first command turns it towards the push that the reference asks for [rad/s], and sin of how far.

    Ten poses come before it that are ``apart_s`` apart [s], or one.
    """
    flies, place, now = Pilot(VEHICLE, Gains(), 0.25, 0.0), (0.0, 0.0, -2.0), 0.0
    for n in range(10 if apart_s > 0.0 else 1):
        now = n * apart_s
        flies.pose(Pose(n, now, now, place, leaning(degrees, azimuth_deg)))
    flies.follow(Always(Reference(FAR, acceleration_ned=acceleration)), now)
    flies.ease(eased, asks=False)
    tick = flies.tick(now)
    roll, pitch = sine_error(tick.estimate.motion.attitude, push(acceleration, (0.0, 0.0, 0.0), G)[0])
    off, rates = math.hypot(roll, pitch), tick.decision.drive.rates
    return (rates[0] * roll + rates[1] * pitch) / off, off


ALONG = [
    ((0.0, 0.0, 0.0), 0.0),
    ((0.0, 0.0, 0.0), 90.0),
    ((0.0, 0.0, 0.0), 225.0),
    (NORTHWARDS, 90.0),
    (NORTHWARDS, 270.0),
]
"""An acceleration that is asked for, and an axis about which only that is leant away from or towards."""


@pytest.mark.parametrize(("acceleration", "azimuth_deg"), ALONG)
@pytest.mark.parametrize("degrees", [20.0, 35.0, 39.0, 41.0, 60.0, 80.0])
def test_off_the_figure_no_command_turns_it_beyond_40_degrees_from_the_push_that_is_asked_for(
    degrees: float, acceleration: Vec3, azimuth_deg: float
) -> None:
    """It turns away from there the slower, the nearer it is to that; beyond it every command brings it back."""
    back_rad_s, off = turns_back(degrees, azimuth_deg, acceleration, eased=True)
    assert back_rad_s >= 6.0 * (off - FARTHEST) - 1e-9


@pytest.mark.parametrize("degrees", [20.0, 35.0, 42.0, 50.0, 65.0, 80.0])
def test_where_a_body_rate_is_at_its_limit_it_is_brought_back_no_slower(degrees: float) -> None:
    """The law turns it along that bound as fast as it can, too: that gives way to what brings it back."""
    for azimuth_deg in EVERYWHERE:
        back_rad_s, off = turns_back(degrees, azimuth_deg, NORTHWARDS, eased=True)
        assert back_rad_s >= 6.0 * (off - FARTHEST) - 1e-9, azimuth_deg


def test_on_the_figure_nothing_but_the_law_says_how_far_it_leans() -> None:
    back_rad_s = [turns_back(41.0, azimuth_deg, (0.0, 0.0, 0.0), eased=False)[0] for azimuth_deg in EVERYWHERE]
    assert min(back_rad_s) < -1.0


def test_by_poses_that_are_few_it_leans_no_farther_on_the_figure_than_off_it() -> None:
    """Between them a north that is south carries the vehicle away unseen."""
    for azimuth_deg in EVERYWHERE:
        back_rad_s, off = turns_back(41.0, azimuth_deg, (0.0, 0.0, 0.0), eased=False, apart_s=0.2)
        assert back_rad_s >= 6.0 * (off - FARTHEST) - 1e-9


@pytest.mark.parametrize("azimuth_deg", EVERYWHERE)
@pytest.mark.parametrize("degrees", [0.5, 5.0, 30.0, 70.0, 120.0])
def test_what_may_stand_is_only_levelled_however_far_it_is_from_its_reference(
    degrees: float, azimuth_deg: float
) -> None:
    told: list[Any] = []
    flies, place = Pilot(VEHICLE, Gains(), 0.25, 0.0, tell=told.append), (0.0, 0.0, -0.4)
    flies.pose(Pose(0, 0.0, 0.0, place, leaning(degrees, azimuth_deg)))
    flies.follow(Hold((2.0, -2.0, -0.4), 0.0), 0.0)
    free = flies.tick(0.0).decision.drive
    for _ in range(3):
        flies.touch(True)
    tick = flies.tick(0.0)
    roll, pitch = sine_error(tick.estimate.motion.attitude, push((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), G)[0])
    thrust, (p, q, r) = tick.decision.drive
    back = (p * roll + q * pitch) / math.hypot(roll, pitch)
    assert back == pytest.approx(math.hypot(p, q), rel=0.02)  # nothing but that, save for the limits of the rates
    assert back > 0.0
    assert r == 0.0
    assert thrust == pytest.approx(free.thrust, rel=0.2)
    assert [one.values for one in told if isinstance(one, SwitchRecord)] == [(1.0,)]


LATE_S, SPEED_M_S, PUSHED_S, ENDS_S = 0.2, 1.0, 2.0, 3.2


def north_m(time_s: float) -> float:
    """It stands, and is pushed to a steady speed within 0.3 s."""
    since = time_s - PUSHED_S
    return 0.0 if since < 0.0 else SPEED_M_S * (0.5 * since * since / 0.3 if since < 0.3 else since - 0.15)


def surrendered(monkeypatch: pytest.MonkeyPatch, late_s: float) -> tuple[Motion, float]:
    """From where it comes down on the model, and where it is in truth, of poses that turned out to be so late."""
    begun: list[Motion] = []

    def plan(motion: Motion, *args: Any, **options: Any) -> Any:
        begun.append(motion)
        return plan_model_descent(motion, *args, **options)

    monkeypatch.setattr(pilot, "plan_model_descent", plan)
    flies, now = Pilot(VEHICLE, Gains(), 0.25, 0.0), 0.0
    for n in range(round(ENDS_S / PERIOD_S)):
        now = PERIOD_S * n
        flies.pose(Pose(n, now, now, (north_m(now - LATE_S), 0.0, -2.0), LEVEL))
        if n == 0:
            flies.follow(Always(Reference((0.0, 0.0, -2.0))), now)
        flies.idle(now, VEHICLE.mass_kg * G)
    flies.monitor.late_s, flies.monitor.calm_s = late_s, PUSHED_S
    flies.surrender(now, 0.05)
    return begun[0], north_m(now + VEHICLE.acting_delay_s)


def test_what_late_poses_show_is_believed_and_moved_on_by_how_late_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    motion, truth_m = surrendered(monkeypatch, LATE_S)
    assert motion.position[0] == pytest.approx(truth_m, abs=0.05)
    assert motion.velocity[0] == pytest.approx(SPEED_M_S, abs=0.1)


def test_of_poses_that_lie_is_believed_what_was_seen_before_that_began(monkeypatch: pytest.MonkeyPatch) -> None:
    motion, truth_m = surrendered(monkeypatch, 0.0)
    assert motion.velocity[0] == pytest.approx(0.0, abs=0.05)
    assert motion.position[0] < 0.1 < truth_m - 0.5


def pushed_share(*, doubts: bool) -> float:
    """Thrust by the weight [-] after 0.3 s of a wind down; the poses are in doubt then, or are not."""
    flies, now, sinks_m = Pilot(VEHICLE, Gains(), 0.25, 0.0), 0.0, 0.0
    for n in range(830):
        now = PERIOD_S * n
        sinks_m += 0.01 * 1.5 * max(now - 8.0, 0.0)
        flies.pose(Pose(n, now, now, (0.0, 0.0, -2.0 + sinks_m), LEVEL))
        if n == 0:
            flies.follow(Always(Reference((0.0, 0.0, -2.0))), now)
            flies.lift(now, 1.0, 0.0)
        flies.idle(now, VEHICLE.mass_kg * G)
    if doubts:
        flies.doubt()
    assert flies.suspicious is doubts
    return flies.tick(now).command.thrust_n / (VEHICLE.mass_kg * G)


def test_poses_beyond_belief_leave_the_law_its_trim_of_before_at_once() -> None:
    assert pushed_share(doubts=False) > 1.25
    assert pushed_share(doubts=True) == pytest.approx(1.0, abs=0.08)
