"""Spool-up in whole flights: poses or a mass that are not the vehicle's own, and wind."""

import asyncio
from collections.abc import Callable, Sequence
from typing import NamedTuple

import pytest
from hypothesis import assume, given, settings, strategies as st

from groundstation.core.geometry import Vec3, so3
from groundstation.core.messages import Tick
from groundstation.core.mission import State
from groundstation.flight import Flight
from sim.runs import MissionResult, Stage, fly, fly_mission, from_floor
from sim.scenarios import SCENARIOS, prepare
from sim.trackers import TrackedBody
from sim.world import Quadrotor
from tests.flight.flights import ticks_to
from tests.known import known
from tests.proving.faults import stand_between
from tests.proving.faults.pictures import Send
from tests.proving.takeoff_start import TakeoffStart

LIMITS_M, LIMITS_M_S = 0.8, 3.0

Picture = Callable[[TrackedBody, float], TrackedBody | None]
"""What is made of our body in the picture of an instant [s]; None: no frame leaves."""


class Flown(NamedTuple):
    """How high and how fast it was, by the truth, and what ended it."""

    mission: MissionResult
    highest_m: float
    fastest_m_s: float
    most: float
    """Largest thrust told, as a share of the told weight [-]."""
    after_s: float
    """How long the motors were told 0.9 of the weight or more [s]."""


LOOK_S = 0.005
"""How often a spool-up is looked at [s]."""


def spool_up(
    scenario: str, *overrides: str, picture: Picture | None = None, link: str = "mavlink"
) -> Flown:
    """A flight from the floor, whose picture is meddled with."""
    world, config = from_floor(*prepare(SCENARIOS[scenario], list(overrides), link=link), 2.0)
    seen = {"high": 0.0, "fast": 0.0, "most": 0.0, "near": 0.0, "told": 0.0}

    async def script(flight: Flight, stage: Stage) -> None:
        def way(send: Send, frame: int, exposure_s: float, bodies: Sequence[TrackedBody]) -> None:
            ours = bodies[0] if picture is None else picture(bodies[0], exposure_s)
            if ours is not None:
                send(frame, exposure_s, [ours, *bodies[1:]])

        meddler = known(stand_between(stage))
        meddler.way = way
        tell = Quadrotor.command

        def told(plant: Quadrotor, time_s: float, thrust_n: float, rates: Vec3) -> None:
            seen["most"], seen["told"] = max(seen["most"], thrust_n), thrust_n
            tell(plant, time_s, thrust_n, rates)

        loop = asyncio.get_running_loop()
        end, weight = loop.time() + 12.0, config.weight_n
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(Quadrotor, "command", told)
            while loop.time() < end and flight.state is not State.HOLD:
                truth = stage.plant.truth(loop.time())
                seen["high"] = max(seen["high"], world.floor_z_m - truth.position_ned[2])
                seen["fast"] = max(seen["fast"], *(abs(v) for v in truth.velocity_ned))
                seen["near"] += LOOK_S * (seen["told"] > 0.9 * weight)
                await asyncio.sleep(LOOK_S)
        flight.stop("the test is over")

    mission = fly_mission(world, config, seed=0, script=script)
    return Flown(mission, seen["high"], seen["fast"], seen["most"] / config.weight_n, seen["near"])


def resting(ours: TrackedBody, _: float) -> TrackedBody:
    """Another body, which rests on the floor two metres aside."""
    return ours._replace(
        position_ned=(1.2, 1.2, 1.0 + 1e-4 * hash(ours.position_ned) / 2**63), attitude=so3.IDENTITY
    )


STRONGER = "sim.thrust_gain=1.25"


