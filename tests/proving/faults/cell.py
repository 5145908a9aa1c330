"""One fault in one state of one mission, in virtual time, against the simulated side.

Up to its strike a flight is the same for all faults that are set up alike: the wait for poses, the
take-off, the way onto the figure. It is flown once, and each fault strikes a copy of the process
that has flown it; the rows are those of flights of their own. That process has no other thread.
"""

import asyncio
import math
import os
from collections.abc import Sequence
from typing import Any

import msgspec
from msgspec.structs import replace

from groundstation.core.geometry import Vec3
from groundstation.core.messages import (
    Ask,
    CommandSent,
    FlightEvent,
    Notice,
    Request,
    Tick,
    Waypoint,
)
from groundstation.core.mission import State
from groundstation.flight import Give, make_flight
from groundstation.recording import Record
from links.core import BRING_DOWN_LIMIT_S, thrust as thrust_of
from sim.autopilots import Px4Autopilot
from sim.radio import FAILSAFE_S
from sim.runs import LIMIT_S, MISSION_CONFIRM_S, Stage, confirm_at, from_floor
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
from tests.proving.faults.faults import find_fault
from tests.proving.faults.judge import (
    AUTOPILOT_LANDS,
    JUDGED_S,
    Observations,
    Row,
    Thrust,
    Truth,
    WireJudge,
    exemption_of,
    judge,
)
from tests.proving.faults.monitors import MONITORS, UNGUARDED, go_on

LANDS = ("sim.own_estimate=true",)
"""The autopilot of the deck knows where it is, so it is asked to land where we can't see it."""
AUTOPILOT = {"COM_OF_LOSS_T": 0.3}
"""Time for which PX4 holds the last set-point [s]: docs/how-to/px4.md asks for 0.2 to 1."""
FIGURE_S = 5.0
"""Duration of the figure where nothing ends it early [s]."""
NEAR = ("trajectory.centre_ned=[0.093,-1.507,0]",)
"""The figure begins 1 m above the place at which the scenario's vehicle holds: a short way."""
MOVES_BY = (0.9, 0.6, -0.3)
"""Point that is asked for, from where it holds [m, NED]."""
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


class Cell(msgspec.Struct, frozen=True):
    """One case in one state, on one link."""

    case: str
    state: str
    link: str
    scenario: str = "paper"
    seed: int = 0
    forced: str = ""
    """Monitor that it goes on with after the strike, as :func:`monitors.go_on` has it."""

    @property
    def fault(self) -> Fault:
        """Fault of this case as it is flown here."""
        return find_fault(self.case, self.state, self.link)


def fly_together(cells: Sequence[Cell], overrides: tuple[str, ...] = ()) -> list[Row]:
    """Return the rows of ``cells``, which are set up alike: they strike one flight."""
    if not any(override.startswith("trajectory.") for override in overrides):
        overrides = (*NEAR, *overrides)

    async def fly() -> list[Row]:
        flight = DeckFlight(cells[0].fault, cells[0].seed, cells[0].scenario, overrides)
        await flight.reach(cells[0].state)
        return [await _finish_copy(flight, cell) for cell in cells]

    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        try:
            return runner.run(fly())
        except NotReached as error:
            never = Observations(Truth(0.0), wrong=str(error))
            return [judge(one.case, one.fault, one.state, never, one.scenario) for one in cells]


async def _finish_copy(flight: "DeckFlight", cell: Cell) -> Row:
    """Return the row of ``cell``, which a copy of this process flies."""
    loop = asyncio.get_running_loop()
    far, near = os.pipe()
    number = os.fork()
    if number == 0:
        asyncio._set_running_loop(loop)  # it is told by the process's number
        found: Row | str
        try:
            found = await flight.finish(cell)
        except BaseException as error:  # noqa: BLE001  # its original raises it
            found = f"{type(error).__name__}: {error}"
        os.write(near, msgspec.msgpack.encode(found))
        # What comes next is its original's to do.
        os._exit(0)
    os.close(near)
    with os.fdopen(far, "rb") as told:
        row = msgspec.msgpack.decode(told.read() or b"\xc0", type=Row | str | None)
    os.waitpid(number, 0)  # noqa: ASYNC222  # virtual time stands still
    if not isinstance(row, Row):
        raise RuntimeError(f"{cell.case}: {row or 'its process was killed'}")
    return row


