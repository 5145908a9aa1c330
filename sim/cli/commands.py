"""Commands of ``groundstation-sim``: each calls the room that does the work, and prints the result
as text or JSON.

``fly`` flies one flight in the air. ``mission`` flies from the floor to the trajectory and back,
with one vehicle or several. ``serve`` runs the simulated side alone, in real time, for a ground
station in another process.
"""

import argparse
import asyncio
import json
import sys
import textwrap
from collections.abc import Iterable
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from importlib import import_module
from pathlib import Path
from time import perf_counter  # noqa: TID251  # how long it took is for people; no flight sees it
from typing import Any

import msgspec

from groundstation.config import (
    ConfigError,
    keys_of,
    load,
    read_toml,
    refuse_io,
    refuse_value,
)
from groundstation.core.messages import STEADY_S
from groundstation.flight.preflight import ensure_flyable
from groundstation.interfaces.cli import advise_name, completion_script, words_of_flying
from groundstation.lab import read_fleet
from groundstation.machine import fill_markers, replace_between_markers
from groundstation.runtime import Exit, require_package
from groundstation.settings import Config, rehearse
from sim.cli import ProgressBar, summary, typed_command
from sim.runs import (
    DURATION_S,
    FleetMission,
    Flyers,
    MissionResult,
    Run,
    fly_fleet,
    fly_mission,
    from_floor,
    serve as serve_stage,
    serve_fleet,
    simulate,
)
from sim.scenarios import (
    BETAFLIGHT,
    SCENARIOS,
    choose_scenario,
    find_scenario,
    make_configured_world,
    place_others,
    prepare,
    split_overrides,
)
from sim.text import notice
from sim.world import World

__all__ = ["advise_name"]  # called by groundstation.runtime, as in the commands of groundstation


def load_proving(command: str, module: str) -> Any:
    """Load ``module`` of tests/proving for ``command``. The wheel does not contain it.

    Raises:
        ConfigError: only the wheel is installed.
    """
    if not (Path(__file__).parents[2] / "tests" / "proving").is_dir():
        raise ConfigError(command, notice("dev.no_checkout"))
    return import_module(f"tests.proving.{module}")


def _prove(command: str, module: str, args: argparse.Namespace) -> int:
    """Run the function ``command`` of ``module`` of tests/proving."""
    return int(getattr(load_proving(command, module), command)(args))


bench = partial(_prove, "bench", "bench.links")
dev_faults = partial(_prove, "faults", "faults.deal")
dev_alarms = partial(_prove, "alarms", "alarms")
dev_firmware = partial(_prove, "firmware", "firmware")
dev_autopilots = partial(_prove, "autopilots", "onboard")


def compare(args: argparse.Namespace) -> Exit:
    """Fly controllers side by side."""
    from sim.studies import (
        CONTROLLERS,
        compare as fly_side_by_side,
        text_table,
        write_between_markers,
    )

    if args.write is not None:
        fill_markers(args.write, {"figures": ""})
    if args.equal_margins:
        return _at_equal_margins(args)
    if args.trials is not None:
        raise ConfigError("--trials", notice("option.only_with", option="--equal-margins"))
    with ProgressBar("flights", quiet=args.json) as bar:
        try:
            found = fly_side_by_side(
                args.controllers or CONTROLLERS,
                scenarios=args.scenarios or None,
                seeds=args.seeds,
                duration=args.duration,
                overrides=args.overrides,
                workers=args.workers,
                on_done=bar.at,
            )
        except ConfigError as error:
            if error.key != "controller.kind" or args.controllers is None:
                raise
            raise ConfigError("--controllers", error.problem) from None
    if args.write is not None:
        write_between_markers(args.write, found.rows, typed_command())
    print(
        json.dumps({"rows": msgspec.to_builtins(found.rows)})
        if args.json
        else text_table(found.rows)
    )
    return Exit.DONE


