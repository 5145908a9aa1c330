"""``groundstation-sim fly``, ``mission`` and ``serve``: one flight, whole missions, the simulated side alone.

A flight's folder holds the configuration, the recording (flight.mcap, flight.tlog), the poses as CSV, and the result.
A radio's frames, which leave by no network, are kept as lines of hex. A mission goes from the floor to the figure and
back, with one vehicle or several; told in words or as JSON. ``serve`` runs in real time.
"""

import argparse
import asyncio
import gc
import json
import sys
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import msgspec

from groundstation.config import ConfigError, dump, load, read_toml
from groundstation.core.messages import Pose
from groundstation.flight import ensure_flyable
from groundstation.pose import CSV_COLUMNS, IN_RUN_FOLDER, CsvRow, Recorded, encode_csv
from groundstation.recording import EndRecord, FlightLog, LineRecord, Record, TickRecord, about
from groundstation.settings import Config, rehearse
from links.io import is_loopback, parse_address
from links.mavlink import MavlinkLinkConfig
from sim.radio import MODULE
from sim.runs import STEADY_S, MissionResult
from sim.scenarios import (
    by_side,
    make_mistakes,
    others_of,
    overridden,
    prepare,
    prepare_own,
    scenario_of,
    world_as_told,
)
from sim.world import World

if TYPE_CHECKING:
    from sim.runs import FleetMission

DURATION_S = 60.0
"""How long a flight lasts if nobody says."""
FIGURE_S = 60.0
"""Time on the figure if nobody says."""
FEW_COLLECTIONS = 50_000
"""Garbage is collected when so many more objects were made than dropped."""


def fly(args: argparse.Namespace) -> int:
    """Fly one scenario in virtual time."""
    from sim.cli.console import ProgressBar, summary
    from sim.runs import fly as fly_scenario

    scenario = scenario_of(args.scenario)
    wanted_s: float | None = None
    if args.config is None:
        world, config = prepare(
            scenario, args.overrides, controller=args.controller, source=args.source, link=args.link
        )
    elif args.source != "vicon":
        raise ConfigError("--source", "expected vicon with --config: the simulated cameras see its vehicle")
    elif args.link != "mavlink":
        raise ConfigError("--link", "expected mavlink with --config")
    else:
        world, config, wanted_s = prepare_own(scenario, args.config, args.overrides, controller=args.controller)
    duration_s = args.duration or wanted_s or DURATION_S
    ensure_flyable(config)
    name = scenario.name if args.config is None else f"{args.config.stem} in the air of {scenario.name}"
    folder = RunFolder(args.out, config, world, scenario=name, seed=args.seed) if args.out is not None else None
    progress = ProgressBar("flying", duration_s, quiet=args.json or not sys.stderr.isatty(), unit="s", digits=1)
    with progress, rare_collections(), _keep_on_error(folder):
        result = fly_scenario(
            world,
            config,
            seed=args.seed,
            duration_s=duration_s,
            autopilot=args.autopilot,
            on_datagram=folder.datagram if folder is not None else None,
            on_pose=folder.pose if folder is not None else None,
            give=folder.give if folder is not None else None,
            on_progress=progress.at,
        )
    facts: dict[str, Any] = {
        "scenario": name,
        "seed": args.seed,
        "controller": config.controller.kind,
        "source": args.source,
        "autopilot": args.autopilot,
        "link": args.link,
        "completed": result.completed,
        "why": result.why,
        "duration_s": result.duration_s,
        **msgspec.to_builtins(result.verdict),
        "thrust_bound_m_s2": _thrust_bound(config, result.verdict.lyapunov_start),
        "log_sha256": result.log_sha256,
        "datagrams": result.datagrams,
        "wall_s": result.wall_s,
    }
    if folder is not None:
        folder.close(facts)
    print(json.dumps(facts) if args.json else summary(facts, folder.path if folder is not None else None))
    return 0 if result.completed else 1


@contextmanager
def _keep_on_error(folder: "RunFolder | None") -> Iterator[None]:
    """Have what was recorded kept, where the flight ends in an error."""
    try:
        yield
    except BaseException:
        if folder is not None:
            folder.abandon()
        raise


@contextmanager
def rare_collections() -> Iterator[None]:
    """Have cyclic garbage, of which a flight makes little, collected rarely, and nothing from before looked at."""
    before = gc.get_threshold()
    gc.freeze()
    gc.set_threshold(FEW_COLLECTIONS, *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)
        gc.unfreeze()


