"""What really happened to the vehicles of a fleet: how near they came to each other, and to their figures."""

import math
from array import array
from collections.abc import Sequence
from itertools import combinations, pairwise

import msgspec

from groundstation.core.geometry import Vec3
from groundstation.core.mission import State
from groundstation.settings import Config
from sim.runs.fleet_stage import FleetStage
from sim.runs.mission import Entered
from sim.runs.referee import STEADY_S

SAMPLE_S = 0.02
"""How densely distances between vehicles are taken [s]."""


class Nearest(msgspec.Struct, frozen=True):
    """The least distance between two vehicles of a fleet."""

    distance_m: float
    between: tuple[str, str]
    time_s: float
    """When it was, from the first vehicle's release [s]."""


class Told(msgspec.Struct, frozen=True, kw_only=True):
    """What a ground station tells of its flight."""

    states: tuple[Entered, ...]
    started_s: float | None
    """When the figure began, on the event loop's clock [s]."""


class Flown(msgspec.Struct, frozen=True, kw_only=True):
    """One vehicle's flight."""

    name: str
    landed: bool
    """On the floor, motors off, and nothing made it come down early."""
    why: str
    """Why it ended, or what made it come down early."""
    states: tuple[Entered, ...]
    """In their order, with reasons; times are from the first vehicle's release [s]."""
    touchdown_m_s: float | None
    """Fastest that it met the floor; None where it never did."""
    rms_cm: float | None
    """Of the true error on the figure, from 15 s after it began."""
    max_cm: float | None
    figure_s: float
    """How long that is [s]."""
    home_m: float
    """From where it took off to where it stands now [m]."""
    tick_p50_ms: float | None = None
    """From the pose's arrival in the core to the command's leaving it; None in virtual time."""
    tick_p99_ms: float | None = None
    compute_p50_ms: float | None = None
    """The part of it from when the command is begun to its leaving; None in virtual time."""
    compute_p99_ms: float | None = None
    round_p50_ms: float | None = None
    """From the capture system's sending to the autopilot's hearing the command that follows; None in virtual time."""
    round_p99_ms: float | None = None
    ticks: int = 0
    """Commands that these figures rest on."""


class Tracks:
    """Every step of every plant."""

    def __init__(self, count: int) -> None:
        """Nothing yet of ``count`` vehicles."""
        self._tracks = [(array("d"), array("d"), array("d"), array("d")) for _ in range(count)]

    def step(self, number: int, time_s: float, place: Vec3) -> None:
        """One step."""
        for column, value in zip(self._tracks[number], (time_s, *place), strict=True):
            column.append(value)

    @property
    def begun_s(self) -> float:
        """When the first vehicle was released, on the event loop's clock [s]; 0 before that."""
        return min((times[0] for times, *_ in self._tracks if times), default=0.0)

    def last(self, number: int, start: Vec3) -> Vec3:
        """Where it was seen last [m, NED]; ``start`` where it was never released."""
        times, x, y, z = self._tracks[number]
        return (x[-1], y[-1], z[-1]) if times else start

    def nearest(self, names: Sequence[str], starts: Sequence[Vec3]) -> Nearest | None:
        """How near two of them came to each other; one that was never released stays where it started."""
        import numpy as np

        end = max((times[-1] for times, *_ in self._tracks if times), default=0.0)
        grid = np.arange(self.begun_s, end + SAMPLE_S, SAMPLE_S)
        places = []
        for (times, *axes), start in zip(self._tracks, starts, strict=True):
            columns = [
                np.interp(grid, times, axis) if times else grid * 0.0 + s for axis, s in zip(axes, start, strict=True)
            ]
            places.append(np.stack(columns))
        found: Nearest | None = None
        for a, b in combinations(range(len(names)), 2):
            apart = np.linalg.norm(places[a] - places[b], axis=0)
            at = int(np.argmin(apart))
            if found is None or apart[at] < found.distance_m:
                found = Nearest(float(apart[at]), (names[a], names[b]), float(grid[at] - self.begun_s))
        return found

    def errors(self, number: int, config: Config, told: Told) -> list[float]:
        """True distances from the figure [m], from 15 s after its beginning until the flight leaves it."""
        at = config.trajectory.build().position_at
        ends = [b.time_s for a, b in pairwise(told.states) if a.state == State.TRACKING]
        if told.started_s is None:
            return []
        begin, end = told.started_s + STEADY_S, min(ends, default=math.inf)
        return [
            math.dist(place, at(t - told.started_s))
            for t, *place in zip(*self._tracks[number], strict=True)
            if begin <= t < end
        ]


def judged(number: int, name: str, config: Config, told: Told, fault: str, tracks: Tracks, stage: FleetStage) -> Flown:
    """One vehicle's flight by the truth; ``fault`` is what made it come down early, where something did."""
    plant, world = stage.stages[number].plant, stage.stages[number].world
    errors, begun = tracks.errors(number, config, told), tracks.begun_s
    last = told.states[-1] if told.states else Entered(State.IDLE, begun, "nothing was heard of it")
    return Flown(
        name=name,
        landed=last.state == State.LANDED and not fault,
        why=fault or last.reason,
        states=tuple(Entered(one.state, round(one.time_s - begun, 6), one.reason) for one in told.states),
        touchdown_m_s=plant.hardest_m_s,
        rms_cm=100.0 * math.sqrt(sum(e * e for e in errors) / len(errors)) if errors else None,
        max_cm=100.0 * max(errors) if errors else None,
        figure_s=len(errors) * world.step_s,
        home_m=math.dist(world.start_ned[:2], tracks.last(number, world.start_ned)[:2]),
    )
