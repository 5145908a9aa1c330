"""Guards in flight, from what is broken to the floor."""

import asyncio
from collections.abc import Callable

import pytest

from groundstation.core.geometry import Quat, Vec3, so3
from groundstation.core.mission import State
from groundstation.core.safety import Fence
from groundstation.core.safety.geofence import BoxFence
from groundstation.flight import Flight
from sim.autopilots import Px4Autopilot
from sim.autopilots.dialects import Px4Mode
from sim.runs import MissionResult, Stage
from sim.runs.flight import Script
from tests.flight.flights import SHORT, in_state, mission as fly, nothing
from tests.known import known
from tests.loops import until

Wrong = Callable[[Vec3, Quat], tuple[Vec3, Quat]]


def mission(script: Script, *overrides: str, figure_s: float = 3.0) -> MissionResult:
    return fly("paper", *SHORT, *overrides, figure_s=figure_s, script=script)


async def tracking(flight: Flight, seconds: float = 1.0) -> None:
    await until(lambda: flight.state is State.TRACKING)
    await asyncio.sleep(seconds)


def covered(for_s: float) -> Script:
    async def script(flight: Flight, stage: Stage) -> None:
        await tracking(flight)
        known(stage.mocap).cover(True)
        await asyncio.sleep(for_s)
        known(stage.mocap).cover(False)

    return script


def seeing(wrong: Wrong, for_s: float) -> Script:
    """The cameras see something else for a while."""

    async def script(flight: Flight, stage: Stage) -> None:
        await tracking(flight)
        mocap = known(stage.mocap)
        right = mocap._observe
        vars(mocap)["_observe"] = lambda poses, when: right([wrong(*pose) for pose in poses], when)
        await asyncio.sleep(for_s)
        del vars(mocap)["_observe"]

    return script


def elsewhere(place: Vec3, attitude: Quat) -> tuple[Vec3, Quat]:
    return (place[0] + 1.0, *place[1:]), attitude


def turned(place: Vec3, attitude: Quat) -> tuple[Vec3, Quat]:
    return place, so3.multiply(attitude, (0.0, 0.0, 0.0, 1.0))


def states(flown: MissionResult) -> list[str]:
    return [one.state for one in flown.states]


@pytest.mark.parametrize("for_s", [0.28, 0.4])
def test_poses_that_come_back_in_time_find_a_descent_that_ends_softly(for_s: float) -> None:
    flown = mission(covered(for_s))
    assert states(flown)[-3:] == ["descent", "disarming", "landed"]
    assert "no pose for 24" in flown.fault
    assert not flown.landed
    assert known(flown.touchdown_m_s) < 1.0


@pytest.mark.tried(1)  # places
@pytest.mark.parametrize("wrong", [elsewhere, turned])
def test_a_few_poses_that_jump_are_not_believed_and_change_nothing(wrong: Wrong) -> None:
    flown = mission(seeing(wrong, 0.1))
    assert flown.landed, flown.fault
    assert flown.tilt_max_deg < 15.0


@pytest.mark.parametrize("wrong", [elsewhere, turned])
def test_poses_that_have_jumped_for_good_are_as_none(wrong: Wrong) -> None:
    flown = mission(seeing(wrong, 60.0))
    assert states(flown)[-2:] == ["descent", "aborted"]
    assert flown.tilt_max_deg < 25.0


def test_an_autopilot_that_a_pilot_takes_over_is_his_at_once_and_nothing_leaves_any_more() -> None:
    left: list[tuple[float, int]] = []
    when: list[float] = []

    async def script(flight: Flight, stage: Stage) -> None:
        await tracking(flight)
        autopilot = stage.autopilot
        assert isinstance(autopilot, Px4Autopilot)
        autopilot._intended = (3, 0)
        when.append(asyncio.get_running_loop().time())
        while True:
            left.append((asyncio.get_running_loop().time(), flight.snapshot().link.sent))
            await asyncio.sleep(0.01)

    flown = mission(script)
    assert states(flown)[-1] == "handed_over"
    assert "the autopilot is in POSCTL" in flown.states[-1].reason
    over_s = flown.states[-1].time_s
    assert over_s - when[0] < 1.05  # its next heartbeat
    at_end = [sent for t, sent in left if t > over_s + 0.02]
    assert len(set(at_end)) <= 1


