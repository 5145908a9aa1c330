"""From arming to lift-off nobody is trusted: what a vehicle does whose poses or whose mass are not its own."""

import asyncio
from collections.abc import Callable, Sequence

import pytest

from groundstation import so3
from groundstation.flight import Flight
from groundstation.mission import State
from groundstation.ops import Vec3
from sim.mission import Mission, Script, fly_mission, from_floor
from sim.prepare import prepare
from sim.scenarios import SCENARIOS
from sim.stage import Stage
from sim.trackers import Seen, Tracker

LIMITS_M, LIMITS_M_S = 0.8, 3.0

Picture = Callable[[Seen, float], Seen | None]
"""What is made of our body in the picture of an instant [s]; None: no frame leaves."""


class Meddled:
    """A tracking computer that sends what ``picture`` makes of our body."""

    def __init__(self, tracker: Tracker, picture: Picture) -> None:
        self._tracker = tracker
        self._picture = picture

    async def open(self) -> None:
        await self._tracker.open()

    def send(self, frame: int, exposure_s: float, bodies: Sequence[Seen]) -> None:
        ours = self._picture(bodies[0], exposure_s)
        if ours is not None:
            self._tracker.send(frame, exposure_s, [ours, *bodies[1:]])

    def close(self) -> None:
        self._tracker.close()


class Flown:
    """How high and how fast it was, by the truth, and what ended it."""

    def __init__(self, mission: Mission, highest_m: float, fastest_m_s: float, most_n: float, after_s: float) -> None:
        self.mission = mission
        self.highest_m, self.fastest_m_s = highest_m, fastest_m_s
        self.most_n = most_n
        """Largest thrust told [N]."""
        self.after_s = after_s
        """How long the motors were told 0.9 of the weight or more [s]."""


def spool_up(
    scenario: str, *overrides: str, picture: Picture | None = None, begins: State = State.IDLE, seed: int = 0,
    link: str = "mavlink", more: Script | None = None, seconds: float = 12.0,
) -> Flown:  # fmt: skip
    """A flight from the floor, its picture meddled with from when ``begins`` does."""
    world, config = prepare(SCENARIOS[scenario], list(overrides), link=link)
    world, config = from_floor(world, config, 2.0)
    seen = {"high": 0.0, "fast": 0.0, "most": 0.0, "near": 0.0, "told": 0.0}

    async def script(flight: Flight, stage: Stage) -> None:
        beside = asyncio.ensure_future(more(flight, stage)) if more is not None else None
        assert stage.mocap is not None

        def meddle(ours: Seen, at_s: float) -> Seen | None:
            assert picture is not None
            return picture(ours, at_s) if flight.state not in _before(begins) else ours

        if picture is not None:
            stage.mocap.through(lambda tracker: Meddled(tracker, meddle))
        tell = stage.plant.command

        def told(time_s: float, thrust_n: float, rates: Vec3) -> None:
            seen["most"], seen["told"] = max(seen["most"], thrust_n), thrust_n
            tell(time_s, thrust_n, rates)

        stage.plant.command = told  # type: ignore[method-assign]
        loop = asyncio.get_running_loop()
        end, weight = loop.time() + seconds, config.weight_n
        while loop.time() < end and flight.state is not State.HOLD:
            truth = stage.plant.truth(loop.time())
            seen["high"] = max(seen["high"], world.floor_z_m - truth.position_ned[2])
            seen["fast"] = max(seen["fast"], *(abs(v) for v in truth.velocity_ned))
            seen["near"] += 0.001 * (seen["told"] > 0.9 * weight)
            await asyncio.sleep(0.001)
        flight.stop("the test is over")
        if beside is not None:
            beside.cancel()

    mission = fly_mission(world, config, seed=seed, script=script)
    return Flown(mission, seen["high"], seen["fast"], seen["most"], seen["near"])


def _before(state: State) -> list[State]:
    order = [State.IDLE, State.CONNECTING, State.READY, State.ARMING, State.TAKEOFF]
    return order[: order.index(state)]


def resting(ours: Seen, _: float) -> Seen:
    """Another body, which rests on the floor two metres aside."""
    return ours._replace(position_ned=(1.2, 1.2, 1.0 + 1e-4 * hash(ours.position_ned) / 2**63), attitude=so3.IDENTITY)


@pytest.mark.parametrize("link", ["mavlink", "dsm"])
@pytest.mark.parametrize("scenario", ["paper", "quad1kg"])
@pytest.mark.parametrize(
    "wrong",
    [(), ("sim.thrust_gain=1.25",), ("mass",)],
    ids=["as told", "stronger by 25 %", "told 25 % too heavy"],
)
def test_the_poses_of_another_body_that_rests_let_nothing_fly_away(
    scenario: str, link: str, wrong: tuple[str, ...]
) -> None:
    mass = SCENARIOS[scenario].told.mass_kg
    overrides = (f"vehicle.mass_kg={1.25 * mass}",) if wrong == ("mass",) else wrong
    flown = spool_up(scenario, *overrides, "gate.drop_frozen=false", picture=resting, link=link)
    assert "is this the right body, is the mass right?" in flown.mission.fault
    assert flown.highest_m < LIMITS_M
    assert flown.fastest_m_s < LIMITS_M_S
    assert flown.after_s <= 0.33
    assert [one.state for one in flown.mission.states][-2:] == ["disarming", "landed"]


def test_thrust_is_never_told_above_1_3_of_the_told_weight_before_lift_off() -> None:
    flown = spool_up("paper", "gate.drop_frozen=false", picture=resting)
    assert flown.most_n <= 1.301 * 0.080 * 9.81
    assert flown.most_n >= 1.25 * 0.080 * 9.81
