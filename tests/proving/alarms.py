"""False alarms, ``groundstation-sim alarms``: true flights from the floor with the monitor of the poses armed.

How near the monitor came to accusing them; how long it takes to see that the picture stands, by the threshold that
convicts; or the monitor over a recorded flight, which the shadow of ``groundstation replay`` reads. There the poses are
the autopilot's own, so that there is no second witness.
"""

import argparse
import asyncio
import concurrent.futures as cf  # noqa: TID251  # processes, not threads, and none of them around an event loop
import json
import math
import os
import shlex
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from statistics import mean, median

import msgspec

from groundstation.analysis.evidence import OpenedRecording, flying, open_recording
from groundstation.config import ConfigError
from groundstation.core import Pilot
from groundstation.core.messages import Notice
from groundstation.core.mission import FINAL
from groundstation.core.safety import NODE_S, WANDERING_M, Conviction, PoseEvidence, charge_lateness
from groundstation.core.vehicle import ActuatorCommand
from groundstation.flight import Flight, ensure_flyable
from groundstation.machine import replace_between_markers, sleep_until, split_at_markers
from groundstation.runtime import Exit
from sim.cli import ProgressBar
from sim.runs import MISSION_CONFIRM_S, Stage, Workers, fly_mission, from_floor
from sim.scenarios import SCENARIOS, prepare, scenario_of
from sim.trackers import Tracker
from sim.world import rows, stream
from tests.proving.faults import Meddler, Struck, still

KINDS = PoseEvidence._fields
"""What may speak against the poses."""
SHARES = (0.25, 0.375, 0.5, 0.75, 1.0, 1.25, 1.5)
"""Thresholds whose alarms are counted, as shares of what ends a flight."""
REMARKABLE = (0.2, 0.5)
"""A flight whose largest statistic exceeds these is counted."""
LOOK_S = 0.5 * NODE_S
"""How often it is looked whether there is a new window [s]."""
STRUCK_S, SEEN_S = 12.0, 8.0
"""The picture stands from so long after the arming on, and is looked at for so long [s]."""
STRIKES = 5
"""Flights in which it stands, of each kind; each is struck 0.37 s later than the last."""


class WatchedFlight(msgspec.Struct, frozen=True, kw_only=True):
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
    ended_by_poses: bool
    """Whether it ended early because of them, as poses that lie end a flight."""


class Alarms(msgspec.Struct, frozen=True, kw_only=True):
    """What came of them all."""

    flights: tuple[WatchedFlight, ...]

    @property
    def windows(self) -> int:
        """Windows looked at."""
        return sum(one.windows for one in self.flights)

    @property
    def largest(self) -> dict[str, float]:
        """Largest statistic of each kind, as a share of what convicts."""
        return {kind: max(one.largest[kind] for one in self.flights) for kind in KINDS}

    @property
    def accused(self) -> tuple[WatchedFlight, ...]:
        """Flights whose poses were accused."""
        return tuple(one for one in self.flights if one.accused)

    def above(self, share: float) -> int:
        """How many flights had a statistic above ``share`` of what convicts."""
        return sum(max(one.largest.values()) > share for one in self.flights)


class _Trace:
    """The evidence window by window, as a flight goes on."""

    def __init__(self) -> None:
        self.windows: list[tuple[float, PoseEvidence]] = []
        """The instant [s, event loop's clock] and what spoke against the poses."""

    async def watch(self, flight: Flight) -> None:
        """Look at each window for as long as commands leave: a vehicle that comes down on the model obeys none."""
        loop, seen = asyncio.get_running_loop(), 0
        while flight.state not in FINAL:
            if flight.monitor.windows != seen:
                seen = flight.monitor.windows
                self.windows.append((loop.time(), flight.evidence))
            await asyncio.sleep(LOOK_S)


