"""False alarms: true flights from the floor with the monitor of the poses armed, and how near it came to accusing them.

And the other side of the same coin: how long it takes to see that the picture stands, by the threshold that convicts.
"""

import asyncio
import concurrent.futures as cf  # noqa: TID251  # processes, not threads, and none of them around an event loop
import multiprocessing
from collections.abc import Callable, Iterable, Sequence
from functools import partial

import msgspec

from groundstation.core.safety import NODE_S, Contradiction
from groundstation.flight import Flight
from groundstation.runtime import sleep_until
from sim.runs import MISSION_CONFIRM_S, Stage, fly_mission, from_floor
from sim.scenarios import SCENARIOS, prepare
from sim.trackers import Tracker
from sim.world import rows, stream
from tests.proving.faults.deck import Meddler, Struck, still

KINDS = Contradiction._fields
"""What may speak against the poses."""
SHARES = (0.25, 0.375, 0.5, 0.75, 1.0, 1.25, 1.5)
"""Thresholds whose alarms are counted, as shares of what ends a flight."""
REMARKABLE = (0.2, 0.5)
"""A flight whose largest statistic exceeds these is counted."""
ACCUSES = ("suspicion: ", "convicted: ")
"""A line or a reason that says so accuses the poses."""
LOOK_S = 0.5 * NODE_S
"""How often it is looked whether there is a new window [s]."""
STRUCK_S, SEEN_S = 12.0, 8.0
"""The picture stands from so long after the arming on, and is looked at for so long [s]."""
STRIKES = 5
"""Flights in which it stands, of each kind; each is struck 0.37 s later than the last."""


class Watched(msgspec.Struct, frozen=True, kw_only=True):
    """One true flight, and what the monitor made of it."""

    seed: int
    windows: int
    """Windows that the monitor looked at."""
    largest: dict[str, float]
    """Largest statistic of each kind, as a share of what convicts."""
    passed: tuple[int, ...]
    """Windows in which the largest statistic reached each of :data:`SHARES`."""
    accused: tuple[str, ...]
    """What was said against the poses."""
    landed: bool
    why: str
    """What made it come down early, or how it ended."""

    @property
    def ended_by_poses(self) -> bool:
        """Whether it ended early because of them, as poses that lie end a flight."""
        return not self.landed and _accuses(self.why)


class Alarms(msgspec.Struct, frozen=True, kw_only=True):
    """What came of them all."""

    flights: tuple[Watched, ...]

    @property
    def windows(self) -> int:
        """Windows looked at."""
        return sum(one.windows for one in self.flights)

    @property
    def largest(self) -> dict[str, float]:
        """Largest statistic of each kind, as a share of what convicts."""
        return {kind: max(one.largest[kind] for one in self.flights) for kind in KINDS}

    @property
    def accused(self) -> tuple[Watched, ...]:
        """Flights whose poses were accused."""
        return tuple(one for one in self.flights if one.accused)

    def above(self, share: float) -> int:
        """How many flights had a statistic above ``share`` of what convicts."""
        return sum(max(one.largest.values()) > share for one in self.flights)


def _accuses(line: str) -> bool:
    return any(word in line for word in ACCUSES)


class _Trace:
    """The evidence window by window, as a flight goes on."""

    def __init__(self) -> None:
        self.windows: list[tuple[float, Contradiction]] = []
        """The instant [s, event loop's clock] and what spoke against the poses."""

    async def watch(self, flight: Flight) -> None:
        """Look at each window; ends with the flight."""
        loop, seen = asyncio.get_running_loop(), 0
        while True:
            if flight.monitor.windows != seen:
                seen = flight.monitor.windows
                self.windows.append((loop.time(), flight.evidence))
            await asyncio.sleep(LOOK_S)


def watched(
    scenario: str, seed: int, *, overrides: Sequence[str] = (), source: str = "vicon", link: str = "mavlink",
    figure_s: float,
) -> Watched:  # fmt: skip
    """Fly ``scenario`` from the floor, its figure for ``figure_s`` [s], and back, with the monitor armed."""
    world, config = prepare(SCENARIOS[scenario], list(overrides), source=source, link=link)
    world, config = from_floor(world, config, figure_s)
    trace, said, flights = _Trace(), list[str](), list[Flight]()

    async def script(flight: Flight, stage: Stage) -> None:
        flights.append(flight)
        await trace.watch(flight)

    flown = fly_mission(world, config, seed=seed, on_event=said.append, script=script)
    lines = (line.split(" ", 1)[1] for line in said)  # after the instant
    evidence = [each for _, each in trace.windows] or [Contradiction(0.0, 0.0, 0.0, 0.0)]
    return Watched(
        seed=seed,
        windows=flights[0].monitor.windows,
        largest={kind: max(getattr(each, kind) for each in evidence) for kind in KINDS},
        passed=tuple(sum(max(each) >= share for each in evidence) for share in SHARES),
        accused=tuple(line for line in lines if _accuses(line)),
        landed=flown.landed,
        why=flown.fault or flown.why,
    )


