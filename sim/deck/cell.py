"""One fault in one state of one mission, in virtual time: the whole application against the simulated side."""

import asyncio
import math

from groundstation.app import make_flight
from groundstation.clock import sleep_until
from groundstation.flight import Flight
from groundstation.mission import State
from groundstation.ops import Vec3
from groundstation.pilot import Tick
from groundstation.recorded import Give
from groundstation.recording.records import Record
from groundstation.requests import Ask, Request
from groundstation.settings import Config
from sim.deck.faults import FAULTS, Fault, Scene
from sim.deck.meddler import Meddler
from sim.deck.moments import DESCENT_AFTER_S, MOMENTS, Moment, Moves
from sim.deck.truth import Truth
from sim.deck.verdict import Row, judged
from sim.deck.wire import Wire
from sim.mission import from_floor
from sim.prepare import prepare
from sim.scenarios import SCENARIOS
from sim.stage import Stage
from sim.trackers import Tracker
from sim.virtual_time import VirtualTimeLoop
from sim.world import World

LANDS = ("sim.own_estimate=true",)
"""The autopilot of the deck knows where it is, so it is asked to land where we can't see it."""
AUTOPILOT = {"COM_OF_LOSS_T": 0.3}
"""How long it holds the last set-point when they stop [s]; its default is 1 s, docs/how-to/px4.md asks for 0.2 to 1."""
CONFIRM_S = 3.0
"""When arming is confirmed, in virtual time [s]."""
FIGURE_S = 5.0
"""How long the figure is flown where nothing ends it early [s]."""
LOOK_S = 0.005
"""How often it is looked whether the moment has come [s]."""
LIMIT_S = 60.0
"""A flight that goes on for longer after a fault than this does not end [s]."""
REST_LIMIT_S = 12.0
"""How long after a flight's end the vehicle may take to come to rest [s]."""
STILL_SHARE = 0.05
"""Motors that give less than this share of the weight are off [-]."""
BLIND_S = 0.2
"""Beside the limits that are told: age of the last true pose, and rounding [s]."""
HEARTBEAT_S = 1.1
"""An autopilot tells of its mode once a second."""


class NotReached(Exception):
    """The flight ended before the state in which it was to be struck; the text says why."""


def fly_cell(fault: str, state: str, *, seed: int = 0, scenario: str = "paper", overrides: tuple[str, ...] = ()) -> Row:
    """Fly one cell in virtual time."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(fly_here(fault, FAULTS[fault], state, seed=seed, scenario=scenario, overrides=overrides))


class _Broken(Exception):
    """What the controller dies of."""


async def fly_here(
    name: str,
    fault: Fault,
    state: str,
    *,
    seed: int,
    scenario: str,
    overrides: tuple[str, ...] = (),
    figure_s: float = FIGURE_S,
    keep: Give | None = None,
) -> Row:
    """Fly one cell on the running loop of virtual time, whatever its time is; ``keep`` takes what is recorded."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop), "in virtual time only"
    begun_s = loop.time()
    asked = [*(LANDS if fault.link == "mavlink" else ()), *fault.overrides, *overrides]
    world, config = prepare(SCENARIOS[scenario], asked, source=fault.source, link=fault.link)
    world, config = from_floor(world, config, figure_s)
    wire = Wire(config)
    loop.tap = wire.tap
    truth, moves, meddlers = Truth(world.floor_z_m), Moves(loop.time), list[Meddler]()

    def meddle(tracker: Tracker) -> Tracker:
        meddlers.append(Meddler(tracker))
        return meddlers[0]

    def step(time_s: float, position: Vec3) -> None:
        truth.step(time_s, position)

    def watch(tick: Tick) -> None:
        follows = moves.state not in (State.DESCENT, State.ABORTED, State.DISARMING)
        truth.tick(tick, follows=follows)
        if scene.controller_raises:
            raise _Broken("the controller broke")

    def give(record: Record) -> None:
        wire.record(record)
        if keep is not None:
            keep(record)
        if scene.recorder_raises:
            raise OSError("the recorder is gone")

    async def confirm() -> bool:
        await sleep_until(begun_s + CONFIRM_S)
        return True

    stage = Stage(world, config, seed, step, parameters=AUTOPILOT)
    truth.plant = stage.plant
    stage.plant.advance(begun_s)
    assert stage.mocap is not None, "the deck flies with cameras"
    stage.mocap.through(meddle)
    flight = make_flight(config, confirm=confirm, on_tick=watch, on_state=moves.entered, wires=stage.wires, give=give)
    scene = Scene(flight, stage, meddlers[0])
    turning, flying = asyncio.ensure_future(stage.run()), asyncio.ensure_future(flight.run())
    striking = asyncio.ensure_future(_strike(scene, fault, state, moves, truth, world))
    await asyncio.wait({turning, flying, striking}, return_when=asyncio.FIRST_COMPLETED)
    if not striking.done():
        turning.cancel(), flying.cancel(), striking.cancel()
        await asyncio.gather(turning, flying, striking, return_exceptions=True)
        raise NotReached(f"the flight ended before {state}: {moves.state}: {moves.reason}")
    struck_s, where = striking.result()
    going_on = asyncio.ensure_future(_break(scene, fault))
    acted = asyncio.ensure_future(_autopilot_acts(stage, fault))
    await asyncio.wait({turning, flying}, timeout=LIMIT_S + figure_s, return_when=asyncio.FIRST_COMPLETED)
    ended = flying.done()
    rest_s = await _rest(stage, world) if ended else None
    tasks = (turning, flying, going_on, acted)
    for task in tasks:
        task.cancel()
    for result in await asyncio.gather(*tasks, return_exceptions=True):
        if isinstance(result, Exception) and not isinstance(result, _Broken):
            raise result
    loop.tap = None
    end = stage.plant.truth(loop.time()).position_ned
    acts_s = acted.result() if not acted.cancelled() else None
    answers = [(time_s, str(after), reason) for time_s, after, reason in moves.answers]
    if acts_s is not None:
        answers.append((acts_s, "autopilot lands", "set-points stopped: the autopilot's own failsafe"))
    answers.sort()
    restless = "" if ended and rest_s is not None else "it does not end" if not ended else "it does not come to rest"
    return judged(
        name, fault, state, truth, answers,
        wrong=restless or _left_wrongly(fault, state, config, wire, struck_s),
        robs=fault.robs or _too_weak(stage, world),
        drift_m=math.dist(where[:2], end[:2]),
        touchdown_m_s=stage.plant.hardest_m_s,
    )  # fmt: skip