def _thrust_bound(config: Config, v_start: float | None) -> float | None:
    """The paper's a-priori bound on T/m [m/s²] for this flight; None for a controller without such a theory."""
    from groundstation.core.control import Law, acceleration_sup, thrust_bound

    if v_start is None or not isinstance(config.controller, Law):
        return None
    reference = config.trajectory.build()
    accelerations = [reference.at(0.01 * i).acceleration_ned for i in range(6000)]
    return thrust_bound(config.controller, acceleration_sup=acceleration_sup(accelerations), v_start=v_start).bound


AT_ONCE = 500
"""So many records are written one after the other, which takes less time than to write each as it comes. A simulation
that is killed loses them: some 2 s of flight, which took it some 50 ms."""
RECORDING, FRAMES = "flight.mcap", "frames.txt"


class RunFolder:
    """Writes one run."""

    def __init__(self, path: Path, config: Config, world: World, *, scenario: str, seed: int) -> None:
        """Make the folder and begin the recording; one that is there already is replaced.

        Raises:
            ConfigError: the folder can't be written.
        """
        self.path = path
        told = about(config, clock="virtual", scenario=scenario, seed=seed, sim=dump(world))
        try:
            path.mkdir(parents=True, exist_ok=True)
            (path / "config.toml").write_text(told.config)
            for name in (RECORDING, "flight.tlog", FRAMES):
                (path / name).unlink(missing_ok=True)
            # Virtual time begins at 0, whenever that is: the same flight gives the same bytes.
            self._log = FlightLog(path / RECORDING, told, epoch_ns=0, tell=_warn)
            self._poses = _open(path / IN_RUN_FOLDER)
            self._frames = None if isinstance(config.link, MavlinkLinkConfig) else _open(path / FRAMES)
        except OSError as error:
            raise ConfigError("--out", f"cannot write {path}: {error.strerror}") from None
        self._poses.write(CSV_COLUMNS + "\n")
        self._world = world
        self._waiting: deque[Record] = deque()
        self._last_s = 0.0
        self._state = "idle"
        self._ended = False

    def give(self, record: Record) -> None:
        """Take one record of the flight."""
        self._waiting.append(record)
        if len(self._waiting) >= AT_ONCE:
            self._write()
        if isinstance(record, TickRecord):
            self._last_s = record.tick.time_s
        elif isinstance(record, LineRecord):
            self._state = record.state
        elif isinstance(record, EndRecord):
            self._ended = True

    def _write(self) -> None:
        """Write what waits. What raises is left out, and the rest is written the next time."""
        while self._waiting:
            self._log.write(self._waiting.popleft())

    def abandon(self) -> None:
        """The simulation ends in an error: keep all that was given, of which the last is what one looks for."""
        self._write()
        self._log.flush()
        self._close_texts()

    def _close_texts(self) -> None:
        for file in (self._poses, self._frames):
            if file is not None:
                file.close()

    def datagram(self, time_s: float, source: tuple[str, int], target: tuple[str, int], data: bytes) -> None:
        """One datagram of the simulated network: a radio's frame is a line of hex."""
        del source
        if target == MODULE and self._frames is not None:
            self._frames.write(f"{time_s:.6f} {data.hex(' ')}\n")

    def pose(self, pose: Pose) -> None:
        """One pose as it came; `pose.kind = "csv"` plays the folder's again."""
        row = CsvRow(pose.time_s, pose.arrival_s, pose.position_ned, pose.attitude)
        self._poses.write(encode_csv(row))

    def close(self, facts: dict[str, Any]) -> None:
        """Write the result and close everything."""
        if not self._ended:  # the simulation has, in the air: that is no end of a mission
            self._waiting.append(EndRecord(self._last_s, self._state, facts["why"]))
        while self._waiting:
            try:
                self._write()
            except Exception as error:  # noqa: BLE001  # a controller of the user's own may put anything into a tick
                _warn(f"WARNING: a part of this flight can't be recorded: {error}")
        self._log.close()
        self._close_texts()
        result = {**facts, "sim": msgspec.to_builtins(self._world)}
        (self.path / "summary.json").write_text(json.dumps(result, indent=2) + "\n")


def _warn(line: str) -> None:
    print(line, file=sys.stderr)


def _open(path: Path) -> TextIO:
    return path.open("w", encoding="utf-8")


