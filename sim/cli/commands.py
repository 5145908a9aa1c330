"""What each ``groundstation-sim`` command does: where that is written, or here where it is little.

And what the values of arguments may be; each raises ArgumentTypeError where one is not. What only proves
(tests/proving/) is found here too: it is not in the wheel.
"""

import argparse
import json
import math
import sys
from typing import Any

import msgspec

from groundstation.config import ConfigError
from sim.scenarios import SCENARIOS, prepare, scenario_of


def seconds(text: str) -> float:
    """A length of time, at most a day."""
    value = _number(text)
    if not 0.0 < value <= 86400.0:
        raise argparse.ArgumentTypeError(f"expected seconds, more than 0 and at most 86400, got {text}")
    return value


def hours(text: str) -> float:
    """A length of virtual time."""
    value = _number(text)
    if not 0.0 < value <= 1000.0:
        raise argparse.ArgumentTypeError(f"expected hours, more than 0 and at most 1000, got {text}")
    return value


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan  # is within no bounds


def count(text: str) -> int:
    """How many, 1 or more."""
    return _from(1, text)


def whole(text: str) -> int:
    """A whole number, 0 or more."""
    return _from(0, text)


def _from(least: int, text: str) -> int:
    try:
        value = int(text)
    except ValueError:
        value = least - 1
    if value < least:
        raise argparse.ArgumentTypeError(f"expected a whole number from {least} on, got {text}")
    return value


def percent(text: str) -> float:
    """A share, below 90."""
    value = _number(text)
    if not 0.0 <= value < 90.0:
        raise argparse.ArgumentTypeError(f"expected percent from 0 to below 90, got {text}")
    return value


def names(text: str) -> list[str]:
    """Names between commas, each once."""
    return list(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))


MEASUREMENTS = (
    "tick", "flight", "command", "decode", "batch", "recording", "allocation", "links", "screen", "mqtt",
)  # fmt: skip
"""What ``groundstation-sim bench`` can measure, in the order in which it does: each a module of tests/proving/bench."""


def proving(command: str, module: str) -> "Any":
    """The module ``module`` of tests/proving, for ``command``.

    Raises:
        ConfigError: only the wheel is installed, which does not have it.
    """
    from importlib import import_module
    from pathlib import Path

    from groundstation.config import ConfigError

    if not (Path(__file__).parents[2] / "tests" / "proving").is_dir():
        raise ConfigError(
            command, "needs a checkout of the repository: it is not in the wheel (clone it, then `make setup`)"
        )
    return import_module(f"tests.proving.{module}")


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