def watch_flight(
    scenario: str, seed: int, *, overrides: Sequence[str] = (), source: str = "vicon", link: str = "mavlink",
    figure_s: float,
) -> WatchedFlight:  # fmt: skip
    """Fly ``scenario`` from the floor, its figure for ``figure_s`` [s], and back, with the monitor armed."""
    world, config = prepare(SCENARIOS[scenario], list(overrides), source=source, link=link)
    world, config = from_floor(world, config, figure_s)
    trace, said, flights = _Trace(), list[Notice](), list[Flight]()

    async def script(flight: Flight, stage: Stage) -> None:
        flights.append(flight)
        await trace.watch(flight)

    flown = fly_mission(world, config, seed=seed, on_event=said.append, script=script)
    evidence = [each for _, each in trace.windows]
    charge = flights[0].charge
    accusation = charge.reason if charge is not None and charge.accuses else None
    accused = [one.says for one in said if one.kind == "suspicion" or one.text == accusation]
    why = flown.fault or flown.why
    return _sum_up(
        seed, flights[0].monitor.windows, evidence, accused,
        landed=flown.landed, why=why, ended_by_poses=why == accusation,
    )  # fmt: skip


def _sum_up(
    seed: int, windows: int, evidence: Sequence[PoseEvidence], accused: Sequence[str], *, landed: bool, why: str,
    ended_by_poses: bool,
) -> WatchedFlight:  # fmt: skip
    """One flight by the evidence of each of its windows."""
    evidence = evidence or [PoseEvidence(0.0, 0.0, 0.0, 0.0)]
    largest = {kind: max(getattr(each, kind) for each in evidence) for kind in KINDS}
    passed = tuple(sum(max(each) >= share for each in evidence) for share in SHARES)
    return WatchedFlight(
        seed=seed,
        windows=windows,
        largest=largest,
        passed=passed,
        accused=tuple(accused),
        landed=landed,
        why=why,
        ended_by_poses=ended_by_poses,
    )


def watch_all(
    scenario: str, seeds: Sequence[int], *, overrides: Sequence[str] = (), source: str = "vicon",
    link: str = "mavlink", figure_s: float, workers: int, on_done: Callable[[int], None] = lambda count: None,
) -> Alarms:  # fmt: skip
    """Fly ``scenario`` with each of ``seeds``; ``on_done`` hears how many are flown."""
    fly = partial(watch_flight, scenario, overrides=tuple(overrides), source=source, link=link, figure_s=figure_s)
    found: dict[int, WatchedFlight] = {}

    def take(each: Iterable[WatchedFlight]) -> None:
        for one in each:
            found[one.seed] = one
            on_done(len(found))

    if workers <= 1 or len(seeds) <= 1:
        take(map(fly, seeds))
    else:
        with Workers(min(workers, len(seeds))) as pool:
            take(job.result() for job in cf.as_completed([pool.submit(fly, seed) for seed in seeds]))
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
    hold = [_strike(seed, "trajectory.kind=hold") for seed in range(strikes)]
    tracking = [_strike(seed) for seed in range(strikes)]
    return tuple(
        Detection(
            share=share,
            hold_s=tuple(_reach_time(trace, share) for trace in hold),
            tracking_s=tuple(_reach_time(trace, share) for trace in tracking),
        )
        for share in SHARES
    )


def _strike(seed: int, *overrides: str) -> list[tuple[float, PoseEvidence]]:
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


def _reach_time(trace: list[tuple[float, PoseEvidence]], share: float) -> float | None:
    return next((since_s for since_s, each in trace if max(each) >= share), None)


CURVE = ("paper", "adverse", "storm")
"""True flights that the curve counts false alarms in."""