@pytest.mark.tried(2)  # instants between two heartbeats
@pytest.mark.parametrize("wait_s", [1.0, 1.4, 1.8])
@pytest.mark.parametrize("blind", [False, True], ids=["sees", "blind"])
def test_who_takes_over_between_two_heartbeats_keeps_the_vehicle(
    wait_s: float, blind: bool
) -> None:
    modes: set[tuple[int, int]] = set()

    async def script(flight: Flight, stage: Stage) -> None:
        await tracking(flight, wait_s)
        autopilot = stage.autopilot
        assert isinstance(autopilot, Px4Autopilot)
        autopilot.take_over(asyncio.get_running_loop().time())
        known(stage.mocap).cover(blind)
        while autopilot.armed:
            modes.add(autopilot.mode)
            await asyncio.sleep(0.005)

    flown = mission(script, "sim.own_estimate=true")
    assert modes == {Px4Mode.POSCTL}, "nobody asked it to land"
    if not blind:
        assert states(flown)[-1] == "handed_over"


GUST = "sim.wind_step_time_s=12.0"


def test_a_gust_beyond_all_limits_ends_the_flight_softly() -> None:
    flown = mission(nothing, "sim.wind_step=[12.0, 0.0, 0.0]", GUST, figure_s=20.0)
    assert not flown.landed
    assert flown.fault
    assert known(flown.touchdown_m_s) < 3.5


def test_a_hold_at_full_thrust_lands_though_tones_are_flown_in_it() -> None:
    """A wind down of 8 m/s² asks for a little more than the vehicle has."""

    down = (0.0, 0.0, 8.0)
    push_down = in_state(
        State.HOLD, lambda _, stage: setattr(stage.plant, "pull", lambda body: down), 0.0
    )
    lenient = ("guards.error_m=50.0", "guards.speed_m_s=50.0", "vehicle.hover_range=[0.5, 1.9]")
    flown = mission(push_down, *lenient)
    assert "thrust at its limit" in flown.fault


def test_a_bridge_s_own_period_is_what_its_frames_are_late_by() -> None:
    told: list[float] = []

    async def script(flight: Flight, _: Stage) -> None:
        guards = known(flight._controller._guards)
        told.append(guards._view.period_s())
        await tracking(flight)
        told.append(guards._view.period_s())

    assert fly("paper", *SHORT, "sim.frame_period_s=0.011", link="rf_bridge", script=script).landed
    # What is assumed until it is connected, and what the bridge then tells.
    assert told == [0.0225, 0.011]


def test_the_fence_holds_before_it_and_a_hold_waits_for_the_operator() -> None:
    """The fence is laid once it flies: before, the pre-flight checks refuse such a trajectory."""

    async def script(flight: Flight, stage: Stage) -> None:
        await tracking(flight, 6.0)
        guards = known(flight._controller._guards)
        north = stage.plant.truth(asyncio.get_running_loop().time()).position_ned[0]
        ahead = known(flight._controller.tick)
        sign = 1.0 if ahead.reference.velocity_ned[0] > 0.0 else -1.0
        side = (-9.0, north + 0.6) if sign > 0.0 else (north - 0.6, 9.0)
        box = BoxFence(north_m=side, east_m=(-9.0, 9.0), height_m=9.0)
        guards._view.fence = fence = Fence(box, 1.0)
        while flight.state is State.TRACKING:
            await asyncio.sleep(0.01)
        assert flight.state is State.HOLD
        await asyncio.sleep(3.0)
        assert flight.state is State.HOLD
        assert fence.room_m(stage.plant.truth(asyncio.get_running_loop().time()).position_ned) > 0.0
        flight.land("seen")

    flown = mission(script, figure_s=60.0)
    assert "before the fence" in flown.fault
    assert states(flown)[-4:] == ["hold", "landing", "disarming", "landed"]


BOX = ("fence.kind=box", "fence.height_m=3.0")


@pytest.mark.parametrize(("overrides", "says"), [
    (["flight.floor_z_m=0.5"], "floor: position +1.00 m (down) at rest, flight.floor_z_m is +0.50"),
    ([*BOX, "fence.north_m=[-0.5, 1.0]", "fence.east_m=[-1.0, 0.5]"], "could not brake within"),
])  # fmt: skip
def test_a_flight_that_fails_its_checks_does_not_begin(overrides: list[str], says: str) -> None:
    flown = mission(nothing, *overrides)
    assert states(flown) == ["connecting", "aborted"]
    assert says in flown.why
    assert flown.touchdown_m_s is None
