"""False alarms, ``groundstation-sim dev alarms``: the monitor of the poses in true flights.

How many its poses end, how many are suspected, and how near the monitor came to failing them: in
bad air, at the floors where vehicle or delay is configured wrong, and with noise.
"""

import argparse
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import msgspec

from groundstation.config import ConfigError
from groundstation.core.health import HealthState, PoseHealth
from groundstation.core.messages import Pose
from groundstation.core.pilot import Monitors
from groundstation.flight import Flight
from groundstation.flight.preflight import ensure_flyable
from groundstation.runtime import Exit
from groundstation.settings import Config
from sim.cli import ProgressBar
from sim.runs import Flyers, Stage, fly_mission, from_floor
from sim.scenarios import SCENARIOS, find_scenario, prepare
from sim.studies import FLOORED, FLOORS, ModelError
from sim.text import notice
from sim.world import World

TAKES_OFF = ("takeoff.thrust_limit=1.74", "vehicle.hover_range=[0.5, 1.9]")
"""``--set`` of a take-off with a thrust that is configured wrong: it is not refused."""
WRONGS = (
    *FLOORS,
    ModelError("noise of 4 mm", "pose_noise_m", 0.004),
    ModelError("noise of 0.6°", "attitude_noise_rad", math.radians(0.6)),
)
"""Wrongs that a flight must bear: those of the laws' comparison, and noise."""


class WatchedFlight(msgspec.Struct, frozen=True, kw_only=True):
    """One true flight, and what the monitor made of it."""

    seed: int
    windows: int
    """Evaluations of the monitor."""
    alarm: float
    """Largest test statistic as a share of its threshold [-]."""
    suspected: int
    """Number of times that its poses were suspected."""
    failed: str
    """Id of the reason for which its poses failed; empty where they did not."""
    landed: bool
    why: str
    """Why it came down early, or how it ended."""


class Alarms(msgspec.Struct, frozen=True, kw_only=True):
    """Flights of one scenario, as it is or at one floor, and their figures."""

    name: str
    windows: int
    """Evaluations of the monitor in all."""
    alarm: float
    """Largest test statistic of all, as a share of its threshold [-]."""
    not_flown: int
    """Flights that were refused, or did not lift off."""
    suspected: int
    """Flights whose poses were suspected."""
    ended_by_poses: int
    flights: tuple[WatchedFlight, ...]


class WatchedHealth(PoseHealth):
    """Pose health that keeps its largest alarm, and counts its doubts."""

    largest = 0.0
    """Largest alarm so far [-]."""
    doubts = 0
    """Number of times that the poses became suspect."""

    def add_pose(self, pose: Pose, *args: Any, **kwargs: Any) -> None:
        """Take one pose, as the real one does."""
        super().add_pose(pose, *args, **kwargs)
        self.largest = max(self.largest, self.alarm, self.push_alarm)

    def suspect(self, now_s: float) -> None:
        """Suspect the poses, as the real one does."""
        before = self.state
        super().suspect(now_s)
        self.doubts += before is HealthState.OK and self.state is HealthState.SUSPECT


class Watch(NamedTuple):
    """Flights of a campaign, flown with each seed."""

    scenario: str
    floor: ModelError | None = None
    overrides: tuple[str, ...] = ()
    source: str = "vicon"
    link: str = "mavlink"
    figure_s: float = 15.0
    """Time on the figure [s]."""

    @property
    def name(self) -> str:
        """Scenario, and what is wrong in it."""
        return self.scenario if self.floor is None else f"{self.scenario}, {self.floor.name}"

    def prepare(self) -> tuple[World, Config]:
        """Return the truth of its flights, which begin on the floor, and what is configured."""
        scenario, overrides = SCENARIOS[self.scenario], list(self.overrides)
        if self.floor is not None:
            world, config = prepare(scenario, overrides, link=self.link)
            field, value = self.floor.field, self.floor.find_value(world, config.vehicle)
            takes_off = TAKES_OFF if field == "thrust_gain" else ()
            overrides = [*takes_off, *overrides, f"sim.{field}={value:.6g}"]
        world, config = prepare(scenario, overrides, source=self.source, link=self.link)
        return from_floor(world, config, self.figure_s)