class _Broken(Exception):
    """Failure of the controller."""


class DeckFlight:
    """One flight of the deck: ground station, simulated side, and what is noted for the judge."""

    def __init__(
        self,
        fault: Fault,
        seed: int,
        scenario: str,
        overrides: tuple[str, ...] = (),
        keep: Give | None = None,
    ) -> None:
        """Set up both sides on the running loop of virtual time, beginning now."""
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop), "in virtual time only"
        self._fault, self._scenario, self._keep = fault, scenario, keep
        self._loop, self._begun_s = loop, loop.time()
        self._blind = False
        """Whether it came down without poses."""
        self._height_believed = True
        """Whether the commands have always used the height of the poses since the strike."""
        self._aborted_m = math.inf
        """Height above the floor at which commands ended [m]."""
        self._failsafe_s = math.inf
        """When the autopilot began to act by itself [s]."""
        self._land_s: float | None = None
        """When it took over landing, as it was asked to [s]."""
        asked = [*(LANDS if fault.link == "mavlink" else ()), *fault.overrides, *overrides]
        world, config = prepare(SCENARIOS[scenario], asked, source=fault.source, link=fault.link)
        self._figure_s = HONEST_FIGURE_S if fault.kind is Kind.HONEST else FIGURE_S
        world, self._config = from_floor(world, config, self._figure_s)
        held_s = AUTOPILOT["COM_OF_LOSS_T"] if fault.link == "mavlink" else FAILSAFE_S
        self._thrust = Thrust(hover_n(world), self._find_thrust, held_s)
        self._wire = WireJudge(self._config, self._thrust)
        loop.tap = self._wire.tap
        self._truth, self._moves = Truth(world.floor_z_m), Moves(loop.time)
        self._stage = Stage(world, self._config, seed, self._truth.step, parameters=AUTOPILOT)
        self._truth.plant = self._stage.plant
        self._stage.plant.advance(self._begun_s)
        meddler = stand_between(self._stage)
        self.flight = make_flight(
            self._config,
            confirm=confirm_at(self._begun_s + MISSION_CONFIRM_S),
            subscribers=(self._hear,),
            wires=self._stage.wires,
            give=self._give,
            monitors=MONITORS,
        )
        self._scene = Scene(self.flight, self._stage, meddler, seed)
        self._running: list[asyncio.Future[Any]] = []
        """The simulated side and the ground station, once they run."""

    async def reach(self, state: str) -> None:
        """Fly to the moment of ``state``; the flight is judged from then on.

        Raises:
            NotReached: the flight ended before it.
        """
        running = map(asyncio.ensure_future, (self._stage.run(), self.flight.run()))
        self._running = list[asyncio.Future[Any]](running)
        reaching = asyncio.ensure_future(self._wait_for(MOMENTS[state]))
        await asyncio.wait({*self._running, reaching}, return_when=asyncio.FIRST_COMPLETED)
        if not reaching.done():
            await _cancel([*self._running, reaching])
            moves = self._moves
            raise NotReached(f"the flight ended before {state}: {moves.state}: {moves.reason}")
        reaching.result()

    async def finish(self, cell: Cell) -> Row:
        """Go on as ``cell``, which is set up as this flight is, and return its row."""
        self._fault = cell.fault
        chance = generator(cell.seed, f"doubt {cell.case}").random()
        go_on(self.flight, cell.forced, self._truth.struck_s + float(chance * FORCED_WITHIN_S))
        row = await self.strike(cell.case, cell.state)
        return replace(row, forced="" if cell.forced == UNGUARDED else cell.forced)

    async def strike(self, name: str, state: str) -> Row:
        """Let the fault ``name`` happen in ``state``, and fly on until it can be judged."""
        plant, exemption = self._stage.plant, exemption_of(self._fault, state)
        beside = [self._fault.strike(self._scene), self._watch_autopilot()]
        if state == "moving":
            beside.append(self._return())
        tasks = [*self._running, *map(asyncio.ensure_future, beside)]
        over = asyncio.ensure_future(self._see(exemption))
        await asyncio.wait(
            {*self._running, over},
            timeout=LIMIT_S + self._figure_s,
            return_when=asyncio.FIRST_COMPLETED,
        )
        has_ended = self._running[1].done()
        rests = has_ended and await self._rests(over)
        restless = "it does not come to rest" if has_ended else "it does not end"
        wrong = "" if rests or over.done() else restless
        # How a flight is ended that is cut short is no part of it.
        self._truth.end()
        self._thrust.end(self._loop.time())
        answers = [(time_s, str(after), why) for time_s, after, why in self._moves.answers]
        if self._failsafe_s < math.inf:
            why = "set-points stopped: the autopilot's own failsafe"
            answers.append((self._failsafe_s, AUTOPILOT_LANDS, why))
        drift_m = math.dist(self._truth.struck_ned[:2], self._find_place()[:2])
        wrong = wrong or self._find_wrong_command(state)
        for result in await _cancel([*tasks, over]):
            if isinstance(result, Exception) and not isinstance(result, _Broken):
                raise result
        self._loop.tap = None
        # The rotors at their fullest can't hold it.
        is_weak = plant.find_max_thrust_n(self._loop.time()) <= hover_n(self._stage.world)
        seen = Observations(
            truth=self._truth,
            answers=sorted(answers),
            wrong=wrong,
            exemption=exemption or (Exemption.WEAK if is_weak else Exemption.NONE),
            begun_s=self._begun_s,
            drift_m=drift_m,
            touchdown_m_s=plant.floor.hardest_m_s,
            thrust=self._thrust,
            land_s=self._land_s,
            failure=self.flight.failure,
            blind=self._blind,
            height_believed=self._height_believed,
            aborted_m=self._aborted_m,
        )
        row = judge(name, self._fault, state, seen, self._scenario)
        return replace(row, seed=self._scene.seed)

    async def _watch_autopilot(self) -> None:
        """Note when the autopilot acts beside obeying, until cancelled."""
        while self._stage.radio is None:
            autopilot, now_s = self._stage.autopilot, self._loop.time()
            assert isinstance(autopilot, Px4Autopilot), "the deck flies with a PX4"
            if autopilot.failsafe:
                if self._failsafe_s == math.inf:
                    self._failsafe_s = now_s
                    self._note_open_loop(now_s)
            elif self._land_s is None and autopilot.armed and autopilot.mode == autopilot.land_mode:
                self._land_s = now_s
            await asyncio.sleep(2.0 * LOOK_S)

    def _hear(self, event: FlightEvent) -> None:
        if isinstance(event, Notice) and event.kind == "state":
            self._enter(State(event.state), event.text)
        elif isinstance(event, CommandSent):
            self._note_course(event.tick)
            if self._scene.controller_raises:
                raise _Broken("the controller broke")

    def _enter(self, state: State, why: str) -> None:
        """Note a new state of the mission, and whether it answers the fault."""
        self._moves.enter(state, why)
        if not self._moves.answers:
            return
        if state is State.ABORTED:
            self._aborted_m = min(self._aborted_m, self._find_height_m())
        # Without poses a failsafe descent follows none, too.
        if state is State.ABORTED or (state is State.DESCENT and self._fault.poses is Poses.GONE):
            self._note_open_loop(self._loop.time())
        if self._thrust.decided_s == math.inf:
            self._thrust.decided_s = self._loop.time()
            self._thrust.decided_height_m = self._find_height_m()

    def _note_course(self, tick: Tick) -> None:
        """Note where one command wants the vehicle to be."""
        state, moves = self.flight._pilot.state, self._moves
        if moves.struck and state.is_blind:
            self._height_believed = False
            self._blind = self._blind or not state.health.has_failed
        # What false poses led to is no course any more: it may run away with them.
        misled = self._fault.poses is not Poses.TRUE and bool(moves.answers)
        if not misled and moves.state not in (State.DESCENT, State.ABORTED, State.DISARMING):
            reference = tick.reference
            self._truth.refer(
                tick.time_s, reference.position_ned, reference.velocity_ned, tick.estimate.time_s
            )

    def _note_open_loop(self, time_s: float) -> None:
        """Commands follow no pose from ``time_s`` [s] on."""
        answered_s = time_s + self._stage.world.frame_period_s
        self._thrust.answered_s = min(self._thrust.answered_s, answered_s)

    def _give(self, record: Record) -> None:
        self._wire.record(record)
        if self._keep is not None:
            self._keep(record)
        if self._scene.recorder_raises:
            raise OSError("the recorder is gone")

    def _find_thrust(self, time_s: float, signal: float) -> float:
        """Thrust that a signal (0..1) truly gives [N]."""
        return thrust_of(
            signal, self._stage.world.thrust_curve
        ) * self._stage.plant.find_max_thrust_n(time_s)

    def _find_place(self) -> Vec3:
        return self._stage.plant.truth(self._loop.time()).position_ned

    def _find_height_m(self) -> float:
        return self._stage.world.floor_z_m - self._find_place()[2]

    def _find_wrong_command(self, state: str) -> str:
        """Describe a command that must not have left; empty where there is none."""
        wire, config, struck_s = self._wire, self._config, self._truth.struck_s
        if wire.wrong:
            return wire.wrong
        most_s = config.flight.coast_s + config.guards.level_s + BRING_DOWN_LIMIT_S + BLIND_S
        lifted_s = self._thrust.last_lift_s - struck_s
        if self._fault.poses is Poses.GONE and self._thrust.last_lift_s > struck_s + most_s:
            return f"a command that lifts left {lifted_s:.2f} s after the last true pose"
        if self._fault.silences and wire.last_s > struck_s + HEARTBEAT_S and MOMENTS[state].flying:
            return f"something left {wire.last_s - struck_s:.2f} s after a pilot had taken over"
        return ""

    async def _wait_for(self, moment: Moment) -> None:
        """Wait for ``moment``, and judge from then on.

        A point to go to (at the moment *hold*), or a failsafe descent (at *tracking*), is asked
        for: no flight comes to it by itself.
        """
        flight, moves = self.flight, self._moves
        while True:
            if moves.state is State.TRACKING and flight.started_s is not None:
                moves.since_s = flight.started_s  # the figure, not the way onto it
            if moment.state is State.DESCENT and MOMENTS["tracking"].has_lasted(moves):
                flight.ask(Request(Ask.DESCEND, "the deck"))
            if moment.state is State.MOVING and MOMENTS["hold"].has_lasted(moves):
                place = self._find_place()
                point = Waypoint(*(here + by for here, by in zip(place, MOVES_BY, strict=True)))
                flight.ask(Request(Ask.GOTO, "the deck", (point,)))
            if moment.is_now(moves, self._find_height_m()):
                moves.struck = True
                self._truth.strike(self._loop.time())
                return
            await asyncio.sleep(LOOK_S)

    async def _return(self) -> None:
        """Ask for the way back from the point that was asked for: a flight holds there."""
        while True:
            await asyncio.sleep(LOOK_S)
            if MOMENTS["hold"].has_lasted(self._moves):
                self.flight.ask(Request(Ask.RETURN, "the deck"))
                return

    async def _see(self, exemption: Exemption) -> None:
        """Return once a flight that may go on for ever has been seen.

        An honest one that ends early is seen to its end.
        """
        plant, is_honest, flown_s = self._stage.plant, self._fault.kind is Kind.HONEST, 0.0
        if not is_honest and exemption is not Exemption.NOT_OBSERVABLE:
            await self._loop.create_future()
        while flown_s < (HONEST_S if is_honest else JUDGED_S):
            await asyncio.sleep(LOOK_S)
            flies = plant.released_s is not None and not plant.truth(self._loop.time()).on_ground
            flown_s += LOOK_S if flies or flown_s else 0.0
        if is_honest and self._moves.answers:
            await asyncio.sleep(HONEST_MORE_S)

    async def _rests(self, over: "asyncio.Future[None]") -> bool:
        """Whether it comes to stand with its motors off, before all is ``over``."""
        plant, world, begun = self._stage.plant, self._stage.world, self._loop.time()
        while self._loop.time() < begun + REST_LIMIT_S and not over.done():
            now = plant.truth(self._loop.time())
            stands = now.on_ground or plant.released_s is None
            if stands and now.thrust_n < STILL_SHARE * world.mass_kg * world.gravity:
                return True
            await asyncio.sleep(0.05)
        return False


async def _cancel(tasks: Sequence["asyncio.Future[Any]"]) -> list[Any]:
    """Cancel ``tasks``; return their results, or what they raised."""
    for task in tasks:
        task.cancel()
    return await asyncio.gather(*tasks, return_exceptions=True)


def hover_n(world: World) -> float:
    """The thrust that holds it against weight and wind [N]."""
    north, east, down = world.wind_mean
    return world.mass_kg * math.hypot(north, east, world.gravity + down)