def watch_all(
    scenario: str, seeds: Sequence[int], *, overrides: Sequence[str] = (), source: str = "vicon",
    link: str = "mavlink", figure_s: float, workers: int, on_done: Callable[[int], None] = lambda count: None,
) -> Alarms:  # fmt: skip
    """Fly ``scenario`` with each of ``seeds``; ``on_done`` hears how many are flown."""
    fly = partial(watched, scenario, overrides=tuple(overrides), source=source, link=link, figure_s=figure_s)
    found: dict[int, Watched] = {}

    def take(each: Iterable[Watched]) -> None:
        for one in each:
            found[one.seed] = one
            on_done(len(found))

    if workers <= 1 or len(seeds) <= 1:
        take(map(fly, seeds))
    else:
        # Spawned, as a forked process would inherit whatever threads this one has.
        context = multiprocessing.get_context("spawn")
        with cf.ProcessPoolExecutor(max_workers=min(workers, len(seeds)), mp_context=context) as pool:
            jobs = [pool.submit(fly, seed) for seed in seeds]
            try:
                take(job.result() for job in cf.as_completed(jobs))
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise
    return Alarms(flights=tuple(found[seed] for seed in seeds))


# ---- how soon a picture that stands is seen


class Detection(msgspec.Struct, frozen=True, kw_only=True):
    """How long it takes until the largest statistic reaches a threshold, once a picture stands but for noise."""

    share: float
    """The threshold as a share of what convicts."""
    hold_s: tuple[float | None, ...]
    """From the strike in a calm hold, each flight's [s]; None where it did not within :data:`SEEN_S`."""
    tracking_s: tuple[float | None, ...]
    """The same on the figure."""


def detections(strikes: int = STRIKES) -> tuple[Detection, ...]:
    """For each of :data:`SHARES`, of ``strikes`` flights in `paper` each.

    They start in the air, where no guard and no conviction ends them: the statistic goes on as if nothing came of it.
    """
    hold = [_struck(seed, "trajectory.kind=hold") for seed in range(strikes)]
    tracking = [_struck(seed) for seed in range(strikes)]
    return tuple(
        Detection(
            share=share,
            hold_s=tuple(_reached(trace, share) for trace in hold),
            tracking_s=tuple(_reached(trace, share) for trace in tracking),
        )
        for share in SHARES
    )


def _struck(seed: int, *overrides: str) -> list[tuple[float, Contradiction]]:
    """The evidence of one flight from the strike on, by the time since."""
    world, config = prepare(SCENARIOS["paper"], list(overrides))
    trace, struck, meddlers = _Trace(), list[float](), list[Meddler]()

    def meddle(tracker: Tracker) -> Tracker:
        meddlers.append(Meddler(tracker))
        return meddlers[0]

    async def script(flight: Flight, stage: Stage) -> None:
        assert stage.mocap is not None, "cameras look on"
        stage.mocap.through(meddle)
        watching = asyncio.ensure_future(trace.watch(flight))
        await sleep_until(MISSION_CONFIRM_S + STRUCK_S + 0.37 * seed)
        shown, now_s = meddlers[0].shown, asyncio.get_running_loop().time()
        assert shown is not None, "it has been seen"
        normals = rows(stream(seed, "fault").standard_normal, 6)
        meddlers[0].picture = still(Struck(now_s, shown.position_ned, shown.attitude, normals))
        struck.append(now_s)
        await asyncio.sleep(SEEN_S)
        watching.cancel()
        flight.stop("all is seen")

    fly_mission(world, config, seed=seed, script=script)
    return [(time_s - struck[0], each) for time_s, each in trace.windows if time_s >= struck[0]]


def _reached(trace: list[tuple[float, Contradiction]], share: float) -> float | None:
    return next((since_s for since_s, each in trace if max(each) >= share), None)