def _at_equal_margins(args: argparse.Namespace) -> Exit:
    """Tune every law under the same robustness floors, and fly the best gains of each once more."""
    from sim.studies import (
        SEARCHED_LAWS,
        TRIALS,
        compare_at_equal_margins,
        describe_terms,
        equal_margins_table,
    )

    require_package("optuna", "tune", "tune")
    for option, values in (("--scenarios", args.scenarios), ("--set", args.overrides)):
        if values:
            raise ConfigError(option, notice("compare.told"))
    trials = args.trials or TRIALS
    names = {law.name.partition(",")[0] for law in SEARCHED_LAWS}
    for name in args.controllers or ():
        if name not in names:
            raise ConfigError(
                "--controllers", notice("value.choices", choices=sorted(names), found=name)
            )
    laws = [
        law
        for law in SEARCHED_LAWS
        if not args.controllers or law.name.partition(",")[0] in args.controllers
    ]
    steps = sum(trials + 1 if law.start else 2 for law in laws)
    with (
        Flyers(args.workers) as flyers,
        ProgressBar("evaluations", steps, quiet=args.json) as progress,
    ):
        found = compare_at_equal_margins(
            flyers, trials=trials, seeds=args.seeds, laws=laws, on_done=progress.step
        )
    shown = f"{equal_margins_table(found)}\n\n{textwrap.fill(describe_terms(trials, args.seeds))}"
    if args.write is not None:
        replace_between_markers(args.write, shown)
    print(json.dumps({"rows": msgspec.to_builtins(found)}) if args.json else shown)
    return Exit.DONE


def campaign(args: argparse.Namespace) -> Exit:
    """Fly one scenario many times, in drawn worlds; exit code 1 if a flight failed."""
    from sim.studies.campaign import USUAL, Campaign, Cluster, Crew, Local, report, run, text

    scenario = find_scenario(args.scenario)
    world, config = prepare(scenario, args.overrides)
    shared = Campaign(
        scenario=scenario.name,
        world=world,
        config=config,
        duration_s=args.duration,
        overrides=args.overrides,
        draws=USUAL if args.draw is None else tuple(args.draw),
    )
    shared.check()  # a campaign that can't fly is refused before a cluster is called
    start = perf_counter()
    if args.kernel is not None:
        print(notice("campaign.kernel"), file=sys.stderr)
    flyers: AbstractContextManager[Crew] = (
        nullcontext(Local(args.workers)) if args.cluster is None else Cluster(args.cluster)
    )
    with flyers as crew, ProgressBar("flights", args.flights, quiet=args.json) as progress:
        rows, flown = run(
            shared,
            range(args.first_seed, args.first_seed + args.flights),
            crew,
            out=args.out,
            batch=args.batch,
            on_progress=progress.at,
        )
        facts = report(
            shared, rows, flown=flown, wall_s=perf_counter() - start, workers=crew.workers
        )
    print(json.dumps(facts) if args.json else text(facts))
    return Exit.DONE if all(row.survived for row in rows) else Exit.FAILED


def tune(args: argparse.Namespace) -> Exit:
    """Search for better gains, or report how wrong the configured vehicle may be with the present
    ones.
    """
    from sim.cli.tune import report, search

    return report(args) if args.report else search(args)


def dev_intervals(args: argparse.Namespace) -> Exit:
    """Fly excitation flights, and count how often the truth lies within the identified
    intervals.
    """
    from sim.studies import coverage_table, identify_flights

    _refuse_early(args.scenarios, args.write)
    told = []
    with ProgressBar("flights", len(args.scenarios) * args.flights) as counter:
        for name in args.scenarios:
            for found in identify_flights(name, args.flights):
                told += found
                counter.step()
    _show(args, coverage_table(told, args.flights))
    return Exit.DONE


def _refuse_early(scenarios: Iterable[str], page: Path | None) -> None:
    """Refuse unknown scenarios and a page without markers before the first flight.

    Raises ConfigError.
    """
    for name in scenarios:
        find_scenario(name)
    if page is not None:
        fill_markers(page, {"figures": ""})


def dev_upsets(args: argparse.Namespace) -> Exit:
    """Fly every law through large steps and pushes of the wind, and from drawn starts."""
    from sim.studies import BATCHES, VEHICLES, compare_upsets, upsets_table

    scenarios = args.scenarios or VEHICLES
    _refuse_early(scenarios, args.write)
    with ProgressBar("batches", len(scenarios) * BATCHES) as counter:
        found = compare_upsets(
            scenarios, seeds=args.seeds, states=args.states, on_done=counter.step
        )
    _show(args, upsets_table(*found))
    return Exit.DONE


def _show(args: argparse.Namespace, table: str) -> None:
    """Print ``table``; with ``--write``, put it into the page, too, with the command that made
    it.
    """
    print(table)
    if args.write is not None:
        replace_between_markers(args.write, f"{table}\n\nMade by `{typed_command()}`.")