@pytest.mark.tried(4)  # instants
@pytest.mark.parametrize("link", ["mavlink", "dsm"])
@pytest.mark.parametrize("scenario", ["paper", "quad1kg"])
@pytest.mark.parametrize(("told_mass", "wrong"), [(1.0, ()), (1.0, (STRONGER,)), (1.25, ())])
def test_the_poses_of_another_body_that_rests_let_nothing_fly_away(
    scenario: str, link: str, told_mass: float, wrong: tuple[str, ...]
) -> None:
    mass = f"vehicle.mass_kg={told_mass * SCENARIOS[scenario].vehicle.mass_kg}"
    flown = spool_up(scenario, mass, *wrong, "gate.drop_frozen=false", picture=resting, link=link)
    assert "is this the right body, is the mass right?" in flown.mission.fault
    assert flown.highest_m < LIMITS_M
    assert flown.fastest_m_s < LIMITS_M_S
    assert flown.after_s <= 0.33
    # Before lift-off: 1.3 of the told weight, and half a count of DSM.
    assert 1.25 <= flown.most <= 1.302
    assert [one.state for one in flown.mission.states][-2:] == ["disarming", "landed"]


def test_the_poses_of_another_body_with_weight_and_thrust_both_wrong_are_not_much_worse() -> None:
    """Thrust a fifth above, weight a quarter below what is told: twice the weight is pushed."""
    told = ("vehicle.mass_kg=1.25", STRONGER, "gate.drop_frozen=false")
    flown = spool_up("quad1kg", *told, picture=resting)
    assert "is this the right body" in flown.mission.fault
    assert flown.highest_m < 1.0
    assert flown.fastest_m_s < 4.5


@pytest.mark.parametrize(
    ("scenario", "wrong"),
    [
        ("paper", ("sim.mass_kg=0.02",)),
        ("paper", ("sim.mass_kg=0.03", "takeoff.spool_s=0.2")),
        ("quad1kg", ("sim.thrust_gain=1.9",)),
    ],
)
def test_a_vehicle_much_lighter_or_stronger_than_told_stays_near_the_floor(
    scenario: str, wrong: tuple[str, ...]
) -> None:
    """With the controller it would rise for metres before its thrust is known."""
    flown = spool_up(scenario, *wrong)
    assert "leaves the floor by 60 % of its configured weight, or less" in flown.mission.fault
    assert flown.highest_m < 0.25
    assert [one.state for one in flown.mission.states][-2:] == ["disarming", "landed"]


def tipping(ours: TrackedBody, at_s: float) -> TrackedBody:
    return ours._replace(attitude=so3.from_euler_zyx(1.0 * max(at_s - 4.8, 0.0), 0.0, 0.0))


def sliding(ours: TrackedBody, at_s: float) -> TrackedBody:
    x, y, z = ours.position_ned
    return ours._replace(position_ned=(x + 0.2 * max(at_s - 4.6, 0.0), y, z))


def lost(ours: TrackedBody, at_s: float) -> TrackedBody | None:
    return ours if at_s < 4.9 else None


def leaping(ours: TrackedBody, at_s: float) -> TrackedBody:
    x, y, z = ours.position_ned
    return ours._replace(position_ned=(x, y, z - (0.5 if at_s > 5.3 else 0.0)))


def carried_out(ours: TrackedBody, at_s: float) -> TrackedBody:
    return ours._replace(position_ned=(2.1, *ours.position_ned[1:])) if at_s > 4.6 else ours


FENCE = ("fence.kind=box", "fence.north_m=[-2, 2]", "fence.east_m=[-2, 2]", "fence.height_m=2.5")
LENIENT = ("gate.jump_m=1.0", "gate.rate_deg_s=5000")


@pytest.mark.parametrize(
    ("picture", "overrides", "says"),
    [
        (tipping, LENIENT, "the vehicle tips"),
        (sliding, LENIENT, "the vehicle slides on the floor"),
        (lost, LENIENT, "while the motors spool up"),
        (leaping, LENIENT, "the height jumps"),
        (carried_out, (*FENCE, "gate.jump_m=5.0"), "outside the fence while the motors spool up"),
    ],
)
def test_guards_run_on_the_floor_and_stop_the_motors(
    picture: Picture, overrides: tuple[str, ...], says: str
) -> None:
    flown = spool_up("paper", *overrides, picture=picture)
    assert says in flown.mission.fault
    assert [one.state for one in flown.mission.states][-2:] == ["disarming", "landed"]
    assert flown.highest_m < 0.05


