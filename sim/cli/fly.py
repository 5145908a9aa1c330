"""What ``groundstation-sim fly`` does: one flight in virtual time, its folder, its figures."""

import argparse
import gc
import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from groundstation.config import ConfigError
from groundstation.flight import ensure_flyable
from groundstation.settings import Config
from sim.scenarios import prepare, prepare_own, scenario_of
from sim.world import World

if TYPE_CHECKING:
    from sim.cli.run_folder import RunFolder

DURATION_S = 60.0
"""How long a flight lasts if nobody says."""
FEW_COLLECTIONS = 50_000
"""Garbage is collected when so many more objects were made than dropped."""


def fly(args: argparse.Namespace) -> int:
    """Fly one scenario in virtual time."""
    from sim.cli.console import Progress, summary
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
    folder = _run_folder(args.out, config, world, scenario=name, seed=args.seed) if args.out is not None else None
    progress = Progress(duration_s, quiet=args.json or not sys.stderr.isatty())
    with progress, rare_collections(), _kept(folder):
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
def _kept(folder: "RunFolder | None") -> Iterator[None]:
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


def _run_folder(path: Path, config: Config, world: World, *, scenario: str, seed: int) -> "RunFolder":
    from sim.cli.run_folder import RunFolder  # what records is imported only where something is

    return RunFolder(path, config, world, scenario=scenario, seed=seed)


def _thrust_bound(config: Config, v_start: float | None) -> float | None:
    """The paper's a-priori bound on T/m [m/s²] for this flight; None for a controller without such a theory."""
    from groundstation.core.control import Law, acceleration_sup, thrust_bound

    if v_start is None or not isinstance(config.controller, Law):
        return None
    reference = config.trajectory.build()
    accelerations = [reference.at(0.01 * i).acceleration_ned for i in range(6000)]
    return thrust_bound(config.controller, acceleration_sup=acceleration_sup(accelerations), v_start=v_start).bound
