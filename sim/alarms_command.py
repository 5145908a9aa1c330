"""What ``groundstation-sim alarms`` does: true flights with the monitor armed, or its curve of detection time."""

import argparse
import json
import os
import shlex
import sys
from statistics import median

import msgspec

from groundstation.config import ConfigError
from groundstation.preflight import ensure_flyable
from sim.alarms import KINDS, REMARKABLE, SHARES, Alarms, Detection, detections, watch_all
from sim.compare_table import check_markers, put_between_markers
from sim.console import Counter
from sim.mission import from_floor
from sim.prepare import prepare, scenario_of

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
    from sim.alarms_capture import captured

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