def start_of(
    scenario: str, *overrides: str, seed: int = 0, source: str = "vicon", autopilot: str = "px4"
) -> tuple[TakeoffStart, str]:
    """Take off and fly for a second; also what made it come down early."""
    world, config = prepare(SCENARIOS[scenario], list(overrides), source=source)
    world, config = from_floor(world, config, 2.0)
    start = TakeoffStart()

    async def script(flight: Flight, stage: Stage) -> None:
        start.watch(flight, stage, world)
        while start.begun_s is None or asyncio.get_running_loop().time() < start.begun_s + 1.1:
            await asyncio.sleep(0.01)
        flight.stop("the test is over")

    flown = fly_mission(world, config, seed=seed, script=script, autopilot=autopilot)
    return start, flown.fault


@pytest.mark.tried(1)  # vehicles
@pytest.mark.parametrize("scenario", ["paper", "quad1kg"])
@settings(max_examples=5, deadline=None, derandomize=True)
@given(st.floats(0.85, 1.2), st.floats(0.85, 1.15), st.floats(-0.4, 0.4), st.integers(0, 1000))
def test_law_and_estimator_begin_without_a_step(
    scenario: str, told_mass: float, gain: float, wind_m_s2: float, seed: int
) -> None:
    assume(told_mass * gain > 0.95)  # weaker ones may refuse
    mass = told_mass * SCENARIOS[scenario].world.mass_kg
    air = f"sim.wind_mean=[{wind_m_s2}, 0.3, 0.1]"
    wrong = (f"vehicle.mass_kg={mass}", f"sim.thrust_gain={gain}", air)
    start, fault = start_of(scenario, *wrong, seed=seed)
    assert not fault
    assert start.smooth, start


@pytest.mark.parametrize(("scenario", "lightest_kg"), [("paper", 0.056), ("quad1kg", 0.7)])
def test_the_lightest_vehicle_that_may_fly_begins_without_a_step(
    scenario: str, lightest_kg: float
) -> None:
    start, fault = start_of(scenario, f"sim.mass_kg={lightest_kg}")
    assert not fault
    assert start.smooth, start
    assert max(start.climb) < 0.1, "its hover thrust was measured"


@pytest.mark.parametrize(
    ("scenario", "light_kg", "until_s"), [("paper", 0.06, 5.5), ("quad1kg", 0.75, 5.46)]
)
def test_a_light_vehicle_without_poses_just_off_the_floor_does_not_rise(
    scenario: str, light_kg: float, until_s: float
) -> None:
    """It comes down on the model, which must not take all that it weighs less for ground effect."""

    def lost_off_the_floor(ours: TrackedBody, at_s: float) -> TrackedBody | None:
        return ours if at_s < until_s else None

    flown = spool_up(scenario, f"sim.mass_kg={light_kg}", picture=lost_off_the_floor)
    assert [one.state for one in flown.mission.states][-2:] == ["descent", "aborted"]
    assert flown.highest_m < 0.3
    assert flown.fastest_m_s < 1.0


def put_down(ours: TrackedBody, at_s: float) -> TrackedBody:
    x, y, z = ours.position_ned
    return ours._replace(position_ned=(x, y, z - 0.5 * max(1.0 - at_s, 0.0)))


def test_a_vehicle_that_somebody_has_put_down_seconds_ago_takes_off() -> None:
    """Its poses until then are no measure of how they wander at rest."""
    flown = spool_up("paper", picture=put_down)
    assert [one.state for one in flown.mission.states][-2:] == ["hold", "aborted"]


OWN = ("sim.own_estimate=true",)