def watch_flight(work: tuple[Watch, int]) -> WatchedFlight:
    """Fly one mission from the floor, to its figure and back, with a seed."""
    watch, seed = work
    world, config = watch.prepare()
    flights = list[Flight]()

    async def keep(flight: Flight, _: Stage) -> None:
        flights.append(flight)

    flown = fly_mission(
        world, config, seed=seed, script=keep, monitors=Monitors(health=WatchedHealth)
    )
    health, failure = flights[0]._pilot.state.health, flights[0].failure
    assert isinstance(health, WatchedHealth), "made by these monitors"
    return WatchedFlight(
        seed=seed,
        windows=health.windows,
        alarm=health.largest,
        suspected=health.doubts,
        failed="" if failure is None else failure.id,
        landed=flown.landed,
        why=flown.fault or flown.why,
    )


def watch_all(
    watches: Sequence[Watch],
    seeds: Sequence[int],
    *,
    workers: int,
    on_done: Callable[[int], None] = lambda count: None,
) -> list[Alarms]:
    """Fly each of ``watches`` with each of ``seeds``; ``on_done`` hears how many are flown."""
    work = [(watch, seed) for watch in watches for seed in seeds]
    with Flyers(min(workers, len(work))) as flyers:
        flown = flyers.each(watch_flight, work, on_done)
    found = list[Alarms]()
    for i, watch in enumerate(watches):
        flights = tuple(flown[i * len(seeds) : (i + 1) * len(seeds)])
        found.append(
            Alarms(
                name=watch.name,
                windows=sum(one.windows for one in flights),
                alarm=max(one.alarm for one in flights),
                not_flown=sum(one.windows == 0 for one in flights),
                suspected=sum(one.suspected > 0 for one in flights),
                ended_by_poses=sum(one.failed.startswith("pose.") for one in flights),
                flights=flights,
            )
        )
    return found


def plan_floors(watch: Watch) -> list[Watch]:
    """Return what is flown at every floor, as ``watch`` is otherwise."""
    return [
        watch._replace(scenario=scenario, floor=floor)
        for floor in WRONGS
        for scenario in FLOORED
        if floor.only in ("", scenario)
    ]


def alarms(args: argparse.Namespace) -> Exit:
    """Fly true flights from the floor, and see whether their poses fail."""
    if args.floors and args.scenario is not None:
        raise ConfigError("SCENARIO", notice("dev.floors", names=", ".join(FLOORED)))
    scenario = args.scenario or "adverse"
    find_scenario(scenario)
    watch = Watch(scenario, None, tuple(args.overrides), args.source, args.link, args.duration)
    watches = plan_floors(watch) if args.floors else [watch]
    for one in watches:  # what can't be flown is told before anything is
        ensure_flyable(one.prepare()[1])
    seeds = range(args.seed, args.seed + args.flights)
    with ProgressBar("flights", len(watches) * len(seeds), quiet=args.json) as counter:
        found = watch_all(watches, seeds, workers=args.workers, on_done=counter.at)
    print(msgspec.json.encode(found).decode() if args.json else "\n".join(map(text, found)))
    bad = any(one.ended_by_poses or one.not_flown for one in found)
    return Exit.FAILED if bad else Exit.DONE


def text(found: Alarms) -> str:
    """Return ``found`` as lines of text."""
    lines = [
        f"{found.name}: {len(found.flights)} flights, {found.ended_by_poses} ended by their poses, "
        f"{found.suspected} suspected; largest alarm {found.alarm:.2f}; {found.windows} windows"
        + (f"; {found.not_flown} NOT FLOWN" if found.not_flown else "")
    ]
    for one in found.flights:
        if one.failed.startswith("pose."):
            lines.append(f"  seed {one.seed}: {one.failed}: {one.why}")
        elif not one.landed:
            lines.append(f"  seed {one.seed}: did not land as planned: {one.why}")
    return "\n".join(lines)
