"""The pilot's own bounds, on made-up poses."""

import math
from typing import Any

import pytest

from groundstation.core.control import (
    HOLDING,
    TRACKING,
    TRANSIT,
    FlightProfile,
    Gains,
    sine_error,
    specific_thrust,
)
from groundstation.core.geometry import IDENTITY, ZERO, Quat
from groundstation.core.health import PoseHealth
from groundstation.core.messages import Estimate, Pose, SwitchRecord
from groundstation.core.pilot import Pilot
from groundstation.core.pilot.vehicle_state import MeanDisturbance
from groundstation.core.trajectory import Hold
from groundstation.core.vehicle import Motion, Vehicle

G, PERIOD_S = 9.81, 0.01
VEHICLE = Vehicle()


def leaning(degrees: float, azimuth_deg: float) -> Quat:
    """The attitude that leans so far, about a horizontal axis."""
    half, azimuth = 0.5 * math.radians(degrees), math.radians(azimuth_deg)
    x, y = math.sin(half) * math.cos(azimuth), math.sin(half) * math.sin(azimuth)
    return (math.cos(half), x, y, 0.0)


EVERYWHERE = range(0, 360, 30)


@pytest.mark.parametrize("azimuth_deg", EVERYWHERE)
@pytest.mark.parametrize("degrees", [0.5, 5.0, 30.0, 70.0, 120.0])
def test_what_may_stand_is_only_levelled_however_far_it_is_from_its_reference(
    degrees: float, azimuth_deg: float
) -> None:
    told: list[Any] = []
    flies, place = Pilot(VEHICLE, Gains(), 0.25, 0.0, record=told.append), (0.0, 0.0, -0.4)
    flies.estimate_state(Pose(0, 0.0, 0.0, place, leaning(degrees, azimuth_deg)))
    flies.use_profile(TRANSIT)
    flies.follow(Hold((2.0, -2.0, -0.4), 0.0), 0.0)
    free = flies.compute_command(0.0).decision.drive
    for _ in range(3):
        flies.set_ground_contact(True)
    tick = flies.compute_command(0.0)
    roll, pitch = sine_error(tick.estimate.motion.attitude, specific_thrust(ZERO, ZERO, G)[0])
    thrust, (p, q, r) = tick.decision.drive
    back = (p * roll + q * pitch) / math.hypot(roll, pitch)
    # Nothing but that, save for the limits of the rates.
    assert back == pytest.approx(math.hypot(p, q), rel=0.02)
    assert back > 0.0
    assert r == 0.0
    assert thrust == pytest.approx(free.thrust, rel=0.2, abs=0.06)
    switches = [one for one in told if isinstance(one, SwitchRecord) and one.what == "touch"]
    assert [one.values for one in switches] == [(1.0,)]


def blown(down: float, effectiveness: float = 1.0) -> Estimate:
    """Estimate of a disturbance downwards [m/s²] and a thrust scale [-]."""
    return Estimate(
        0.0, Motion(ZERO, ZERO, IDENTITY, 0.8, ZERO), (0.0, 0.0, down), ZERO, effectiveness, 0.0
    )


def test_the_mean_disturbance_is_that_since_the_beginning_and_later_that_of_late() -> None:
    mean = MeanDisturbance(G)
    for n in range(300):  # 3 s: what the observer began with counts as any other
        mean.add(blown(-5.0 if n == 0 else 1.0), 0.01)
    assert mean.value is not None and mean.value[2] == pytest.approx(1.0 - 6.0 / 300, abs=1e-3)
    for _ in range(900):
        mean.add(blown(2.0), 0.01)
    assert mean.value[2] == pytest.approx(2.0 - math.exp(-3.0), abs=0.02)
    assert mean.add(blown(9.0), 0.0) == mean.value


def test_once_the_poses_have_answered_the_disturbance_since_they_were_asked_is_the_mean() -> None:
    mean = MeanDisturbance(G)
    for n in range(400):
        mean.add(blown(0.2 if n < 300 else 3.0, 1.0), 0.01, is_suspect=n >= 310)
    assert mean.value is not None and mean.value[2] < 1.5
    mean.confirm()
    assert mean.value == pytest.approx((0.0, 0.0, 3.0))
    mean.add(blown(3.0, 1.0), 0.01)
    mean.confirm()  # no question: nothing is new
    assert mean.value == pytest.approx((0.0, 0.0, 3.0))