async def _strike(
    scene: Scene, fault: Fault, name: str, moves: Moves, truth: Truth, world: World
) -> tuple[float, Vec3]:
    """Wait for the moment; when and where it is."""
    await reached(MOMENTS[name], scene.flight, scene.stage, moves, world)
    now = asyncio.get_running_loop().time()
    moves.struck, truth.struck_s = True, now
    return now, scene.stage.plant.truth(now).position_ned


async def reached(moment: Moment, flight: Flight, stage: Stage, moves: Moves, world: World) -> None:
    """Return at ``moment``; a failsafe descent is asked for, as no flight comes to it by itself."""
    loop = asyncio.get_running_loop()
    while True:
        if moves.state is State.TRACKING and flight.started_s is not None:
            moves.since_s = flight.started_s  # the figure, not the way onto it
        if moment.state is State.DESCENT and moves.lasted(State.TRACKING, DESCENT_AFTER_S):
            flight.ask(Request(Ask.DESCEND, "the deck"))
        height_m = world.floor_z_m - stage.plant.truth(loop.time()).position_ned[2]
        if moment.is_now(moves, height_m):
            return
        await asyncio.sleep(LOOK_S)


async def _break(scene: Scene, fault: Fault) -> None:
    assert fault.strike is not None, "this one needs processes of its own"
    await fault.strike(scene)


async def _autopilot_acts(stage: Stage, fault: Fault) -> float:
    """When the autopilot begins to act by itself [s]."""
    while True:
        if fault.link == "mavlink" and stage.autopilot.failsafe:
            return asyncio.get_running_loop().time()
        await asyncio.sleep(2.0 * LOOK_S)


async def _rest(stage: Stage, world: World) -> float | None:
    """How long until it stands with its motors off [s]; None where it does not."""
    loop = asyncio.get_running_loop()
    begun = loop.time()
    while loop.time() < begun + REST_LIMIT_S:
        now = stage.plant.truth(loop.time())
        stands = now.on_ground or stage.plant.released_s is None
        if stands and now.thrust_n < STILL_SHARE * world.mass_kg * world.gravity:
            return loop.time() - begun
        await asyncio.sleep(0.05)
    return None


def _too_weak(stage: Stage, world: World) -> str:
    """Why nobody could land it softly, where its rotors at their fullest can't hold it against weight and wind."""
    most_n = stage.plant.most_n(asyncio.get_running_loop().time())
    needs_n = world.mass_kg * (world.gravity + world.wind_mean[2])
    return (
        "" if most_n > needs_n else f"its rotors give {most_n:.2f} N at most, weight and wind pull with {needs_n:.2f} N"
    )


def _left_wrongly(fault: Fault, state: str, config: Config, wire: Wire, struck_s: float) -> str:
    """What must not have left; empty where there is nothing."""
    if wire.wrong:
        return wire.wrong
    most = config.flight.coast_s + config.guards.level_s + 2.0 + BLIND_S
    if fault.blinds and wire.last_lift_s > struck_s + most:
        return f"a command that lifts left {wire.last_lift_s - struck_s:.2f} s after the last true pose"
    if fault.silences and wire.last_s > struck_s + HEARTBEAT_S and MOMENTS[state].flying:
        return f"something left {wire.last_s - struck_s:.2f} s after a pilot had taken over"
    return ""
