"""One fault in one state of one mission, in virtual time: the whole application against the
simulated side.

Up to the instant at which it is struck, a flight of virtual time is the same for all faults that it
is set up alike for: the wait for poses, the take-off, the way onto the figure. So it is flown once,
and each fault strikes a copy of the process that has flown it; the rows are those of flights of
their own. Whoever is copied has no other thread.
"""

import asyncio
import math
import os
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import msgspec
from msgspec.structs import replace

from groundstation.core.geometry import Vec3
from groundstation.core.messages import Ask, CommandSent, FlightEvent, Notice, Request, Waypoint
from groundstation.core.mission import State
from groundstation.flight import Flight, Give, make_flight
from groundstation.recording import Record
from groundstation.settings import Config
from links.core import thrust as thrust_of
from sim.autopilots import Px4Autopilot
from sim.radio import FAILSAFE_S
from sim.runs import MISSION_CONFIRM_S, Stage, confirm_at, from_floor
from sim.scenarios import SCENARIOS, prepare
from sim.time import VirtualTimeLoop
from sim.world import World, generator
from tests.proving.faults.fault import (
    MOMENTS,
    Exemption,
    Fault,
    Kind,
    Moment,
    Moves,
    Poses,
    Scene,
    stand_between,
)
from tests.proving.faults.faults import CASES, find_fault
from tests.proving.faults.judge import JUDGED_S, Row, Thrust, Truth, WireJudge, exemption_of, judge
from tests.proving.faults.monitors import UNGUARDED, DeckMonitors

LANDS = ("sim.own_estimate=true",)
"""The autopilot of the deck knows where it is, so it is asked to land where we can't see it."""
AUTOPILOT = {"COM_OF_LOSS_T": 0.3}
"""Time for which PX4 holds the last set-point [s]; its default is 1 s, docs/how-to/px4.md asks for
0.2 to 1."""
FIGURE_S = 5.0
"""Duration of the figure where nothing ends it early [s]."""
NEAR = ("trajectory.centre_ned=[0.093,-1.507,0]",)
"""The figure begins 1 m above the place at which the scenario's vehicle holds after its take-off: a
short way."""
DESCENT_AFTER_S = 1.0
"""The failsafe descent is asked for after so long on the figure [s]."""
MOVES_AFTER_S = 0.5
"""A point is asked for after so long in the first hold, and the way back after so long in the next
one [s]."""
MOVES_BY = (0.9, 0.6, -0.3)
"""Where that point is from where it holds [m, NED]."""
LOOK_S = 0.005
"""Period at which the moment of the strike is looked for [s]."""
HONEST_FIGURE_S = 9.0
"""Time that the figure is flown in an honest flight: longer than it is looked at [s]."""
HONEST_S = 7.0
"""Time that an honest flight is looked at after the strike [s]."""
HONEST_MORE_S = 8.0
"""Time more for one that ends early, so that it comes down [s]."""
FORCED_WITHIN_S = 3.0
"""A forced doubt begins at a drawn moment within this time after the strike [s]."""
LIMIT_S = 60.0
"""A flight that goes on for longer after a fault than this does not end [s]."""
REST_LIMIT_S = 12.0
"""Time after a flight's end in which the vehicle must come to rest [s]."""
STILL_SHARE = 0.05
"""Motors that give less than this share of the weight are off [-]."""
BLIND_S = 0.2
"""Beside the limits that are told: age of the last true pose, and rounding [s]."""
HEARTBEAT_S = 1.1
"""An autopilot tells of its mode once a second."""


class NotReached(Exception):
    """The flight ended before the state in which it was to be struck; the text says why."""


class FlightCopy(NamedTuple):
    """One of the flights that go on from the same instant."""

    case: str
    watch: str = ""
    """Monitor that it goes on with, as :meth:`monitors.DeckMonitors.go_on` has it."""


def fly_cell(
    case: str,
    state: str,
    *,
    link: str = "",
    seed: int = 0,
    scenario: str = "paper",
    overrides: tuple[str, ...] = (),
    split: Callable[[], FlightCopy] | None = None,
) -> Row:
    """Fly one cell in virtual time; ``split`` tells at the strike which copy it is."""
    fault = find_fault(case, state, link or CASES[case].link)
    if not any(override.startswith("trajectory.") for override in overrides):
        overrides = (*NEAR, *overrides)
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        flight = fly_here(
            case, fault, state, seed=seed, scenario=scenario, overrides=overrides, split=split
        )
        try:
            return runner.run(flight)
        except NotReached as error:
            return not_struck(case, fault, state, str(error), scenario)


def not_struck(case: str, fault: Fault, state: str, why: str, scenario: str = "paper") -> Row:
    """Return the row of a flight that never came to its strike."""
    return judge(case, fault, state, Truth(0.0), [], wrong=why, scenario=scenario)