def test_the_mean_disturbance_goes_with_the_thrust_scale_of_now() -> None:
    """A scale that is learnt is no change of the wind."""
    mean = MeanDisturbance(G)
    for n in range(100):
        mean.add(blown(0.55 if n < 99 else 0.55 - 0.035 * G, 1.035 if n < 99 else 1.0), 0.01)
    assert mean.value == pytest.approx((0.0, 0.0, 0.55 - 0.035 * G), abs=1e-6)


class WatchedHealth(PoseHealth):
    """Health that notes the poses it is given."""

    def __init__(self, mass_kg: float, gravity: float) -> None:
        super().__init__(mass_kg, gravity)
        self.compared: list[int] = []

    def add_pose(self, pose: Pose, *args: Any, **told: Any) -> None:
        self.compared.append(pose.id)
        super().add_pose(pose, *args, **told)


@pytest.mark.parametrize(
    ("follows_poses", "is_suspect", "before"),
    [(True, False, []), (True, True, [1]), (False, False, [1])],
)
def test_only_a_calm_pose_that_a_command_follows_is_compared_after_that_command(
    follows_poses: bool, is_suspect: bool, before: list[int]
) -> None:
    flies = Pilot(VEHICLE, Gains(), 0.25, 0.0, health=WatchedHealth, follows_poses=follows_poses)
    health = flies.state.health
    assert isinstance(health, WatchedHealth)

    def come(number: int) -> None:
        flies.estimate_state(
            Pose(number, 0.02 * number, 0.0, (0.0, 0.0, -1.0), (1.0, 0.0, 0.0, 0.0))
        )

    come(0)
    flies.follow(Hold((0.0, 0.0, -1.0), 0.0), 0.0)
    if is_suspect:
        health.suspect(0.0)
    come(1)
    assert health.compared == before
    flies.compute_command(0.02)
    flies.state.check_response()
    flies.state.check_response()
    assert health.compared == [1], "once, after the command"
    come(2)
    come(3)
    assert health.compared[:2] == [1, 2], "where no command leaves, the next pose brings it"


@pytest.mark.parametrize(("for_s", "apart_s"), [(1.0, 0.1 - 0.09 * math.exp(-1.0)), (5.0, 0.1)])
def test_the_interval_of_the_poses_is_a_mean_over_a_second(for_s: float, apart_s: float) -> None:
    state = Pilot(VEHICLE, Gains(), 0.25, 0.0).state
    times_s = [
        *(0.01 * n for n in range(1000)),
        *(10.0 + 0.1 * n for n in range(round(10 * for_s))),
    ]
    for number, time_s in enumerate(times_s):
        state.received.add(Pose(number, time_s, time_s, ZERO, IDENTITY))
    assert state.received.apart_s == pytest.approx(apart_s, abs=0.01)


def test_the_last_command_of_a_flight_without_poses_falls_and_ends_without_thrust() -> None:
    flies = Pilot(VEHICLE, Gains(), 0.25, 0.0)
    flies.estimate_state(Pose(0, 0.0, 0.0, (0.0, 0.0, -1.0), IDENTITY))
    flies.follow(Hold((0.0, 0.0, -1.0), 0.0), 0.0)
    flies.compute_command(0.0)
    command = flies.plan_open_loop_descent(0.5, 0.02)
    assert (command.pose_id, command.deadline_s) == (0, 0.52)
    assert command.thrust_n < VEHICLE.mass_kg * G
    assert command.bring_down[-1].thrust_n == 0.0


@pytest.mark.parametrize(
    ("profile", "values"),
    [(TRANSIT, (1.0, 1.0, 1.0)), (HOLDING, (1.0, 1.0, 0.0)), (TRACKING, (0.0, 0.0, 0.0))],
)
def test_a_recording_tells_by_which_profile_is_flown(
    profile: FlightProfile, values: tuple[float, ...]
) -> None:
    told: list[Any] = []
    Pilot(VEHICLE, Gains(), 0.25, 0.0, record=told.append).use_profile(profile)
    assert [(one.what, one.values) for one in told] == [("ease", values)]