def alarms(args: argparse.Namespace) -> Exit:
    """Fly true flights from the floor, or take recorded ones, and see how near they came to an accusation."""
    if args.capture is not None:
        return _judge_capture(args)
    if args.curve and args.scenario is not None:
        raise ConfigError("--scenario", f"--curve flies {', '.join(CURVE)}")
    if args.write is not None:
        if not args.curve:
            raise ConfigError("--write", "only the table of --curve is written")
        split_at_markers(args.write)
    names = CURVE if args.curve else (args.scenario or "adverse",)
    for name in names:  # what can't be flown is told before anything is
        world, config = prepare(scenario_of(name), args.overrides, source=args.source, link=args.link)
        ensure_flyable(from_floor(world, config, args.duration)[1])
    found = dict[str, Alarms]()
    for name in names:
        with ProgressBar(f"flights of {name}", args.flights, quiet=args.json) as counter:
            found[name] = watch_all(
                name, range(args.seed, args.seed + args.flights), overrides=args.overrides, source=args.source,
                link=args.link, figure_s=args.duration, workers=args.workers or os.cpu_count() or 1,
                on_done=counter.at,
            )  # fmt: skip
    if args.curve:
        curve = detections()
        table = markdown(curve, found)
        print(json.dumps(_curve_facts(curve, found)) if args.json else table)
        if args.write is not None:
            words = [word for word in sys.argv[1:] if word != "--json"]
            made = f"Made by `{shlex.join(['groundstation-sim', *words])}`."
            replace_between_markers(args.write, f"{table} {made}")
    else:
        ((name, one),) = found.items()
        print(json.dumps(facts(name, one)) if args.json else text(name, one))
    return Exit.FAILED if any(one.accused for one in found.values()) else Exit.DONE


def _judge_capture(args: argparse.Namespace) -> Exit:

    for option, given in (("--scenario", args.scenario), ("--curve", args.curve or None), ("--write", args.write)):
        if given is not None:
            raise ConfigError(option, "--capture looks at one recording, and flies nothing")
    found = watch_capture(args.capture, args.overrides)
    name = str(args.capture)
    print(json.dumps(facts(name, found)) if args.json else text(name, found, "recorded flights"))
    return Exit.FAILED if found.accused else Exit.DONE


def facts(scenario: str, found: Alarms) -> dict[str, object]:
    """Figures of ``found``; ``flights`` has every one of them."""
    return {
        "scenario": scenario,
        "windows": found.windows,
        "largest": found.largest,
        "above": {f"{share:g}": found.above(share) for share in REMARKABLE},
        "accused": len(found.accused),
        "flights": msgspec.to_builtins(found.flights),
    }


def text(scenario: str, found: Alarms, flights: str = "flights from the floor") -> str:
    """The same as lines of text."""
    largest = ", ".join(f"{kind} {found.largest[kind]:.2f}" for kind in KINDS)
    lines = [
        f"{scenario}: {len(found.flights)} {flights}, {found.windows} windows looked at",
        f"largest statistic, as a share of what convicts: {largest}",
        *(f"above {share:g}: {found.above(share)} flights" for share in REMARKABLE),
        f"poses accused: {len(found.accused)} flights",
    ]
    for one in found.flights:
        lines += [f"seed {one.seed}: {said}" for said in one.accused]
        if not one.landed:
            lines.append(f"seed {one.seed}: did not land as planned: {one.why}")
    return "\n".join(lines)


def markdown(curve: tuple[Detection, ...], found: dict[str, Alarms]) -> str:
    """The curve as a table."""
    hold, tracking = len(curve[0].hold_s), len(curve[0].tracking_s)
    lines = [
        "| threshold | seen in a calm hold after | seen on the figure after | "
        + " | ".join(f"true windows beyond, `{name}`" for name in found)
        + " |",
        "|---:|" + "---:|" * (2 + len(found)),
    ]
    for row, one in enumerate(curve):
        cells = [f"{one.share:g}", _times(one.hold_s), _times(one.tracking_s)]
        cells += [_share(sum(each.passed[row] for each in some.flights), some.windows) for some in found.values()]
        lines.append("| " + " | ".join(cells) + " |")
    windows = ", ".join(f"{some.windows} in {len(some.flights)} of `{name}`" for name, some in found.items())
    says = f"Medians of {hold} and {tracking} strikes, the worst in brackets; windows of true flights: {windows}."
    return "\n".join([*lines, "", says])


def _times(times: tuple[float | None, ...]) -> str:
    if None in times:
        return f"not in {sum(each is None for each in times)} of {len(times)}"
    found = [each for each in times if each is not None]
    return f"{median(found):.2f} ({max(found):.2f}) s"


def _share(count: int, of: int) -> str:
    return "none" if count == 0 else f"{100.0 * count / of:.2g} %"


