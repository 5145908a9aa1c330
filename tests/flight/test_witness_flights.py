"""The second witness in whole flights: true poses in bad air, and a tracker that lies."""

import asyncio
import math
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import pytest

from groundstation.core.geometry import Quat, so3
from groundstation.core.messages import tell_lines
from groundstation.core.mission import IN_AIR, State
from groundstation.flight import Flight
from sim.runs import MissionResult, Stage
from sim.trackers import TrackedBody
from tests.flight.flights import mission
from tests.known import known
from tests.proving.faults import Meddler, stand_between

LOOK_S = 0.01
SEEN_LEAN_DEG = 3.0
IN_S = 0.45
"""So soon after the vehicle leans or turns it must doubt."""

Lie = Callable[[Quat], Quat]
Begin = Callable[[Quat], Lie]


@dataclass
class Told:
    """What came of a flight."""

    mission: MissionResult | None = None
    share: float = 0.0
    """The largest statistic, as a share of its threshold."""
    silent_s: float = 0.0
    """For how long the witness said nothing in the air."""
    struck_s: float = math.inf
    leans_s: float = math.inf
    """When the vehicle first leant by more than 3° after that, by the truth [s]."""
    doubted_s: float = math.inf
    events: list[str] = field(default_factory=list)


def flown(
    scenario: str,
    *,
    seed: int = 0,
    autopilot: str = "px4",
    lie: Begin | None = None,
    state: State | None = State.HOLD,
    after_s: float = 1.5,
    sets: tuple[str, ...] = (),
    link: str = "mavlink",
) -> Told:
    """A mission whose poses lie from ``after_s`` into ``state`` on [s]."""
    told = Told()

    async def script(flight: Flight, stage: Stage) -> None:
        loop = asyncio.get_running_loop()
        meddler = known(stand_between(stage))
        striking = asyncio.ensure_future(strike(flight, meddler)) if lie is not None else None
        while True:
            now = loop.time()
            evidence = flight._controller.witness.verdict(now)
            if evidence is None:
                told.silent_s += LOOK_S if flight.state in IN_AIR else 0.0
            else:
                told.share = max(told.share, evidence.alarm)
                if evidence.disagrees_since_s is not None:
                    told.doubted_s = min(told.doubted_s, now)
            upright = so3.third_column(stage.plant.truth(now).attitude)[2]
            if now > told.struck_s and upright < math.cos(math.radians(SEEN_LEAN_DEG)):
                told.leans_s = min(told.leans_s, now)
            if striking is not None and striking.done():
                striking.result()
            await asyncio.sleep(LOOK_S)

    async def strike(flight: Flight, meddler: Meddler) -> None:
        while state is not None and flight.state is not state:
            await asyncio.sleep(LOOK_S)
        await asyncio.sleep(after_s)
        assert lie is not None and meddler.shown is not None
        told.struck_s, lies = asyncio.get_running_loop().time(), lie(meddler.shown.attitude)

        def show(_: float, bodies: Sequence[TrackedBody]) -> Sequence[TrackedBody]:
            return [bodies[0]._replace(attitude=lies(bodies[0].attitude)), *bodies[1:]]

        meddler.picture = show

    told.mission = mission(
        scenario, *sets, figure_s=10.0, seed=seed, link=link, autopilot=autopilot, script=script,
        watch=tell_lines(told.events.append),
    )  # fmt: skip
    return told


@pytest.mark.tried(1)  # the worst air
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize("scenario", ["storm", "adverse", "gust_front", "quad1kg"])
def test_true_poses_are_not_doubted_in_any_air(scenario: str, autopilot: str) -> None:
    told = flown(scenario, seed=7, autopilot=autopilot)
    assert known(told.mission).landed
    assert told.share < 0.9
    assert told.silent_s < 0.5
    doubts = ("second witness", "disagrees with the autopilot's own")
    assert not any(doubt in line for line in told.events for doubt in doubts)


def frozen(held: Quat) -> Lie:
    rng = random.Random(1)
    return lambda _: so3.rotate(
        held, (rng.gauss(0.0, 1e-3), rng.gauss(0.0, 1e-3), rng.gauss(0.0, 1e-3))
    )


