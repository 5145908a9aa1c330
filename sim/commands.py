"""What each ``groundstation-sim`` command does."""

import argparse
import asyncio
import json
import os
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from groundstation.config import ConfigError, from_dict
from groundstation.preflight import ensure_flyable
from groundstation.settings import Config
from sim.scenarios import SCENARIOS, Scenario
from sim.world import World

if TYPE_CHECKING:
    from sim.run_folder import RunFolder

DURATION_S = 60.0
"""How long a flight lasts if nobody says."""


class _Overridden(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """So that errors about the truth name their keys as ``sim.…``."""

    sim: World


def _scenario(name: str) -> Scenario:
    if name not in SCENARIOS:
        raise ConfigError("--scenario", f"expected one of {sorted(SCENARIOS)}, got {name!r}")
    return SCENARIOS[name]


def prepare(
    scenario: Scenario,
    overrides: list[str],
    *,
    controller: str | None = None,
    source: str = "vicon",
    link: str = "mavlink",
) -> tuple[World, Config]:
    """The truth and the configuration of ``scenario`` after ``--set``: ``sim.…`` is truth, all else is told.

    Raises:
        ConfigError: an unknown key or a bad value, by its dotted key.
    """
    truth, told = _sorted(overrides, controller)
    world = _overridden(scenario.world, truth)
    return world, _on_udp(scenario.config(world, told, source, link))


def prepare_own(
    scenario: Scenario, path: Path, overrides: list[str], *, controller: str | None = None
) -> tuple[World, Config, float | None]:
    """The same for a configuration file: its vehicle in the air of ``scenario``; and how long it wants to fly [s].

    Raises:
        ConfigError: as :func:`prepare`.
    """
    from sim.own import own

    truth, told = _sorted(overrides, controller)
    return own(scenario.world, path, told, lambda world: _overridden(world, truth))


def _sorted(overrides: list[str], controller: str | None) -> tuple[list[str], list[str]]:
    """Overrides of the truth, and of what is told."""
    told = [o for o in overrides if not o.startswith("sim.")]
    if controller is not None:
        told.append(f"controller.kind={controller}")
    return [o for o in overrides if o.startswith("sim.")], told


def _overridden(world: World, truth: list[str]) -> World:
    return from_dict({"sim": msgspec.to_builtins(world)}, _Overridden, truth).sim


def _on_udp(config: Config) -> Config:
    """``config``, where its link is one that the simulated network has."""
    for key in ("tcp", "serial"):
        if getattr(config.link, key, None) is not None:
            raise ConfigError(f"link.{key}", "the simulated network is UDP: leave this out, or use listen")
    return config


def fly(args: argparse.Namespace) -> int:
    """Fly one scenario in virtual time."""
    from sim.console import Progress, summary
    from sim.fly import fly as fly_scenario

    scenario = _scenario(args.scenario)
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
    folder = _run_folder(args.out, config, world, scenario=name, seed=args.seed) if args.out is not None else None
    progress = Progress(duration_s, quiet=args.json or not sys.stderr.isatty())
    with progress:
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


def _run_folder(path: Path, config: Config, world: World, *, scenario: str, seed: int) -> "RunFolder":
    from sim.run_folder import RunFolder  # what records is imported only where something is

    return RunFolder(path, config, world, scenario=scenario, seed=seed)


def mission(args: argparse.Namespace) -> int:
    """Fly one scenario from the floor to its figure and back, in virtual time."""
    from sim.mission import fly_mission, from_floor
    from sim.mission_command import facts, summary

    scenario = _scenario(args.scenario)
    world, config = prepare(scenario, args.overrides, controller=args.controller, source=args.source, link=args.link)
    world, config = from_floor(world, config, args.duration or DURATION_S)
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
    print(json.dumps(facts(asked, flown)) if args.json else summary(title, flown))
    return 0 if flown.landed else 1


def faults(args: argparse.Namespace) -> int:
    """Break one thing in every state of a mission."""
    from sim.console import Counter
    from sim.deck.deal import cells, fly_all, quick
    from sim.deck.faults import FAULTS
    from sim.deck.moments import MOMENTS
    from sim.deck.table import text, write

    _scenario(args.scenario)
    for option, value, known in (("--fault", args.fault, FAULTS), ("--state", args.state, MOMENTS)):
        if value is not None and value not in known:
            raise ConfigError(option, f"expected one of {list(known)}, got {value!r}")
    work = cells(args.fault, args.state)
    if args.quick:
        work = [cell for cell in quick() if cell in work]
    if not work:
        raise ConfigError("--state", f"{args.fault} is not flown there" + (" with --quick" if args.quick else ""))
    with Counter("cells", len(work), quiet=args.json or not sys.stderr.isatty()) as counter:
        rows = fly_all(
            work,
            seed=args.seed,
            scenario=args.scenario,
            overrides=args.overrides,
            workers=args.workers or os.cpu_count() or 1,
            on_done=counter.at,
        )
    if args.write is not None:
        words = [word for word in sys.argv[1:] if word != "--json"]
        write(args.write, rows, shlex.join(["groundstation-sim", *words]))
    print(json.dumps({"rows": msgspec.to_builtins(rows)}) if args.json else text(rows))
    return 0 if all(row.safe for row in rows) else 1


def soak(args: argparse.Namespace) -> int:
    """Fly for hours, and see whether anything grows."""
    from sim.console import Progress
    from sim.soak import soak as fly_on
    from sim.soak import text

    _scenario(args.scenario)
    with Progress(args.hours, quiet=args.json or not sys.stderr.isatty(), unit="h") as progress:
        facts = fly_on(args.hours, scenario=args.scenario, seed=args.seed, on_progress=progress.at)
    print(json.dumps(msgspec.to_builtins(facts)) if args.json else text(facts))
    return 0 if facts.passed else 1


def _missions(args: argparse.Namespace, name: str, world: World, config: Config) -> int:
    """Several missions side by side."""
    from sim.mission_command import fleet_facts, fleet_summary

    if args.real_time:
        from sim.fleet_real import fly_fleet_real

        config = _paced_by_poses(config)
        say = None if args.json else print
        flown = fly_fleet_real(world, config, args.vehicles, seed=args.seed, autopilot=args.autopilot, say=say)
    else:
        from sim.fleet_mission import fly_fleet

        flown = fly_fleet(world, config, args.vehicles, seed=args.seed, autopilot=args.autopilot)
    asked = {"scenario": name, "seed": args.seed, "source": args.source, "real_time": args.real_time}
    title = f"{name}, {args.vehicles} vehicles, poses by {args.source}, seed {args.seed}"
    print(json.dumps(fleet_facts(asked, flown)) if args.json else fleet_summary(title, flown))
    return 0 if flown.landed else 1


def _paced_by_poses(config: Config) -> Config:
    """``config`` with a link that sends as poses come, as a MAVLink link does where nobody says otherwise."""
    from links.mavlink import MavlinkLinkConfig

    if not isinstance(config.link, MavlinkLinkConfig):
        return config
    return msgspec.structs.replace(config, link=msgspec.structs.replace(config.link, pace="poses"))


def _thrust_bound(config: Config, v_start: float | None) -> float | None:
    """The paper's a-priori bound on T/m [m/s²] for this flight; None for a controller without such a theory."""
    from groundstation.control.certificate import acceleration_sup, thrust_bound
    from groundstation.control.gains import Law

    if v_start is None or not isinstance(config.controller, Law):
        return None
    reference = config.trajectory.build()
    accelerations = [reference.at(0.01 * i).acceleration_ned for i in range(6000)]
    return thrust_bound(config.controller, acceleration_sup=acceleration_sup(accelerations), v_start=v_start).bound


def compare(args: argparse.Namespace) -> int:
    """Fly controllers side by side."""
    from groundstation.control.controllers import make_controller
    from sim.compare import CONTROLLERS, cases, fly_all, rows
    from sim.compare_plot import check_plot, plot
    from sim.compare_table import check_markers, text_table, write_between_markers
    from sim.console import Counter
    from sim.referee import STEADY_S

    if args.duration <= STEADY_S + 1.0:
        raise ConfigError(
            "--duration", f"expected more than {STEADY_S + 1:g} s, as figures are taken from {STEADY_S:g} s"
        )
    for name in args.scenarios or ():
        if name not in SCENARIOS:
            raise ConfigError("--scenarios", f"expected some of {sorted(SCENARIOS)}, got {name!r}")
    work = cases(args.scenarios or SCENARIOS, args.controllers or CONTROLLERS, args.overrides)
    for case in work:  # what can't fly says so before anything flies
        _, config = prepare(SCENARIOS[case.scenario], list(case.overrides))
        make_controller(config.controller, config.vehicle)
    if args.plot is not None:
        check_plot(args.plot)
    if args.write is not None:
        check_markers(args.write)
    with Counter("flights", len(work) * args.seeds, quiet=args.json or not sys.stderr.isatty()) as counter:
        flights = fly_all(
            work,
            args.seeds,
            args.duration,
            workers=args.workers or os.cpu_count() or 1,
            traced=args.plot is not None,
            on_done=counter.at,
        )
    table = rows(flights)
    if args.plot is not None:
        plot(args.plot, table, flights)
    if args.write is not None:
        write_between_markers(args.write, table, _comparison(args))
    print(json.dumps({"rows": msgspec.to_builtins(table)}) if args.json else text_table(table))
    return 0


def _comparison(args: argparse.Namespace) -> str:
    """The command that makes this comparison's table, and its picture, again in the folder of ``--write``."""
    words = ["groundstation-sim", "compare"]
    for option in ("scenarios", "controllers"):
        names = getattr(args, option)
        words += [f"--{option}", ",".join(names)] if names else []
    words += ["--seeds", str(args.seeds)]
    words += ["--duration", f"{args.duration:g}"] if args.duration != 60.0 else []
    for override in args.overrides:
        words += ["--set", override]
    if args.plot is not None:
        plot = os.path.relpath(args.plot.absolute(), args.write.absolute().parent)
        words += ["--plot", Path(plot).as_posix()]
    return shlex.join([*words, "--write", args.write.name])


def campaign(args: argparse.Namespace) -> int:
    """Fly one scenario many times, in drawn worlds."""
    from sim.campaign_command import campaign as fly_campaign

    scenario = _scenario(args.scenario)
    world, config = prepare(scenario, args.overrides)
    return fly_campaign(args, scenario.name, world, config)


def bench(args: argparse.Namespace) -> int:
    """Measure this machine."""
    from sim.bench import WHAT, Options, measured, text

    for name in args.what:
        if name not in WHAT:
            raise ConfigError("bench", f"expected some of {list(WHAT)}, got {name!r}")
    facts = measured(args.what or list(WHAT), Options(peers=args.peers, hours=args.hours, seconds=args.seconds))
    if args.json and args.what == ["links"]:
        facts |= facts.pop("links")
    print(json.dumps(facts) if args.json else text(facts))
    return 0


def bring_down(args: argparse.Namespace) -> int:
    """Cut flights short, and tell how the bring-down ends."""
    from sim.compare_table import check_markers, put_between_markers
    from sim.cut import cut_all, markdown

    for name in args.scenarios:
        _scenario(name)
    if args.write is not None:
        check_markers(args.write)
    table = markdown(cut_all(args.scenarios, args.flights))
    print(table)
    if args.write is not None:
        command = f"groundstation-sim bring-down --flights {args.flights} --write {args.write.name}"
        made = f"{args.flights} flights each: medians, the worst in brackets. Made by `{command}`."
        put_between_markers(args.write, f"{table}\n\n{made}")
    return 0


def tune(args: argparse.Namespace) -> int:
    """Search for better gains, or say how wrong the world may be with those there are."""
    from sim.tune_command import report, search

    return report(args) if args.report else search(args)


def scenarios(args: argparse.Namespace) -> int:
    """List the scenarios."""
    rows: dict[str, dict[str, Any]] = {
        name: {
            "summary": s.summary,
            "sim": msgspec.to_builtins(s.world),
            "told": {"vehicle": msgspec.to_builtins(s.told), "pose_latency_s": s.told_latency_s},
        }
        for name, s in SCENARIOS.items()
    }
    if args.json:
        print(json.dumps(rows))
        return 0
    for name, row in rows.items():
        print(f"{name}: {row['summary']}")
        for section in ("sim", "told"):
            for key, value in row[section].items():
                print(f"    {section}.{key} = {value}")
    return 0


def check_vectors(args: argparse.Namespace) -> int:
    """Evaluate the law on test vectors."""
    from sim.vectors import LIMIT, worst_disagreement

    try:
        worst, count = worst_disagreement(args.file)
    except (OSError, ValueError) as error:
        raise ConfigError("", str(error)) from None
    print(f"{count} vectors, largest |a - e| / max(1, |e|) = {worst:.3g} (limit {LIMIT:g})")
    return 0 if worst <= LIMIT else 1


def fuzz(args: argparse.Namespace) -> int:
    """Feed decoders random and damaged bytes."""
    from sim.fuzz import fuzz_all, text
    from sim.fuzz_links import LINKS
    from sim.fuzz_subjects import SOURCES, Subject

    chosen: dict[str, Callable[[], Subject]] = {}
    for option, table in (("source", SOURCES), ("link", LINKS)):
        name = getattr(args, option)
        if name is not None and not any(key.split()[0] == name for key in table):
            raise ConfigError(
                f"--{option}", f"expected one of {sorted({key.split()[0] for key in table})}, got {name!r}"
            )
        if name is not None or (args.source is None and args.link is None):
            chosen |= {key: make for key, make in table.items() if name in (None, key.split()[0])}
    total = fuzz_all(chosen, args.count, args.seed)
    print(json.dumps(msgspec.to_builtins(total)) if args.json else text(total))
    return 0 if total.exceptions == 0 and total.mismatches == 0 else 1


def reference(args: argparse.Namespace) -> int:
    """Print or write the pages of docs/reference that are made from the code."""
    from sim.reference import reference_command

    print(reference_command(args.write))
    return 0


def serve(args: argparse.Namespace) -> int:
    """Run the simulated side in real time."""
    from sim.serve import serve as serve_stage
    from sim.serve import serve_fleet

    scenario = _scenario(args.scenario)
    if args.fleet is not None:
        from groundstation.fleet.plan import read_fleet

        truth, told = _sorted(args.overrides, None)
        world, fleet = _overridden(scenario.world, truth), read_fleet(args.fleet, told)
        served = serve_fleet(world, fleet, seed=args.seed, duration_s=args.duration, autopilot=args.autopilot)
        return asyncio.run(served)
    world, config = prepare(scenario, args.overrides, source=args.source, link=args.link)
    if args.floor:
        from sim.mission import from_floor

        world, config = from_floor(world, config, None)
    return asyncio.run(
        serve_stage(
            scenario.name,
            world,
            config,
            seed=args.seed,
            duration_s=args.duration,
            autopilot=args.autopilot,
            parameters=_parameters(args.autopilot, args.parameters),
        )
    )


def _parameters(autopilot: str, texts: list[str]) -> dict[str, float]:
    """``NAME=VALUE`` for each of the ``autopilot``'s parameters that differs.

    Raises:
        ConfigError: it has no such parameter, or the value is none.
    """
    from sim.autopilot_parameters import Parameters
    from sim.autopilots import AUTOPILOTS

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
