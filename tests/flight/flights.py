"""Whole flights in virtual time, flown once in a run of tests however many of them look at it."""

import asyncio
import contextlib
import math
import struct
from collections.abc import (
    Awaitable,
    Callable,
    Iterable,
    Iterator,
    Mapping,
    Sequence,
)
from functools import cache
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple, TypeVar

import pytest

from groundstation.config import UserCodeFault
from groundstation.core.control import Law
from groundstation.core.geometry import Vec3
from groundstation.core.messages import CommandSent, FlightEvent, Notice, Subscriber, Tick
from groundstation.core.mission import State
from groundstation.flight import Flight, make_flight
from groundstation.machine import sleep_until
from links.core import Command
from sim.runs import Flyers, MissionResult, Stage, confirm_at, fly, fly_mission, from_floor
from sim.runs.flight import Result, Script
from sim.scenarios import SCENARIOS, prepare
from sim.studies.campaign import Campaign, Local, report, run
from sim.studies.tune import SortieOutcome, tune
from sim.studies.tune.tune import Sortie
from sim.time import VirtualTimeLoop, in_virtual_time
from tests.flown_once import once
from tests.known import known
from tests.loops import running, until
from tests.proving.faults import CASES, NEAR, DeckFlight, Fault, Row, find_fault

A = TypeVar("A")
T = TypeVar("T")
Certified = tuple[float, float, float]
"""Time [s], V with the truth for what is estimated, and the error [m], at a command."""


CLIMB = ("takeoff.height_m=0.5", "takeoff.hold_s=1.0", "takeoff.climb_m_s=1.0")
# The start is near where the figure begins.
SHORT = (*CLIMB, "trajectory.altitude_m=-0.5", "sim.start_ned=[0.7, 0.3, 0.0]")
"""``--set`` of a mission that takes little time."""


def mission(
    scenario: str, *overrides: str, figure_s: float = 2.0, seed: int = 0, source: str = "vicon",
    link: str = "mavlink",
    **options: Any,
) -> MissionResult:  # fmt: skip
    """A mission from the floor and back; ``options`` are those of ``fly_mission``."""
    world, config = prepare(SCENARIOS[scenario], list(overrides), source=source, link=link)
    return fly_mission(*from_floor(world, config, figure_s), seed=seed, **options)


async def flying(flight: Flight, seconds: float) -> None:
    """Wait until the reference has run for ``seconds``."""
    while flight.started_s is None:
        await asyncio.sleep(0.01)
    await sleep_until(flight.started_s + seconds)


Act = Callable[[Flight, Stage], object]
"""What happens in a flight at one instant."""


async def nothing(_flight: Flight, _stage: Stage) -> None:
    """Nothing happens beside the flight."""


def after(seconds: float, act: Act) -> Script:
    """``act`` once the reference has run for ``seconds``."""

    async def script(flight: Flight, stage: Stage) -> None:
        await flying(flight, seconds)
        act(flight, stage)

    return script


def in_state(state: State, act: Act, after_s: float = 0.3) -> Script:
    """``act`` as ``state`` has lasted ``after_s`` [s]."""

    async def script(flight: Flight, stage: Stage) -> None:
        await until(lambda: flight.state is state)
        await asyncio.sleep(after_s)
        act(flight, stage)

    return script


def cover_cameras(_: Flight, stage: Stage) -> None:
    """No pose leaves any more."""
    known(stage.mocap).cover(True)


class SetPoint(NamedTuple):
    """A SET_ATTITUDE_TARGET that left."""

    time_s: float
    thrust: float
    """Share of the full thrust [-]."""
    rates: Vec3
    """Body rates [rad/s]."""


def read_set_points(sent: Iterable[tuple[float, bytes]]) -> list[SetPoint]:
    """The set-points among MAVLink datagrams and the instants at which these left."""
    frames = [
        (time_s, data.ljust(60, b"\0")) for time_s, data in sent if data[7:10] == b"\x52\x00\x00"
    ]
    unpacked = [(time_s, *struct.unpack_from("<4f", frame, 10 + 20)) for time_s, frame in frames]
    return [SetPoint(time_s, thrust, (p, q, r)) for time_s, p, q, r, thrust in unpacked]


class Wire:
    """Record of a flight: datagrams to its autopilot, commands given to the link, its end."""

    def __init__(self) -> None:
        self.sent: list[tuple[float, bytes]] = []
        """Every datagram, and when it left [s]."""
        self.commands: list[tuple[float, Command]] = []
        self.lines: list[str] = []
        self.state: State | None = None
        self.reason = ""
        self.begun_s = math.inf
        """When the reference began to run [s]."""
        self.stage: Stage

    @property
    def frames(self) -> list[SetPoint]:
        return read_set_points(self.sent)

    def tap(
        self, time_s: float, source: tuple[str, int], _target: tuple[str, int], data: bytes
    ) -> None:
        if source[1] == 14540:
            self.sent.append((time_s, data))

    def hear(self, event: FlightEvent) -> None:
        if isinstance(event, CommandSent):
            self.commands.append((event.tick.time_s, event.tick.command))
        elif isinstance(event, Notice):
            self.lines.append(event.line)