def mirrored(roll: float, pitch: float) -> Begin:
    def begin(_: Quat) -> Lie:
        def lie(attitude: Quat) -> Quat:
            a, b, c = so3.euler_zyx(attitude)
            return so3.from_euler_zyx(roll * a, pitch * b, c)

        return lie

    return begin


def body_turned(roll_deg: float, yaw_deg: float) -> Begin:
    by = so3.from_euler_zyx(math.radians(roll_deg), 0.0, math.radians(yaw_deg))
    return lambda _: lambda attitude: so3.multiply(attitude, by)


@pytest.mark.tried(2)  # lies, in either air
@pytest.mark.parametrize("scenario", ["paper", "storm"])
@pytest.mark.parametrize(
    "lie", [frozen, mirrored(-1.0, 1.0), mirrored(1.0, -1.0)], ids=["frozen", "roll", "pitch"]
)
def test_attitudes_that_begin_to_lie_in_flight_are_doubted_once_it_leans(
    scenario: str, lie: Begin
) -> None:
    told = flown(scenario, lie=lie)
    # In a storm it leans all the time: what was frozen comes out by how it turns.
    in_s = IN_S if scenario == "paper" else 2.0 * IN_S
    assert told.struck_s < told.doubted_s < max(told.struck_s, told.leans_s) + in_s + LOOK_S


TOLD_BY_RADIO = ("sim.telemetry_hz=10",)
"""As Betaflight tells its attitude over CRSF."""


@pytest.mark.tried(1)  # lies
@pytest.mark.parametrize(
    ("lie", "seed"),
    [(frozen, 1), (mirrored(-1.0, 1.0), 1), (mirrored(1.0, -1.0), 0)],
    ids=["frozen", "roll", "pitch"],
)
def test_attitudes_of_poses_that_lie_are_told_by_the_attitude_over_crsf(
    lie: Begin, seed: int
) -> None:
    told, alone = (
        flown("paper", seed=seed, lie=lie, link="crsf", sets=sets) for sets in (TOLD_BY_RADIO, ())
    )
    # Ten times a second are slower than MAVLink's fifty, and of the turning only the slow window
    # counts.
    assert told.struck_s < told.doubted_s < max(told.struck_s, told.leans_s) + 1.5 * IN_S
    assert alone.share == 0.0 and alone.doubted_s == math.inf
    assert told.mission is not None and alone.mission is not None
    assert told.mission.states[-1].state == alone.mission.states[-1].state == State.ABORTED


def test_a_radio_that_contradicts_poses_and_model_convicts_nobody() -> None:
    """Pitch that is told to count the wrong way."""
    told = flown("paper", link="crsf", sets=(*TOLD_BY_RADIO, "link.attitude_pitch=nose_up"))
    assert told.share > 2.0
    assert told.doubted_s < math.inf
    assert known(told.mission).landed


@pytest.mark.tried(1)  # links
@pytest.mark.parametrize(("link", "sets"), [("mavlink", ()), ("crsf", TOLD_BY_RADIO)])
def test_a_tilt_that_is_askew_in_flight_is_told_and_ends_nothing(
    link: str, sets: tuple[str, ...]
) -> None:
    """A tracked body knocked by 9°: the law flies on, the model finds no more than wind in it."""
    told = flown("paper", lie=body_turned(9.0, 0.0), link=link, sets=sets)
    assert known(told.mission).landed
    assert sum("disagrees with the autopilot's own" in line for line in told.events) <= 1


@pytest.mark.tried(2)  # lies, by either autopilot
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize(
    "lie",
    [body_turned(0.0, 90.0), body_turned(0.0, 180.0), mirrored(-1.0, 1.0), mirrored(1.0, -1.0)],
    ids=["yaw 90°", "yaw 180°", "roll", "pitch"],
)
def test_axes_that_were_never_right_are_doubted_as_soon_as_it_leans(
    lie: Begin, autopilot: str
) -> None:
    told = flown("paper", lie=lie, state=None, after_s=0.1, autopilot=autopilot)
    assert told.doubted_s < told.leans_s + 1.5 * IN_S
