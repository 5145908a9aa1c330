"""What each ``groundstation-sim`` command does: where that is written, or here where it is little."""

import argparse
import json
import sys
from typing import Any

import msgspec

from groundstation.config import ConfigError
from sim.cli.arguments import MEASUREMENTS, proving
from sim.scenarios import SCENARIOS, prepare, scenario_of


def fly(args: argparse.Namespace) -> int:
    """Fly one scenario in virtual time."""
    from sim.cli.fly import fly as command

    return command(args)


def mission(args: argparse.Namespace) -> int:
    """Fly one scenario from the floor to its figure and back, in virtual time."""
    from sim.cli.fly import mission as command

    return command(args)


def faults(args: argparse.Namespace) -> int:
    """Break one thing in every state of a mission."""
    return int(proving("faults", "commands").faults(args))


def alarms(args: argparse.Namespace) -> int:
    """Fly true flights, and see how near the monitor of the poses came to accusing them."""
    return int(proving("alarms", "alarms").alarms(args))


def soak(args: argparse.Namespace) -> int:
    """Fly for hours, and see whether anything grows."""
    return int(proving("soak", "commands").soak(args))


def firmware(args: argparse.Namespace) -> int:
    """Measure what Betaflight's own firmware does with ours."""
    return int(proving("firmware", "firmware").firmware(args))


def fuzz(args: argparse.Namespace) -> int:
    """Feed decoders random and damaged bytes."""
    return int(proving("fuzz", "commands").fuzz(args))


def compare(args: argparse.Namespace) -> int:
    """Fly controllers side by side."""
    from sim.cli.campaign import compare as command

    return command(args)


def campaign(args: argparse.Namespace) -> int:
    """Fly one scenario many times, in drawn worlds."""
    from sim.cli.campaign import campaign as fly_campaign

    scenario = scenario_of(args.scenario)
    world, config = prepare(scenario, args.overrides)
    return fly_campaign(args, scenario.name, world, config)


def tune(args: argparse.Namespace) -> int:
    """Search for better gains, or say how wrong the world may be with those there are."""
    from sim.cli.tune import report, search

    return report(args) if args.report else search(args)


def serve(args: argparse.Namespace) -> int:
    """Run the simulated side in real time."""
    from sim.cli.fly import serve as command

    return command(args)


def bench(args: argparse.Namespace) -> int:
    """Measure this machine."""
    for name in args.what:
        if name not in MEASUREMENTS:
            raise ConfigError("bench", f"expected some of {list(MEASUREMENTS)}, got {name!r}")
    bench_ = proving("bench", "bench.bench")
    options = bench_.Options(peers=args.peers, hours=args.hours, seconds=args.seconds)
    facts = bench_.measure_all(args.what or list(MEASUREMENTS), options)
    if args.json and args.what == ["links"]:
        facts |= facts.pop("links")
    print(json.dumps(facts) if args.json else bench_.text(facts))
    return 0


def bring_down(args: argparse.Namespace) -> int:
    """Cut flights short, and tell how the bring-down ends."""
    from sim.cli import ProgressBar
    from sim.studies import CAUSES, check_markers, cut_all, markdown, put_between_markers

    for name in args.scenarios:
        scenario_of(name)
    if args.write is not None:
        check_markers(args.write)
    total = len(args.scenarios) * len(CAUSES) * args.flights
    with ProgressBar("flights", total, quiet=not sys.stderr.isatty()) as counter:
        falls = []
        for fall in cut_all(args.scenarios, args.flights):
            falls.append(fall)
            counter.at(len(falls))
    table = markdown(falls)
    print(table)
    if args.write is not None:
        command = f"groundstation-sim bring-down --flights {args.flights} --write {args.write.name}"
        made = f"{args.flights} flights each: medians, the worst in brackets. Made by `{command}`."
        put_between_markers(args.write, f"{table}\n\n{made}")
    return 0


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
    if args.name is None:
        width = max(map(len, rows))
        print("\n".join(f"{name:{width}}  {row['summary']}" for name, row in rows.items()))
        return 0
    row = rows[scenario_of(args.name).name]
    print(row["summary"])
    _print_keys("sim", row["sim"])
    _print_keys("told", row["told"])
    return 0


def _print_keys(key: str, value: Any) -> None:
    """A line each, as ``--set`` takes them."""
    if isinstance(value, dict):
        for name, part in value.items():
            _print_keys(f"{key}.{name}", part)
    else:
        print(f"    {key} = {json.dumps(value)}")


def check_vectors(args: argparse.Namespace) -> int:
    """Evaluate the law on test vectors."""
    from sim.studies import LIMIT, worst_disagreement

    try:
        worst, count = worst_disagreement(args.file)
    except OSError as error:
        raise ConfigError("", f"cannot read {args.file}: {error.strerror}") from None
    except ValueError as error:
        raise ConfigError("", str(error)) from None
    print(f"{count} vectors, largest |a - e| / max(1, |e|) = {worst:.3g} (limit {LIMIT:g})")
    return 0 if worst <= LIMIT else 1


def gale(args: argparse.Namespace) -> int:
    """Fly published laws in the wind tunnel."""
    from sim.studies import gale_command

    return gale_command(args.write, args.seeds, args.ours, as_json=args.json)


def completion(args: argparse.Namespace) -> int:
    """Print the script by which a shell completes our command lines."""
    from groundstation.config import keys_of
    from groundstation.interfaces.cli import completion_script, words_of_flying
    from sim.world import World

    def words(command: str, argument: str) -> list[str]:
        if argument in ("scenario", "scenarios"):
            return list(SCENARIOS)
        truth = [f"sim.{key}=" for key in keys_of(World)] if argument == "overrides" else []
        return [*truth, *words_of_flying(command, argument)]

    print(completion_script(args.program, args.shell, words))
    return 0


def reference(args: argparse.Namespace) -> int:
    """Print or write the pages of docs/reference that are made from the code."""
    print(proving("reference", "reference").reference_command(args.write))
    return 0