class _Broken(Exception):
    """Failure of the controller."""


async def fly_here(
    name: str,
    fault: Fault,
    state: str,
    *,
    seed: int,
    scenario: str,
    overrides: tuple[str, ...] = (),
    keep: Give | None = None,
    split: Callable[[], FlightCopy] | None = None,
) -> Row:
    """Fly one cell on the running loop of virtual time, whatever its time is.

    ``keep`` takes what is recorded.

    ``split`` tells at the strike which copy it is, of a case that is set up as ``fault`` is.

    Raises:
        NotReached: the flight ended before the state in which it was to be struck.
    """
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop), "in virtual time only"
    begun_s = loop.time()
    asked = [*(LANDS if fault.link == "mavlink" else ()), *fault.overrides, *overrides]
    world, config = prepare(SCENARIOS[scenario], asked, source=fault.source, link=fault.link)
    figure_s = HONEST_FIGURE_S if fault.kind is Kind.HONEST else FIGURE_S
    world, config = from_floor(world, config, figure_s)
    blind, aborted_m = False, math.inf

    def newtons(time_s: float, signal: float) -> float:
        return thrust_of(signal, world.thrust_curve) * stage.plant.most_n(time_s)

    pushing = Thrust(
        hover_n(world),
        newtons,
        AUTOPILOT["COM_OF_LOSS_T"] if fault.link == "mavlink" else FAILSAFE_S,
    )
    wire = WireJudge(config, pushing)
    loop.tap = wire.tap
    truth, moves = Truth(world.floor_z_m), Moves(loop.time)

    def watch(event: FlightEvent) -> None:
        if isinstance(event, Notice) and event.kind == "state":
            moves.enter(State(event.state), event.text)
            if moves.answers and event.state == State.ABORTED:
                nonlocal aborted_m
                aborted_m = min(aborted_m, height_m())
            if moves.answers and is_open_loop(moves.state):
                note_open_loop(loop.time())
            if moves.answers and pushing.decided_s == math.inf:
                pushing.decided_s = loop.time()
                pushing.decided_height_m = height_m()
        if not isinstance(event, CommandSent):
            return
        # What false poses led to is no course any more: it may run away with them.
        nonlocal blind
        pilot = flight._pilot
        blind = blind or (
            moves.struck and pilot.state.is_blind and not pilot.state.health.has_failed
        )
        misled = fault.poses is not Poses.TRUE and bool(moves.answers)
        ended = moves.state in (State.DESCENT, State.ABORTED, State.DISARMING)
        if not misled and not ended:
            tick = event.tick
            reference = tick.reference
            truth.refer(
                tick.time_s, reference.position_ned, reference.velocity_ned, tick.estimate.time_s
            )
        if scene.controller_raises:
            raise _Broken("the controller broke")

    def give(record: Record) -> None:
        wire.record(record)
        if keep is not None:
            keep(record)
        if scene.recorder_raises:
            raise OSError("the recorder is gone")

    def height_m() -> float:
        return world.floor_z_m - stage.plant.truth(loop.time()).position_ned[2]

    def note_open_loop(time_s: float) -> None:
        pushing.answered_s = min(pushing.answered_s, time_s + world.frame_period_s)

    def is_open_loop(state: State) -> bool:
        """Whether commands in ``state`` follow no pose: without poses a failsafe descent follows
        none, too.
        """
        return state is State.ABORTED or (state is State.DESCENT and fault.poses is Poses.GONE)

    stage = Stage(world, config, seed, truth.step, parameters=AUTOPILOT)
    truth.plant = stage.plant
    stage.plant.advance(begun_s)
    meddler = stand_between(stage)
    monitors = DeckMonitors()
    flight = make_flight(
        config,
        confirm=confirm_at(begun_s + MISSION_CONFIRM_S),
        subscribers=(watch,),
        wires=stage.wires,
        give=give,
        monitors=monitors.factories(),
    )
    scene = Scene(flight, stage, meddler, seed)
    turning, flying = asyncio.ensure_future(stage.run()), asyncio.ensure_future(flight.run())
    striking = asyncio.ensure_future(_reach(MOMENTS[state], scene, moves, truth))
    await asyncio.wait({turning, flying, striking}, return_when=asyncio.FIRST_COMPLETED)
    if not striking.done():
        turning.cancel(), flying.cancel(), striking.cancel()
        await asyncio.gather(turning, flying, striking, return_exceptions=True)
        raise NotReached(f"the flight ended before {state}: {moves.state}: {moves.reason}")
    struck_s, where = striking.result()
    watch_as = ""
    if split is not None:
        name, watch_as = split()
        fault = find_fault(name, state, fault.link)
    forced_s = generator(seed, f"doubt {name}").random() * FORCED_WITHIN_S
    monitors.go_on(flight._pilot, watch_as, struck_s + float(forced_s))
    exemption = exemption_of(fault, state)
    autopilot = _Autopilot(note_open_loop)
    tasks: list[asyncio.Future[Any]] = [turning, flying]
    tasks += map(asyncio.ensure_future, (fault.strike(scene), autopilot.watch(stage)))
    if state == "moving":
        tasks.append(asyncio.ensure_future(_return(flight, moves)))
    over: asyncio.Future[None] = loop.create_future()
    if fault.kind is Kind.HONEST:
        over = asyncio.ensure_future(_see_honest(stage, moves))
    elif exemption is Exemption.NOT_OBSERVABLE:
        over = asyncio.ensure_future(_fly_on(stage, JUDGED_S))
    ends: set[asyncio.Future[Any]] = {turning, flying, over}
    await asyncio.wait(ends, timeout=LIMIT_S + figure_s, return_when=asyncio.FIRST_COMPLETED)
    rests = flying.done() and await _rests(stage, world, over)
    ended, rests = flying.done() or over.done(), rests or over.done()
    # How a flight is ended that is cut short is no part of it.
    truth.end()
    pushing.end(loop.time())
    answers = [(time_s, str(after), reason) for time_s, after, reason in moves.answers]
    end = stage.plant.truth(loop.time()).position_ned
    wrong = _left_wrongly(fault, state, config, wire, pushing, struck_s)
    for task in (*tasks, over):
        task.cancel()
    for result in await asyncio.gather(*tasks, over, return_exceptions=True):
        if isinstance(result, Exception) and not isinstance(result, _Broken):
            raise result
    loop.tap = None
    if autopilot.acts_s is not None:
        answers.append(
            (
                autopilot.acts_s,
                "autopilot lands",
                "set-points stopped: the autopilot's own failsafe",
            )
        )
    answers.sort()
    restless = "" if rests else "it does not come to rest" if ended else "it does not end"
    too_weak = stage.plant.most_n(loop.time()) <= hover_n(
        world
    )  # its rotors at their fullest can't hold it
    row = judge(
        name, fault, state, truth, answers,
        wrong=restless or wrong,
        exemption=exemption or (Exemption.WEAK if too_weak else Exemption.NONE),
        begun_s=begun_s,
        drift_m=math.dist(where[:2], end[:2]),
        touchdown_m_s=stage.plant.floor.hardest_m_s,
        thrust=pushing,
        land_s=autopilot.land_s,
        failure=flight.failure,
        scenario=scenario,
        blind=blind,
        aborted_m=aborted_m,
    )  # fmt: skip
    return replace(row, seed=seed, forced="" if watch_as == UNGUARDED else watch_as)