def _curve_facts(curve: tuple[Detection, ...], found: dict[str, Alarms]) -> dict[str, object]:
    return {
        "shares": SHARES,
        "detections": msgspec.to_builtins(curve),
        "flown": [facts(name, one) for name, one in found.items()],
    }


BEFORE_S, STOOD_S = 10.0, 1.0
"""From so long before a flight on its poses and set-points are heard, and in the last of that it stood where its floor
is [s]."""


class _Obeying(Pilot):
    """A pilot whose commands somebody else has chosen."""

    def obey(self, time_s: float, drive: ActuatorCommand, interval_s: float) -> None:
        """``drive`` left at ``time_s`` [s], so long after the one before."""
        self._send(time_s, drive)
        self._mean_wind(self._estimator.disturbance, interval_s)


def watch_capture(file: Path, overrides: Sequence[str]) -> Alarms:
    """Each flight in ``file`` (a .tlog), by its number.

    Raises:
        ConfigError: the file can't be read, or holds no poses, or no flight on set-points of rates and thrust.
    """
    opened = open_recording(file, None, overrides)
    if opened.hover is None:
        missing = "nothing in it flies on SET_ATTITUDE_TARGET with rates and thrust (type_mask 128)"
        raise ConfigError("", f"{missing}: the monitor has no commands to hold its poses against", str(file))
    flags = [bool(flag) for flag in flying(opened.recording, opened.shares, opened.hover)]
    bounds = [i for i in range(len(flags)) if flags[i] != (i > 0 and flags[i - 1])] + [len(flags)]
    flights = [
        _fly_capture(number, opened, begin, end)
        for number, (begin, end) in enumerate(zip(bounds[::2], bounds[1::2], strict=False))
    ]
    return Alarms(flights=tuple(flights))


def _fly_capture(number: int, opened: OpenedRecording, begin: int, end: int) -> WatchedFlight:
    """The flight of the poses from ``begin`` to before ``end``."""
    config, recording, shares = opened.config, opened.recording, opened.shares
    poses = [seen.pose for seen in recording.poses]
    lifts_s, ends_s = poses[begin].arrival_s, poses[end - 1].arrival_s
    from_s, full_n = lifts_s - BEFORE_S, config.full_thrust_n
    stood = [pose.position_ned[2] for pose in poses[:begin] if pose.arrival_s >= lifts_s - STOOD_S]
    floor_z_m = mean(stood) if stood else math.inf  # a recording may begin in the air
    pilot = _Obeying(config.vehicle, config.controller, config.flight.coast_s, floor_z_m)
    conviction, said, evidence = Conviction(), list[str](), list[PoseEvidence]()
    windows, ended, lifted, last_s = 0, "", False, from_s
    pilot.stand()
    events = [(pose.arrival_s, 0, i) for i, pose in enumerate(poses)]
    events += [(sent.time_s, 1, i) for i, sent in enumerate(recording.sent)]
    for time_s, is_sent, index in sorted(event for event in events if from_s <= event[0] <= ends_s):
        if not is_sent:
            pilot.pose(poses[index])
            if not lifted and index >= begin and floor_z_m - poses[index].position_ned[2] > WANDERING_M:
                lifted = True
                pilot.lift(time_s, 1.0, -(poses[index].velocity_ned or (0.0, 0.0, 0.0))[2])
            if pilot.monitor.windows != windows:
                windows = pilot.monitor.windows
                evidence.append(pilot.evidence)
            continue
        if pilot.newest_pose is None:
            continue
        pilot.obey(time_s, ActuatorCommand(full_n * shares[index], recording.sent[index].rates), time_s - last_s)
        last_s = time_s
        looked = conviction.look(pilot.evidence, time_s, led=pilot.monitor.is_led(time_s))
        if conviction.says and pilot.evidence.suspicious:
            said.append(f"{time_s:.1f} s: {conviction.says}")
        charge = charge_lateness(pilot.monitor.late_s) or looked
        if charge is not None:
            ended = charge.reason
            said.append(f"{time_s:.1f} s: {ended}")
            break
    why = ended or f"recorded from {lifts_s:.1f} to {ends_s:.1f} s"
    return _sum_up(number, windows, evidence, said, landed=not ended, why=why, ended_by_poses=bool(ended))