def scenarios(args: argparse.Namespace) -> Exit:
    """List the scenarios."""
    rows: dict[str, dict[str, Any]] = {
        name: {
            "summary": s.summary,
            "sim": msgspec.to_builtins(s.world),
            "told": {"vehicle": msgspec.to_builtins(s.vehicle), "pose_latency_s": s.latency_s},
        }
        for name, s in SCENARIOS.items()
    }
    if args.name is not None:
        rows = {args.name: rows[find_scenario(args.name).name]}
    if args.json:
        print(json.dumps(rows))
        return Exit.DONE
    if args.name is None:
        width = max(map(len, rows))
        print("\n".join(f"{name:{width}}  {row['summary']}" for name, row in rows.items()))
        return Exit.DONE
    row = rows[args.name]
    print(row["summary"])
    _print_keys("sim", row["sim"])
    _print_keys("told", row["told"])
    return Exit.DONE


def _print_keys(key: str, value: Any) -> None:
    """Print each key on a line, as ``--set`` takes it."""
    if isinstance(value, dict):
        for name, part in value.items():
            _print_keys(f"{key}.{name}", part)
    else:
        print(f"    {key} = {json.dumps(value)}")


def dev_check_vectors(args: argparse.Namespace) -> Exit:
    """Evaluate the law on test vectors."""
    from sim.studies import LIMIT, worst_disagreement

    with refuse_io("", "file.unread", args.file), refuse_value(""):
        worst, count = worst_disagreement(args.file)
    print(f"{count} vectors, largest |a - e| / max(1, |e|) = {worst:.3g} (limit {LIMIT:g})")
    return Exit.DONE if worst <= LIMIT else Exit.FAILED


def completion(args: argparse.Namespace) -> Exit:
    """Print the script with which a shell completes the command lines."""

    def words(command: str, argument: str) -> list[str]:
        if argument in ("scenario", "scenarios"):
            return list(SCENARIOS)
        truth = [f"sim.{key}=" for key in keys_of(World)] if argument == "overrides" else []
        return [*truth, *words_of_flying(command, argument)]

    print(completion_script(args.program, args.shell, words))
    return Exit.DONE


def dev_reference(args: argparse.Namespace) -> Exit:
    """Print or write the pages of docs/reference that are made from the code."""
    print(load_proving("reference", "reference").reference_command(args.write))
    return Exit.DONE


def fly(args: argparse.Namespace) -> Exit:
    """Fly one scenario in virtual time."""
    with ProgressBar("seconds flown", quiet=args.json) as bar:
        run = simulate(
            args.scenario,
            controller=args.controller,
            duration=args.duration,
            seed=args.seed,
            overrides=args.overrides,
            config=args.config,
            source=args.source,
            link=args.link,
            autopilot=args.autopilot,
            out=args.out,
            record=args.out is not None,
            on_progress=bar.at,
        )
    print(
        json.dumps(run.facts)
        if args.json
        else summary(run.facts, args.out, paper=_is_papers(args, run)),
        flush=True,
    )
    return Exit.DONE if run.completed and run.is_whole else Exit.FAILED


def _is_papers(args: argparse.Namespace, run: Run) -> bool:
    """Whether this flight is the paper's (law, trajectory, wind), so that the paper's figures are
    shown beside it.
    """
    usual = (args.source, args.link or "mavlink", args.autopilot) == ("vicon", "mavlink", "px4")
    changed = args.overrides or args.config is not None
    return (
        usual
        and not changed
        and (run.facts["scenario"], run.facts["controller"]) == ("paper", "adaptive")
    )


def mission(args: argparse.Namespace) -> Exit:
    """Fly one scenario from the floor to its trajectory and back, in virtual time."""
    scenario, args.link = choose_scenario(args.scenario, args.autopilot, args.link)
    if args.autopilot == BETAFLIGHT and args.vehicles > 1:
        raise ConfigError("--vehicles", notice("sim.one_betaflight"))
    world, config = prepare(
        scenario, args.overrides, controller=args.controller, source=args.source, link=args.link
    )
    world, config = from_floor(world, config, args.duration or DURATION_S)
    ensure_flyable(config)
    if args.vehicles > 1:
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
    title = (
        f"{scenario.name}, controller {config.controller.kind}, poses by {args.source}, seed "
        f"{args.seed}"
    )
    print(
        json.dumps(asked | msgspec.to_builtins(flown))
        if args.json
        else summarize_mission(title, flown)
    )
    return Exit.DONE if flown.landed else Exit.FAILED


