"""Preparation of a flight: a scenario and what ``--set`` says into the truth, and what the controller is told.

A user's own configuration flies at the desk in a scenario's air and before its sensors. The simulated vehicle is then
exactly what the controller is told, so what is seen is the trajectory, the gains and the air; ``sim.…`` overrides make
the truth differ. Poses and commands take the simulator's own way, whatever the lab uses.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec

from groundstation.config import ConfigError, from_dict, load
from groundstation.pose import GateConfig, PoseConfig
from groundstation.pose.sources import ViconConfig
from groundstation.settings import Config
from links.mavlink import MavlinkLinkConfig
from sim.scenarios.scenarios import SCENARIOS, Scenario
from sim.world import World


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


LEAST_HEIGHT_M = 0.5
"""The vehicle is let go at least so high above the floor [m]."""


def timing(pose: PoseConfig, rate_hz: float, latency_s: float) -> tuple[float, float]:
    """Rate [1/s] and latency [s] that ``pose`` tells; the others where its protocol tells them itself."""
    return getattr(pose, "rate_hz", rate_hz), getattr(pose, "latency_s", latency_s)


def world_of(air: World, told: Config) -> World:
    """``air`` around a true vehicle that is as ``told``."""
    vehicle = told.vehicle
    return msgspec.structs.replace(
        air,
        mass_kg=vehicle.mass_kg,
        thrust_max_n=told.full_thrust_n,
        thrust_curve=told.thrust_curve,
        rate_limits_deg_s=vehicle.rate_limits_deg_s,
        thrust_lag_s=vehicle.thrust_lag_s,
        rate_lag_s=vehicle.rate_lag_s,
        command_delay_s=vehicle.command_delay_s,
        frame_period_s=vehicle.frame_period_s,
    )


def own(
    air: World, path: Path, overrides: list[str], overridden: Callable[[World], World]
) -> tuple[World, Config, float | None]:
    """The truth and the configuration for the file at ``path``, in the air of a scenario, from its first point on.

    The third value is how long the configuration wants to fly [s], if it says: the landing is left out, as what is
    judged is how well the trajectory is followed. ``overrides`` are of what is told; ``overridden`` changes the truth.

    Raises:
        ConfigError: see :func:`groundstation.config.loader.load`.
    """
    told = load(path, Config, overrides)
    rate_hz, latency_s = timing(told.pose, air.pose_rate_hz, air.pose_latency_s)
    floor = told.flight.floor_z_m
    north, east, down = told.trajectory.build().position_at(0.0)
    world = overridden(
        msgspec.structs.replace(
            world_of(air, told),
            pose_rate_hz=rate_hz,
            pose_latency_s=latency_s,
            start_ned=(north, east, min(down, floor - LEAST_HEIGHT_M)),
            floor_z_m=floor,
        )
    )
    config = msgspec.structs.replace(
        told,
        pose=ViconConfig(object="quad", latency_s=latency_s, rate_hz=rate_hz, drop_frozen=False),
        gate=GateConfig(drop_frozen=False),
        link=MavlinkLinkConfig(period_s=told.vehicle.frame_period_s, thrust_curve=told.link.thrust_curve),
        flight=msgspec.structs.replace(
            told.flight, start="air", idle_thrust=min(world.start_thrust, 0.9), duration_s=None
        ),
    )
    return world, config, told.flight.duration_s
