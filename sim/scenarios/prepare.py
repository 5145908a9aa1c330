"""A scenario and what ``--set`` says into the truth, and what the controller is told."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec

from groundstation.config.load import ConfigError, from_dict
from groundstation.settings.settings import Config
from sim.scenarios.scenarios import SCENARIOS, Scenario
from sim.world.world import World


class _Overridden(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """So that errors about the truth name their keys as ``sim.…``."""

    sim: World


def scenario_of(name: str) -> Scenario:
    """The scenario that ``--scenario`` names.

    Raises:
        ConfigError: there is no such scenario.
    """
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
    truth, told = by_side(overrides, controller)
    world = overridden(scenario.world, truth)
    with _option(controller):
        return world, _on_udp(scenario.config(world, told, source, link))


def prepare_own(
    scenario: Scenario, path: Path, overrides: list[str], *, controller: str | None = None
) -> tuple[World, Config, float | None]:
    """The same for a configuration file: its vehicle in the air of ``scenario``; and how long it wants to fly [s].

    Raises:
        ConfigError: as :func:`prepare`.
    """
    from sim.scenarios.own import own

    truth, told = by_side(overrides, controller)
    with _option(controller):
        return own(scenario.world, path, told, lambda world: overridden(world, truth))


def by_side(overrides: list[str], controller: str | None) -> tuple[list[str], list[str]]:
    """Overrides of the truth, and of what is told."""
    told = [o for o in overrides if not o.startswith("sim.")]
    if controller is not None:
        told.append(f"controller.kind={controller}")
    return [o for o in overrides if o.startswith("sim.")], told


@contextmanager
def _option(controller: str | None) -> Iterator[None]:
    """Say of a wrong ``controller`` by which option it was given."""
    try:
        yield
    except ConfigError as error:
        if controller is None or error.key != "controller.kind":
            raise
        raise ConfigError("--controller", error.problem) from None


def overridden(world: World, truth: list[str]) -> World:
    """``world``, changed by overrides of the truth.

    Raises:
        ConfigError: as :func:`prepare`.
    """
    return from_dict({"sim": msgspec.to_builtins(world)}, _Overridden, truth).sim


def _on_udp(config: Config) -> Config:
    """``config``, where its link is one that the simulated network has."""
    for key in ("tcp", "serial"):
        if getattr(config.link, key, None) is not None:
            raise ConfigError(f"link.{key}", "the simulated network is UDP: leave this out, or use listen")
    return config