def mission(args: argparse.Namespace) -> int:
    """Fly one scenario from the floor to its figure and back, in virtual time."""
    from sim.runs import fly_mission, from_floor

    scenario = scenario_of(args.scenario)
    world, config = prepare(scenario, args.overrides, controller=args.controller, source=args.source, link=args.link)
    world, config = from_floor(world, config, args.duration or FIGURE_S)
    ensure_flyable(config)
    if args.vehicles > 1 or args.real_time:
        return _missions(args, scenario.name, world, config)
    flown = fly_mission(world, config, seed=args.seed, autopilot=args.autopilot)
    asked = {
        "scenario": scenario.name,
        "seed": args.seed,
        "controller": config.controller.kind,
        "source": args.source,
        "link": args.link,
        "autopilot": args.autopilot,
    }
    title = f"{scenario.name}, controller {config.controller.kind}, poses by {args.source}, seed {args.seed}"
    print(json.dumps(asked | msgspec.to_builtins(flown)) if args.json else summarize_mission(title, flown))
    return 0 if flown.landed else 1


def _missions(args: argparse.Namespace, name: str, world: World, config: Config) -> int:
    """Several missions side by side."""
    if args.real_time:
        from sim.runs import fly_fleet_real

        config = _paced_by_poses(config)
        say = None if args.json else print
        flown = fly_fleet_real(world, config, args.vehicles, seed=args.seed, autopilot=args.autopilot, say=say)
    else:
        from sim.runs import fly_fleet

        flown = fly_fleet(world, config, args.vehicles, seed=args.seed, autopilot=args.autopilot)
    asked = {"scenario": name, "seed": args.seed, "source": args.source, "real_time": args.real_time}
    title = f"{name}, {args.vehicles} vehicles, poses by {args.source}, seed {args.seed}"
    print(json.dumps(fleet_facts(asked, flown)) if args.json else fleet_summary(title, flown))
    return 0 if flown.landed else 1


def _paced_by_poses(config: Config) -> Config:
    """``config`` with a link that sends as poses come, as a MAVLink link does where nobody says otherwise."""
    if not isinstance(config.link, MavlinkLinkConfig):
        return config
    return msgspec.structs.replace(config, link=msgspec.structs.replace(config.link, pace="poses"))


def summarize_mission(title: str, mission: MissionResult) -> str:
    """The mission as text."""
    lines = [title if mission.landed else f"{title}\nNOT AS PLANNED: {mission.fault or mission.why}", ""]
    lines += [f"{one.time_s:9.2f} s  {one.state:12} {one.reason}" for one in mission.states]
    lines.append("")
    figure = f" over {mission.figure_s:.0f} s of the figure"
    if mission.rms_cm is None:
        figure = f" (counts from {STEADY_S:.0f} s on the figure: fly a longer one)"
    for label, value, unit, places, more in (
        ("RMS error", mission.rms_cm, "cm", 2, figure),
        ("largest error", mission.max_cm, "cm", 2, ""),
        ("touchdown", mission.touchdown_m_s, "m/s", 2, ""),
        ("from where it took off", 100.0 * mission.home_m, "cm", 1, ""),
        ("largest tilt", mission.tilt_max_deg, "deg", 1, ""),
        ("wall time", mission.wall_s, "s", 2, f" for {mission.duration_s:.0f} s"),
    ):
        shown = "-" if value is None else f"{value:.{places}f} {unit}"
        lines.append(f"{label:24}{shown:>14}{more}")
    return "\n".join(lines)


def fleet_summary(title: str, flown: "FleetMission") -> str:
    """Several missions as text."""
    columns = f"{'':12}{'RMS':>9}{'touchdown':>12}{'tick p50':>11}{'p99':>10}{'compute p99':>13}{'round p99':>12}"
    lines = [title if flown.landed else f"{title}\nNOT AS PLANNED", "", columns]
    for one in flown.vehicles:
        lines.append(
            f"{one.name:12}{_format(one.rms_cm, 'cm'):>9}{_format(one.touchdown_m_s, 'm/s'):>12}"
            f"{_format(one.tick_p50_ms, 'ms'):>11}{_format(one.tick_p99_ms, 'ms'):>10}"
            f"{_format(one.compute_p99_ms, 'ms'):>13}{_format(one.round_p99_ms, 'ms'):>12}"
            + ("" if one.landed else f"  {one.why}")
        )
    lines.append("")
    if flown.nearest is not None:
        a, b = flown.nearest.between
        lines.append(f"nearest     {flown.nearest.distance_m:.2f} m, {a} and {b}, at {flown.nearest.time_s:.1f} s")
    load = "" if flown.load is None else f", load average {flown.load[0]:.1f}"
    lines.append(f"wall time   {flown.wall_s:.1f} s for {flown.duration_s:.0f} s{load}")
    return "\n".join(lines)