async def _reach(moment: Moment, scene: Scene, moves: Moves, truth: Truth) -> tuple[float, Vec3]:
    """Return when and where ``moment`` is, and judge from then on.

    A point to go to, or a failsafe descent, is asked for: no flight comes to it by itself.
    """
    flight, stage = scene.flight, scene.stage
    while True:
        if moves.state is State.TRACKING and flight.started_s is not None:
            moves.since_s = flight.started_s  # the figure, not the way onto it
        if moment.state is State.DESCENT and moves.lasts(State.TRACKING, DESCENT_AFTER_S):
            flight.ask(Request(Ask.DESCEND, "the deck"))
        if moment.state is State.MOVING and moves.lasts(State.HOLD, MOVES_AFTER_S):
            place = stage.plant.truth(scene.now_s).position_ned
            point = Waypoint(*(here + by for here, by in zip(place, MOVES_BY, strict=True)))
            flight.ask(Request(Ask.GOTO, "the deck", (point,)))
        height_m = stage.world.floor_z_m - stage.plant.truth(scene.now_s).position_ned[2]
        if moment.is_now(moves, height_m):
            moves.struck = True
            return scene.now_s, truth.strike(scene.now_s)
        await asyncio.sleep(LOOK_S)


async def _return(flight: Flight, moves: Moves) -> None:
    """Ask for the way back from the point that was asked for, as a flight there holds until
    somebody does.
    """
    while True:
        await asyncio.sleep(LOOK_S)
        if moves.lasts(State.HOLD, MOVES_AFTER_S):
            flight.ask(Request(Ask.RETURN, "the deck"))
            return


async def _see_honest(stage: Stage, moves: Moves) -> None:
    """Return when an honest flight has been seen: one that ends early is seen to its end."""
    await _fly_on(stage, HONEST_S)
    if moves.answers:
        await asyncio.sleep(HONEST_MORE_S)


