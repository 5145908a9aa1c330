"""A user's own configuration at the desk: a scenario's air and sensors around the vehicle that the configuration tells.

The simulated vehicle is exactly what the controller is told, so what is seen is the trajectory, the gains and the air;
``sim.…`` overrides make the truth differ. Poses and commands take the simulator's own way, whatever the lab uses.
"""

from collections.abc import Callable
from pathlib import Path

import msgspec

from groundstation.config.load import load
from groundstation.pose.gate import GateConfig
from groundstation.pose.kinds import PoseConfig
from groundstation.pose.sources.vicon import ViconConfig
from groundstation.settings.settings import Config
from links.mavlink.link import MavlinkLinkConfig
from sim.world.world import World

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
        ConfigError: see :func:`groundstation.config.load.load`.
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