def _format(value: float | None, unit: str) -> str:
    return "–" if value is None else f"{value:.2f} {unit}"


def fleet_facts(asked: dict[str, Any], flown: "FleetMission") -> dict[str, Any]:
    """The missions as one JSON object: what was asked, what came of it."""
    ticks = [one.tick_p99_ms for one in flown.vehicles if one.tick_p99_ms is not None]
    return {
        **asked,
        "landed": flown.landed,
        "tick_p99_ms": max(ticks, default=None),
        "min_separation_m": None if flown.nearest is None else flown.nearest.distance_m,
        **msgspec.to_builtins(flown),
    }


def serve(args: argparse.Namespace) -> int:
    """Run the simulated side in real time."""
    from sim.runs import place_fleet, serve_fleet
    from sim.runs import serve as serve_stage

    scenario = scenario_of(args.scenario)
    if args.gcs is not None and not is_loopback(parse_gcs(args.gcs)):
        raise ConfigError("--gcs", f"expected an address of this machine, such as 127.0.0.1:14550, got {args.gcs}")
    common: dict[str, Any] = {"seed": args.seed, "duration_s": args.duration, "autopilot": args.autopilot}
    if args.wrong and args.config is None:
        raise ConfigError("--wrong", "expected --config FILE.toml beside it: what is wrong is against a file")
    if args.fleet is not None:
        from groundstation.lab import read_fleet

        truth, told = by_side(args.overrides, None)
        labs = [member.lab for member in read_fleet(args.fleet, told).members]
        return asyncio.run(serve_fleet(place_fleet(overridden(scenario.world, truth), labs), labs, **common))
    common["parameters"] = _parameters(args.autopilot, args.parameters)
    if args.config is not None:
        return _serve_room(args, scenario.world, common)
    world, config = prepare(scenario, args.overrides, source=args.source, link=args.link)
    if args.floor:
        from sim.runs import from_floor

        world, config = from_floor(world, config, None)
    return asyncio.run(serve_stage(scenario.name, world, config, second=args.gcs, **common))


def parse_gcs(text: str) -> str:
    """The host of ``--gcs``.

    Raises:
        ConfigError: it is no address.
    """
    try:
        return parse_address(text)[0]
    except ValueError as error:
        raise ConfigError("--gcs", str(error)) from None


def _serve_room(args: argparse.Namespace, air: World, common: dict[str, Any]) -> int:
    """The other side of a configuration, or of a fleet file, for ``--rehearse``."""
    from groundstation.lab import read_fleet
    from sim.runs import serve as serve_stage
    from sim.runs import serve_fleet

    truth, told = by_side(args.overrides, None)
    if "vehicles" in read_toml(args.config):
        labs = [member.lab for member in read_fleet(args.config, told, rehearsed=True).members]
        made = [make_mistakes(world_as_told(air, lab, truth), lab, args.wrong) for lab in labs]
        del common["parameters"]
        return asyncio.run(serve_fleet([world for world, _ in made], [room for _, room in made], **common))
    config = rehearse(load(args.config, Config, told), args.config)
    if isinstance(config.pose, Recorded):
        raise ConfigError("pose.kind", "a recording is played by the ground station itself", str(args.config))
    world, room = make_mistakes(world_as_told(air, config, truth), config, args.wrong)
    more = {"standing": others_of(config), "second": args.gcs, "carried": args.carried}
    return asyncio.run(serve_stage(f"{args.config} for --rehearse", world, room, **more, **common))


def _parameters(autopilot: str, texts: list[str]) -> dict[str, float]:
    """``NAME=VALUE`` for each of the ``autopilot``'s parameters that differs.

    Raises:
        ConfigError: it has no such parameter, or the value is none.
    """
    from sim.autopilots import AUTOPILOTS, Parameters

    made = AUTOPILOTS[autopilot]
    parameters: dict[str, float] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals:
            raise ConfigError("--param", f"expected NAME=VALUE, got {text!r}")
        try:
            parameters[name] = float(value)
            Parameters(made.kind, made.table, parameters)
        except KeyError:
            raise ConfigError("--param", f"expected one of {sorted(made.table)}, got {name!r}") from None
        except ValueError as error:
            raise ConfigError("--param", f"{text}: {error}") from None
    return parameters
