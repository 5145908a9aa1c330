"""The configuration that a recording is replayed with."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from groundstation.analysis.shadow.recording import Recording
from groundstation.config import ConfigError, from_dict, load
from groundstation.pose import TlogConfig
from groundstation.pose.sources import MavlinkPoseConfig
from groundstation.settings import Config
from links.mavlink import MavlinkLinkConfig

NOMINAL_KG = 1.0
"""Mass of a vehicle that nobody described [kg]. Motion only shows thrust over mass, so any will do."""
NOMINAL_LAG_S = 0.05
"""Its lags of thrust and of rates [s]: with these PX4's and ArduPilot's simulated vehicles were flown well."""
NOMINAL_HOVER = 0.5
"""Its hover thrust, where the recording does not show it either."""
NOMINAL_PERIOD_S = 0.01
"""Time between its set-points, where there are none [s]."""
NOMINAL_LATENCY_S = 0.01
"""From the instant of a pose to its earliest arrival in the log [s], where the configuration is of another source."""


def described(path: Path | None, overrides: Sequence[str]) -> Config:
    """The configuration as the operator gave it, before the recording is read.

    Raises:
        ConfigError: see :func:`groundstation.config.loader.load`.
    """
    if path is not None:
        return load(path, Config, overrides)
    return from_dict({"vehicle": {"mass_kg": NOMINAL_KG}}, Config, overrides)


def latency_s(config: Config) -> float:
    """Time from the instant of a pose to its earliest arrival [s]."""
    pose = config.pose
    return pose.latency_s if isinstance(pose, MavlinkPoseConfig | TlogConfig) else NOMINAL_LATENCY_S


def mavlink(config: Config) -> MavlinkLinkConfig:
    """The link of the recording.

    Raises:
        ConfigError: the configuration has another one.
    """
    if not isinstance(config.link, MavlinkLinkConfig):
        raise ConfigError("link.kind", "a recording holds MAVLink: expected 'mavlink'")
    return config.link


def completed(
    config: Config, path: Path | None, overrides: Sequence[str], recording: Recording, hover: float | None
) -> Config:
    """``config`` with what the recording shows of its vehicle; a configuration file is taken as it is.

    ``hover`` is the share of full thrust that carries the vehicle: full thrust is then m g / hover. What
    ``overrides`` say comes last, as always.
    """
    if path is not None:
        return config
    times_s = np.array([sent.time_s for sent in recording.sent])
    period_s = float(np.median(np.diff(times_s))) if len(times_s) > 1 else 0.0
    vehicle: dict[str, Any] = {
        "name": "recorded",
        "mass_kg": config.vehicle.mass_kg,
        "thrust_max_n": config.vehicle.mass_kg * config.controller.gravity / (hover or NOMINAL_HOVER),
        "thrust_lag_s": NOMINAL_LAG_S,
        "rate_lag_s": NOMINAL_LAG_S,
        "frame_period_s": period_s or NOMINAL_PERIOD_S,
    }
    return from_dict({"vehicle": vehicle}, Config, overrides)