async def _fly_on(stage: Stage, for_s: float) -> None:
    """Return ``for_s`` [s] from now, or from when it leaves the floor."""
    loop, flown_s = asyncio.get_running_loop(), 0.0
    while flown_s < for_s:
        await asyncio.sleep(LOOK_S)
        flies = stage.plant.released_s is not None and not stage.plant.truth(loop.time()).on_ground
        flown_s += LOOK_S if flies or flown_s else 0.0


class _Autopilot:
    """Reactions of the autopilot beside obeying."""

    def __init__(self, on_act: Callable[[float], None]) -> None:
        """Nothing yet; ``on_act(time_s)`` hears once when it acts by itself."""
        self.acts_s: float | None = None
        """When it began to act by itself [s]."""
        self.land_s: float | None = None
        """When it took over landing, as it was asked to [s]."""
        self._on_act = on_act

    async def watch(self, stage: Stage) -> None:
        """Look until cancelled."""
        loop = asyncio.get_running_loop()
        while stage.radio is None:
            told = stage.autopilot
            assert isinstance(told, Px4Autopilot), "the deck flies with a PX4"
            if self.acts_s is None and told.failsafe:
                self.acts_s = loop.time()
                self._on_act(self.acts_s)
            if (
                self.land_s is None
                and not told.failsafe
                and told.armed
                and told.mode == told.land_mode
            ):
                self.land_s = loop.time()
            await asyncio.sleep(2.0 * LOOK_S)


async def _rests(stage: Stage, world: World, over: "asyncio.Future[None]") -> bool:
    """Whether it comes to stand with its motors off, before all is ``over``."""
    loop = asyncio.get_running_loop()
    begun = loop.time()
    while loop.time() < begun + REST_LIMIT_S and not over.done():
        now = stage.plant.truth(loop.time())
        stands = now.on_ground or stage.plant.released_s is None
        if stands and now.thrust_n < STILL_SHARE * world.mass_kg * world.gravity:
            return True
        await asyncio.sleep(0.05)
    return False


def hover_n(world: World) -> float:
    """The thrust that holds it against weight and wind [N]."""
    north, east, down = world.wind_mean
    return world.mass_kg * math.hypot(north, east, world.gravity + down)


def _left_wrongly(
    fault: Fault, state: str, config: Config, wire: WireJudge, pushing: Thrust, struck_s: float
) -> str:
    """Describe a command that must not have left; empty where there is none."""
    if wire.wrong:
        return wire.wrong
    most = config.flight.coast_s + config.guards.level_s + 2.0 + BLIND_S
    if fault.poses is Poses.GONE and pushing.last_lift_s > struck_s + most:
        return (
            f"a command that lifts left {pushing.last_lift_s - struck_s:.2f} s after the last true "
            "pose"
        )
    if fault.silences and wire.last_s > struck_s + HEARTBEAT_S and MOMENTS[state].flying:
        return f"something left {wire.last_s - struck_s:.2f} s after a pilot had taken over"
    return ""


class _CopiesFlown(Exception):
    """All copies have flown on."""


def fly_together(
    copies: Sequence[FlightCopy],
    state: str,
    *,
    link: str,
    seed: int,
    scenario: str,
    overrides: tuple[str, ...] = (),
) -> list[Row]:
    """Return the rows of ``copies``, whose cases are set up alike: they strike one flight."""
    case = copies[0].case
    rows: list[Row] = []
    out: int | None = None  # where a copy writes its row; None in the process that is none
    found: Row | str

    def split() -> FlightCopy:
        """Fork a process for each copy, one after the other; return in each of them which it is."""
        nonlocal out
        loop = asyncio.get_running_loop()
        for copy in copies:
            far, near = os.pipe()
            number = os.fork()
            if number == 0:
                os.close(far)
                asyncio._set_running_loop(loop)  # it is told by the process's number
                out = near
                return copy
            os.close(near)
            with os.fdopen(far, "rb") as told:
                row = msgspec.msgpack.decode(told.read() or b"\xc0", type=Row | str | None)
            os.waitpid(number, 0)
            if not isinstance(row, Row):
                raise RuntimeError(f"{copy.case}: {row or 'its process was killed'}")
            rows.append(row)
        raise _CopiesFlown

    try:
        found = fly_cell(
            case, state, link=link, seed=seed, scenario=scenario, overrides=overrides, split=split
        )
    except _CopiesFlown:
        return rows
    except BaseException as error:
        if out is None:
            raise
        found = f"{type(error).__name__}: {error}"
    if out is not None:  # a copy ends here: what comes next is its original's to do
        os.write(out, msgspec.msgpack.encode(found))
        os._exit(0)
    assert isinstance(found, Row), "told by whoever has failed"
    never = found.why
    return [
        not_struck(copy.case, find_fault(copy.case, state, link), state, never, scenario)
        for copy in copies
    ]