def fly_beside(
    script: Script,
    *overrides: str,
    scenario: str = "paper",
    seed: int = 0,
    confirm: Callable[[], Awaitable[bool]] | None = None,
    parameters: Mapping[str, float] | None = None,
) -> Wire:
    """A flight from the air with ``script`` beside it; in 5 s more nothing may come back."""
    world, config = prepare(SCENARIOS[scenario], list(overrides))
    wire = Wire()

    async def main() -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)
        loop.tap = wire.tap
        wire.stage = Stage(world, config, seed, parameters=parameters)
        flight = make_flight(config, confirm=confirm or confirm_at(1.0), subscribers=(wire.hear,))
        beside = asyncio.ensure_future(script(flight, wire.stage))
        async with running(wire.stage):
            with contextlib.suppress(UserCodeFault):
                await flight.run()
            wire.state, wire.reason = flight.state, flight.snapshot().reason
            wire.begun_s = math.inf if flight.started_s is None else flight.started_s
            await asyncio.sleep(5.0)
        beside.cancel()
        await asyncio.gather(beside, return_exceptions=True)

    in_virtual_time(main)()
    return wire


@cache
def flown(
    scenario: str, *overrides: str, seed: int = 0, duration_s: float = 60.0, source: str = "vicon",
    link: str = "mavlink",
) -> Result:  # fmt: skip
    """One flight of ``scenario`` with ``--set`` overrides."""
    world, config = prepare(SCENARIOS[scenario], list(overrides), source=source, link=link)
    key = ("flown", world, config, seed, duration_s)
    return once(key, lambda _: fly(world, config, seed=seed, duration_s=duration_s))


def rms_cm(scenario: str, *overrides: str, duration_s: float, **options: Any) -> float:
    """RMS error over the steady part of a flight, which must be completed [cm]."""
    result = flown(scenario, *overrides, duration_s=duration_s, **options)
    assert result.completed, result.why
    return known(result.verdict.rms_cm)


def fly_cell(
    case: str, state: str, link: str = "", overrides: tuple[str, ...] = (), **options: Any
) -> Row:
    """A cell of the fault deck, flown in this process."""
    fault = find_fault(case, state, link or CASES[case].link)
    return fly_fault(case, fault, state, overrides=(*NEAR, *overrides), **options)


def fly_fault(
    case: str, fault: Fault, state: str, *, seed: int = 0, scenario: str = "paper", **options: Any
) -> Row:
    """A flight that a fault of one's own strikes, as the fault deck judges it."""

    async def fly() -> Row:
        flight = DeckFlight(fault, seed, scenario, **options)
        await flight.reach(state)
        return await flight.strike(case, state)

    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(fly())


def ticks_to(keep: Callable[[Tick], object]) -> Subscriber:
    """Give ``keep`` each command as it has left."""

    def hear(event: FlightEvent) -> None:
        if isinstance(event, CommandSent):
            keep(event.tick)

    return hear


@cache
def flown_ideal(composite: str) -> tuple[Result, list[Certified]]:
    """12 s of ``ideal`` by that form of composite adaptation, and V at each of its commands."""
    world, config = prepare(SCENARIOS["ideal"], [f"controller.composite={composite}"])

    def make(_: Path) -> tuple[Result, list[Certified]]:
        law = config.controller
        assert isinstance(law, Law)
        rows: list[Certified] = []

        def on_tick(tick: Tick) -> None:
            d = tick.decision.diagnostics
            b = sum((x - y) ** 2 for x, y in zip(d.b_hat, world.wind_mean, strict=True))
            error = sum(x * x for x in d.z1) ** 0.5
            rows.append((tick.flight_time_s, d.v_known + b / (2.0 * law.kb), error))

        result = fly(world, config, seed=0, duration_s=12.0, watch=ticks_to(on_tick))
        assert result.completed, result.why
        return result, rows

    return once(("ideal", world, config), make)


def campaign_of(flights: int, *, duration_s: float, workers: int) -> dict[str, Any]:
    """The figures of the `adverse` campaign's first flights, as its report has them."""
    world, config = prepare(SCENARIOS["adverse"], [])
    campaign = Campaign(
        scenario="adverse", world=world, config=config, duration_s=duration_s, overrides=[]
    )
    rows, flown = run(campaign, range(flights), Local(workers))
    return report(campaign, rows, flown=flown, wall_s=1.0, workers=workers)


def median_of(values: list[float | None]) -> float:
    """Their median; one flight that has no such figure fails the test."""
    assert None not in values
    return median(v for v in values if v is not None)


def middle(
    scenario: str, field: str, *overrides: str, seeds: int = 10, duration_s: float = 60.0
) -> float:
    """Median of one figure of the verdict over ``seeds`` flights, all of them completed."""
    results = [
        flown(scenario, *overrides, seed=seed, duration_s=duration_s) for seed in range(seeds)
    ]
    assert all(r.completed for r in results), [r.why for r in results]
    return median_of([getattr(r.verdict, field) for r in results])


class UnflownFlyers(Flyers):
    """Knows what every flight comes to without flying it."""

    def __init__(self) -> None:
        super().__init__(1)
        self.flights: list[Sortie] = []

    def judge(self, sortie: Sortie) -> SortieOutcome:
        """What comes of it."""
        raise NotImplementedError

    def look(self, sortie: Sortie) -> SortieOutcome:
        """Note it, and judge it."""
        self.flights.append(sortie)
        return self.judge(sortie)

    def as_done(self, fn: Callable[[A], T], work: Sequence[A]) -> Iterator[tuple[int, T]]:
        """As the real ones, but that nothing is flown."""
        with pytest.MonkeyPatch.context() as patched:
            flown: Any = self.look if fn is tune.fly_sortie else fn
            patched.setattr(tune, "fly_sortie", self.look)
            yield from super().as_done(flown, work)