def gust_in_hover(scenario: str, wind_m_s2: float) -> tuple[float, float]:
    """Largest lean [deg] and largest way [m] of the same vehicle in hover, in that wind."""
    step = (f"sim.wind_step=[{wind_m_s2}, 0, 0]", "sim.wind_step_time_s=5")
    told = ["sim.wind_mean=[0, 0, 0]", *step]
    world, config = prepare(SCENARIOS[scenario], [*told, "trajectory.kind=hold"])
    leans = [0.0]

    def look(tick: Tick) -> None:
        if tick.flight_time_s > 5.0:
            leans.append(so3.angle_deg(so3.third_column(tick.estimate.motion.attitude)[2]))

    flown = fly(world, config, seed=0, duration_s=7.0, watch=ticks_to(look))
    assert flown.completed
    moved = flown.track.errors(config.trajectory.build(), 0.0, since_s=flown.track.times[0] + 5.0)
    return max(leans), max(moved)


@pytest.mark.tried(1)  # the strongest
@pytest.mark.parametrize(("wind_m_s2", "aside_m"), [(4.0, 0.60), (2.0, 0.20), (1.0, 0.10)])
def test_a_take_off_in_wind_is_no_rougher_than_a_gust_in_hover(
    wind_m_s2: float, aside_m: float
) -> None:
    """At lift-off the wind sets in and meets a vehicle that no law flies for 0.2 s yet."""
    leans_deg, moved_m = gust_in_hover("quad1kg", wind_m_s2)
    calm, _ = start_of("quad1kg", "sim.wind_mean=[0, 0, 0]")
    start, fault = start_of("quad1kg", f"sim.wind_mean=[{wind_m_s2}, 0, 0]")
    assert not fault
    assert max(start.tilt_deg) <= 1.05 * leans_deg
    assert max(start.off_m) <= 1.3 * (max(calm.off_m) + moved_m)  # 1.0 below 4 m/s², there 1.28
    assert max(start.aside_m) <= aside_m
    assert 0.75 <= min(start.thrust) <= max(start.thrust) <= 1.25
    assert max(start.climb) < 0.3
    assert max(start.b) < 0.5


def test_in_calm_air_a_larger_bound_of_adaptation_changes_no_take_off() -> None:
    still = ("sim.wind_mean=[0, 0, 0]", *OWN, "sim.floor_hold_s=0.6")
    wide, narrow = (
        start_of("quad1kg", *still, *bound, source="odometry", autopilot="ardupilot")[0]
        for bound in ((), ("controller.b_bound=5.001",))
    )
    assert wide.b != narrow.b
    assert wide.thrust == narrow.thrust
    assert wide.climb == narrow.climb
    assert wide.tilt_deg == narrow.tilt_deg


def test_where_wind_blows_a_vehicle_along_the_floor_it_does_not_take_off() -> None:
    _, fault = start_of("quad1kg", "sim.wind_mean=[7.5, 0, 0]")
    assert "the vehicle slides on the floor" in fault


WANDERS = (*OWN, "sim.estimate_wander_m=0.05")
STEPS = "sim.estimate_yaw_step_deg=19"
LATE = (*OWN, "sim.floor_hold_s=0.6")
"""ArduPilot's simulated floor lets go late."""


@pytest.mark.tried(3)  # seeds, of either autopilot
@pytest.mark.parametrize(
    ("told", "autopilot", "seed"),
    [
        *(((*WANDERS, STEPS), "px4", seed) for seed in range(5)),
        *((LATE, "ardupilot", seed) for seed in range(3)),
    ],
)
def test_neither_a_wandering_estimate_nor_a_late_floor_disturbs_a_take_off(
    told: tuple[str, ...], autopilot: str, seed: int
) -> None:
    start, fault = start_of("quad1kg", *told, seed=seed, source="odometry", autopilot=autopilot)
    assert not fault
    assert start.smooth, start
