"""Error budget: a recorded flight flown again by the model, with one source of its error switched
off at a time.

Of a simulated flight the world is known, and the same random numbers are drawn again. Of a real one
nobody knows the world: its budget is that of a vehicle as told, in air as the observer saw it,
before cameras as the simulator has them.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import msgspec
import numpy as np

from groundstation.analysis import FlightData, load
from groundstation.analysis.report import FlightColumns
from groundstation.config import ConfigError
from groundstation.core.control import Custom
from groundstation.core.messages import LEAST_JUDGED_S, STEADY_S
from groundstation.core.trajectory import OwnTrajectoryConfig
from groundstation.settings import Config, read_flown_config
from sim.runs import DURATION_S, fly
from sim.scenarios import parse_world, prepare_at_desk
from sim.world import STILL, World

LIFTED = 10.0
"""Limits that are switched off are so many times as high; far more would be refused as another
unit."""
Flown: TypeAlias = tuple[World, Config]


class ErrorSource(NamedTuple):
    """One source of error."""

    name: str
    means: str
    """Description of the source, for people."""
    off: Callable[[World, Config], Flown]


class Contribution(msgspec.Struct, frozen=True, kw_only=True):
    """Share of the error that one source causes."""

    source: str
    """Its name, such as gusts."""
    means: str
    """Description of the source."""
    rms_cm: float | None
    """RMS error without it [cm]; None where the flight then does not get to its end."""
    squared_cm2: float | None
    """RMS² of the flight less RMS² without it [cm²]; negative where it helped."""


class ErrorBudget(msgspec.Struct, frozen=True, kw_only=True):
    """RMS errors of true positions over the steady part, from 15 s on, of flights of the model."""

    of: str
    """Name of the flight, or the reason for having no budget, as a sentence."""
    duration_s: float = 0.0
    """Duration of each flight [s]."""
    rms_cm: float | None = None
    """With everything as it is [cm]."""
    contributions: tuple[Contribution, ...] = ()
    """Contributions of the sources that this flight has; they need not add up."""


def _noise(world: World, config: Config) -> Flown:
    world = msgspec.structs.replace(
        world, pose_noise_m=0.0, attitude_noise_rad=0.0, pose_jitter_s=0.0
    )
    if world.plant == "rotors":
        rotors = msgspec.structs.replace(world.rotors, gyro_noise_rad_s=0.0)
        world = msgspec.structs.replace(world, rotors=rotors)
    return world, config


def _gusts(world: World, config: Config) -> Flown:
    still = msgspec.structs.replace(world.tunnel, gust_m_s=0.0, rest_m_s2=STILL.rest_m_s2)
    none = (0.0, 0.0, 0.0)
    return msgspec.structs.replace(
        world, wind_gust=none, wind_turbulence=0.0, wind_step=none, tunnel=still
    ), config


def _lags(world: World, config: Config) -> Flown:
    told = config.vehicle
    names = ("thrust_lag_s", "rate_lag_s", "thrust_delay_s", "rate_delay_s")
    as_told = {name: getattr(told, name) for name in names}
    return msgspec.structs.replace(world, plant="first_order", **as_told), config


def _latency(world: World, config: Config) -> Flown:
    pose: Any = config.pose
    if pose.latency_s is not None:
        pose = msgspec.structs.replace(pose, latency_s=0.0)
    vehicle = msgspec.structs.replace(config.vehicle, command_delay_s=0.0)
    world = msgspec.structs.replace(world, pose_latency_s=0.0, command_delay_s=0.0)
    return world, msgspec.structs.replace(config, pose=pose, vehicle=vehicle)


def _limits(world: World, config: Config) -> Flown:
    rates = tuple(LIFTED * limit for limit in world.rate_limits_deg_s)
    vehicle = msgspec.structs.replace(
        config.vehicle,
        thrust_max_n=LIFTED * config.full_thrust_n,
        hover_thrust=None,
        rate_limits_deg_s=tuple(LIFTED * limit for limit in config.vehicle.rate_limits_deg_s),
    )
    world = msgspec.structs.replace(
        world, thrust_max_n=LIFTED * world.thrust_max_n, rate_limits_deg_s=rates
    )
    return world, msgspec.structs.replace(config, vehicle=vehicle)


def _drag(world: World, config: Config) -> Flown:
    none = (0.0, 0.0, 0.0)
    world = msgspec.structs.replace(
        world,
        drag_per_s=0.0,
        drag_body_per_s=none,
        inflow_drag_per_m=(0.0, 0.0),
        inflow_lift_per_m=0.0,
    )
    vehicle = msgspec.structs.replace(config.vehicle, drag_per_s=0.0)
    return world, msgspec.structs.replace(config, vehicle=vehicle)


def _thrust(world: World, config: Config) -> Flown:
    return msgspec.structs.replace(
        world,
        mass_kg=config.vehicle.mass_kg,
        thrust_max_n=config.full_thrust_n,
        thrust_curve=config.thrust_curve,
        thrust_gain=1.0,
        thrust_sag=0.0,
        rate_leak=0.0,
    ), config


def _losses(world: World, config: Config) -> Flown:
    return msgspec.structs.replace(world, pose_loss=0.0, outage_s=0.0, frame_loss=0.0), config


SOURCES = (
    ErrorSource("noise", "of poses, their stamps, and the gyros", _noise),
    ErrorSource("gusts", "and turbulence, and steps of the wind; its mean stays", _gusts),
    ErrorSource("lag mismatch", "thrust and rates answer as told: lag and delay", _lags),
    ErrorSource("latency", "of poses and commands: none, and none told", _latency),
    ErrorSource("saturation", "no upper limit on thrust or rates", _limits),
    ErrorSource("drag", "the air takes no speed away, and none is told", _drag),
    ErrorSource(
        "wrong thrust", "mass and thrust as told, no sagging battery, no leaking rates", _thrust
    ),
    ErrorSource("losses", "every pose and every frame arrives", _losses),
)


def error_budget(flight: FlightData | FlightColumns | Path | str) -> ErrorBudget:
    """The budget of a recorded flight, from the configuration in its recording, and from its world
    if it has one.

    Raises:
        ConfigError: it is no recording of a flight, can't be read, or nothing was commanded in it.
    """
    if not isinstance(flight, FlightColumns):
        flight = (flight if isinstance(flight, FlightData) else load(flight)).columns
    flown = flight
    about, times = flown.recording.about, flown.scalars["flight_time_s"][flown.tracking]
    # The last command was held for as long as the others.
    ended_s = float(times.max() + np.median(np.diff(times))) if len(times) > 1 else 0.0
    duration_s = min(round(ended_s, 1), DURATION_S)
    if not about.get("config"):
        return ErrorBudget(of="No error budget: the recording holds no configuration.")
    if duration_s < LEAST_JUDGED_S:
        return ErrorBudget(
            of=f"No error budget: it flew less than {LEAST_JUDGED_S:g} s on the trajectory."
        )
    try:
        config = read_flown_config(flown.recording.about, flown.recording.path).config
        if isinstance(config.controller, Custom) or isinstance(
            config.trajectory, OwnTrajectoryConfig
        ):
            return ErrorBudget(
                of="No error budget: no code that a recording names is run, and its own is needed."
            )
        world, config = _stage(about, config, flown)
    except (ConfigError, ValueError) as error:
        return ErrorBudget(
            of=f"No error budget: what is told in the recording can't be flown here: {error}"
        )
    seed = int(about.get("seed") or 0)
    return compute_budget(
        world, config, seed=seed, duration_s=duration_s, simulated=bool(about.get("sim"))
    )


def _stage(about: Any, config: Config, flown: FlightColumns) -> Flown:
    """The world of a flight, from the first point of its trajectory on where it began on a
    floor.
    """
    if about.get("sim") and config.flight.start == "air":
        return parse_world(about["sim"]), config
    steady = flown.tracking & (flown.scalars["flight_time_s"] >= STEADY_S)
    seen = flown.vectors["d_hat_m_s2"][steady]
    x, y, z = map(float, np.nan_to_num(seen.mean(axis=0)))
    unrest = float(np.nan_to_num(np.sqrt(seen.var(axis=0).mean())))
    air = World(wind_mean=(x, y, z), wind_turbulence=unrest)
    begun = config.trajectory.build().position_at(0.0)
    world, config = prepare_at_desk(air, config, lambda world: world)
    if about.get("sim"):
        north, east, _ = begun
        world = msgspec.structs.replace(
            parse_world(about["sim"]),
            start_ned=(north, east, world.start_ned[2]),
            start_thrust=world.start_thrust,
            ground_effect=False,
        )
    return world, config


def compute_budget(
    world: World, config: Config, *, seed: int, duration_s: float, simulated: bool = True
) -> ErrorBudget:
    """Fly ``config`` in ``world`` for ``duration_s`` [s] as it is, and without each of
    :data:`SOURCES` that it has.
    """
    config = _accept_still_poses(config)
    without = [(source, source.off(world, config)) for source in SOURCES]
    without = [(source, changed) for source, changed in without if changed != (world, config)]
    flights = [(world, config), *(changed for _, changed in without)]
    results = [fly(*flown, seed=seed, duration_s=duration_s) for flown in flights]
    rms_cm, *errors = (one.verdict.rms_cm if one.completed else None for one in results)
    contributions = [
        Contribution(
            source=source.name,
            means=source.means,
            rms_cm=error,
            squared_cm2=None if rms_cm is None or error is None else rms_cm**2 - error**2,
        )
        for (source, _), error in zip(without, errors, strict=True)
    ]
    of = (
        "This flight, flown again by the model with the same random numbers."
        if simulated
        else "The model's budget, as nobody knows the truth of a real flight: a vehicle as "
        "told, in air that moves as the observer saw it, before the simulator's cameras."
    )
    if rms_cm is None:
        of += " The model does not fly it to its end."
    return ErrorBudget(
        of=of, duration_s=duration_s, rms_cm=rms_cm, contributions=tuple(contributions)
    )


def _accept_still_poses(config: Config) -> Config:
    """Without noise a vehicle that is held looks frozen."""
    pose: Any = config.pose
    if hasattr(pose, "drop_frozen"):
        pose = msgspec.structs.replace(pose, drop_frozen=False)
    return msgspec.structs.replace(
        config, pose=pose, gate=msgspec.structs.replace(config.gate, drop_frozen=False)
    )
