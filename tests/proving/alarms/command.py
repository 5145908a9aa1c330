"""What ``groundstation-sim alarms`` does: true flights with the monitor armed, or its curve of detection time.

Or the monitor over a recorded flight: its poses and the set-points that were sent, as a flight would. The shadow of
``groundstation replay`` reads the recording, finds where it flew on set-points of rates and thrust, and what carried
it. The poses are the autopilot's own there, so that there is no second witness: in flight it is not asked then either.
"""

import argparse
import json
import math
import os
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from statistics import mean, median

import msgspec

from groundstation.analysis.shadow import (
    FlownPath,
    RecordedVehicle,
    complete_config,
    flying,
    hover_share,
    latency_s,
    load_described,
    mavlink,
    read_recording,
    thrust_shares,
)
from groundstation.config import ConfigError
from groundstation.core import Pilot
from groundstation.core.safety import WANDERING_M, Contradiction, Conviction, charge_lateness
from groundstation.core.vehicle import Drive
from groundstation.flight import ensure_flyable
from groundstation.settings import Config
from sim.cli import Counter
from sim.runs import from_floor
from sim.scenarios import prepare, scenario_of
from sim.studies.compare import check_markers, put_between_markers
from tests.proving.alarms.alarms import KINDS, REMARKABLE, SHARES, Alarms, Detection, Watched, detections, watch_all

CURVE = ("paper", "adverse", "storm")
"""True flights that the curve counts false alarms in."""


def alarms(args: argparse.Namespace) -> int:
    """Fly true flights from the floor, or take recorded ones, and see how near they came to an accusation."""
    if args.capture is not None:
        return _captured(args)
    if args.curve and args.scenario is not None:
        raise ConfigError("--scenario", f"--curve flies {', '.join(CURVE)}")
    if args.write is not None:
        if not args.curve:
            raise ConfigError("--write", "only the table of --curve is written")
        check_markers(args.write)
    names = CURVE if args.curve else (args.scenario or "adverse",)
    for name in names:  # what can't be flown is told before anything is
        world, config = prepare(scenario_of(name), args.overrides, source=args.source, link=args.link)
        ensure_flyable(from_floor(world, config, args.duration)[1])
    found = dict[str, Alarms]()
    quiet = args.json or not sys.stderr.isatty()
    for name in names:
        with Counter(f"flights of {name}", args.flights, quiet=quiet) as counter:
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
            put_between_markers(args.write, f"{table} {made}")
    else:
        ((name, one),) = found.items()
        print(json.dumps(facts(name, one)) if args.json else text(name, one))
    return 1 if any(one.accused for one in found.values()) else 0


def _captured(args: argparse.Namespace) -> int:

    for option, given in (("--scenario", args.scenario), ("--curve", args.curve or None), ("--write", args.write)):
        if given is not None:
            raise ConfigError(option, "--capture looks at one recording, and flies nothing")
    found = captured(args.capture, args.overrides)
    name = str(args.capture)
    print(json.dumps(facts(name, found)) if args.json else text(name, found, "recorded flights"))
    return 1 if found.accused else 0


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

    def sent(self, time_s: float, drive: Drive, interval_s: float) -> None:
        """``drive`` left at ``time_s`` [s], so long after the one before."""
        acting = time_s + self._vehicle.command_delay_s
        self._send(acting, drive)
        self._mean_wind(self._estimator.disturbance, interval_s)


def captured(file: Path, overrides: Sequence[str]) -> Alarms:
    """Each flight in ``file`` (a .tlog), by its number.

    Raises:
        ConfigError: the file can't be read, or holds no poses, or no flight on set-points of rates and thrust.
    """
    config = load_described(None, overrides)
    recording = read_recording(file, latency_s(config), mavlink(config).target_system)
    path = FlownPath([seen.pose for seen in recording.poses], config.flight.coast_s)
    shares = thrust_shares(recording.sent, config.thrust_curve)
    hover = hover_share(recording, shares, path, config.controller.gravity)
    if hover is None:
        missing = "nothing in it flies on SET_ATTITUDE_TARGET with rates and thrust (type_mask 128)"
        raise ConfigError("", f"{missing}: the monitor has no commands to hold its poses against", str(file))
    config = complete_config(config, None, overrides, recording, hover)
    flags = [bool(flag) for flag in flying(recording, shares, hover)]
    bounds = [i for i in range(len(flags)) if flags[i] != (i > 0 and flags[i - 1])] + [len(flags)]
    flights = [
        _flown(number, recording, shares, config, begin, end)
        for number, (begin, end) in enumerate(zip(bounds[::2], bounds[1::2], strict=False))
    ]
    return Alarms(flights=tuple(flights))


def _flown(
    number: int, recording: RecordedVehicle, shares: list[float], config: Config, begin: int, end: int
) -> Watched:
    """The flight of the poses from ``begin`` to before ``end``."""
    poses = [seen.pose for seen in recording.poses]
    lifts_s, ends_s = poses[begin].arrival_s, poses[end - 1].arrival_s
    from_s, full_n = lifts_s - BEFORE_S, config.full_thrust_n
    stood = [pose.position_ned[2] for pose in poses[:begin] if pose.arrival_s >= lifts_s - STOOD_S]
    floor_z_m = mean(stood) if stood else math.inf  # a recording may begin in the air
    pilot = _Obeying(config.vehicle, config.controller, config.flight.coast_s, floor_z_m)
    conviction, said, evidence = Conviction(), list[str](), list[Contradiction]()
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
        pilot.sent(time_s, Drive(full_n * shares[index], recording.sent[index].rates), time_s - last_s)
        last_s = time_s
        looked = conviction.look(pilot.evidence, time_s, led=pilot.monitor.led(time_s))
        if conviction.says.startswith("suspicion"):
            said.append(f"{time_s:.1f} s: {conviction.says}")
        charge = charge_lateness(pilot.monitor.late_s) or looked
        if charge is not None:
            ended = charge.reason
            said.append(f"{time_s:.1f} s: {ended}")
            break
    evidence = evidence or [Contradiction(0.0, 0.0, 0.0, 0.0)]
    return Watched(
        seed=number,
        windows=windows,
        largest={kind: max(getattr(each, kind) for each in evidence) for kind in KINDS},
        passed=tuple(sum(max(each) >= share for each in evidence) for share in SHARES),
        accused=tuple(said),
        landed=not ended,
        why=ended or f"recorded from {lifts_s:.1f} to {ends_s:.1f} s",
    )