def _missions(args: argparse.Namespace, name: str, world: World, config: Config) -> Exit:
    """Fly several missions side by side."""
    flown = fly_fleet(world, config, args.vehicles, seed=args.seed, autopilot=args.autopilot)
    asked = {"scenario": name, "seed": args.seed, "source": args.source, "landed": flown.landed}
    asked["min_separation_m"] = None if flown.nearest is None else flown.nearest.distance_m
    title = f"{name}, {args.vehicles} vehicles, poses by {args.source}, seed {args.seed}"
    print(
        json.dumps(asked | msgspec.to_builtins(flown)) if args.json else fleet_summary(title, flown)
    )
    return Exit.DONE if flown.landed else Exit.FAILED


def summarize_mission(title: str, mission: MissionResult) -> str:
    """Describe the mission as text: its states and warnings in order, then its figures."""
    lines = [
        title if mission.landed else f"{title}\nNOT AS PLANNED: {mission.fault or mission.why}",
        "",
    ]
    events = [(one.time_s, one.state, one.reason) for one in mission.states]
    events += [(one.time_s, "", one.reason) for one in mission.warnings]
    lines += [
        f"{time_s:9.2f} s  {state:12} {text}"
        for time_s, state, text in sorted(events, key=lambda one: one[0])
    ]
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


def fleet_summary(title: str, flown: FleetMission) -> str:
    """Describe several missions as text."""
    lines = [
        title if flown.landed else f"{title}\nNOT AS PLANNED",
        "",
        f"{'':12}{'RMS':>9}{'touchdown':>12}",
    ]
    for one in flown.vehicles:
        lines.append(
            f"{one.name:12}{_format(one.rms_cm, 'cm'):>9}{_format(one.touchdown_m_s, 'm/s'):>12}"
            + ("" if one.landed else f"  {one.why}")
        )
    lines.append("")
    if flown.nearest is not None:
        a, b = flown.nearest.between
        lines.append(
            f"nearest     {flown.nearest.distance_m:.2f} m, {a} and {b}, at "
            f"{flown.nearest.time_s:.1f} s"
        )
    lines.append(f"wall time   {flown.wall_s:.1f} s for {flown.duration_s:.0f} s")
    return "\n".join(lines)


def _format(value: float | None, unit: str) -> str:
    return "–" if value is None else f"{value:.2f} {unit}"


def serve(args: argparse.Namespace) -> Exit:
    """Run the simulated side in real time."""
    if args.config is not None:
        _ensure_told_by_file(args)
    scenario, args.link = choose_scenario(args.scenario, args.autopilot, args.link)
    if args.autopilot == BETAFLIGHT and args.config is not None:
        raise ConfigError("--config", notice("sim.one_betaflight"))
    common: dict[str, Any] = {
        "seed": args.seed,
        "duration_s": args.duration,
        "autopilot": args.autopilot,
    }
    if args.carried and args.config is None:
        raise ConfigError("--carried", notice("serve.needs_config"))
    if args.config is not None:
        return _serve_room(args, scenario.world, common)
    world, config = prepare(scenario, args.overrides, source=args.source, link=args.link)
    if args.floor:
        world, config = from_floor(world, config, None)
    return asyncio.run(serve_stage(scenario.name, world, config, **common))


def _ensure_told_by_file(args: argparse.Namespace) -> None:
    """Refuse options that would have no effect beside ``--config``: its file tells them.

    Raises:
        ConfigError: one of them is given.
    """
    source = args.source if args.source != "vicon" else None
    for option, value in {"--floor": args.floor, "--link": args.link, "--source": source}.items():
        if value:
            raise ConfigError(option, notice("serve.beside"))


def _serve_room(args: argparse.Namespace, air: World, common: dict[str, Any]) -> Exit:
    """Run the simulated side for ``--rehearse`` of a configuration, or of a fleet file."""
    served = f"{args.config} for --rehearse"
    truth, told = split_overrides(args.overrides, None)
    if "vehicles" in read_toml(args.config):
        if args.carried:
            raise ConfigError("--carried", notice("serve.needs_config"))
        labs = [member.lab for member in read_fleet(args.config, told, rehearsed=True).members]
        return asyncio.run(
            serve_fleet(
                served, [make_configured_world(air, lab, truth) for lab in labs], labs, **common
            )
        )
    config = rehearse(load(args.config, Config, told), args.config)
    more = {"standing": place_others(config), "carried": args.carried}
    return asyncio.run(
        serve_stage(served, make_configured_world(air, config, truth), config, **more, **common)
    )
