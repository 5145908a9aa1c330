"""Trajectories to fly. ``TrajectoryConfig`` is the table of them: one line for each kind."""

from typing import TypeAlias

from groundstation.trajectories.circle import CircleConfig
from groundstation.trajectories.excitation import ExcitationConfig
from groundstation.trajectories.hold import HoldConfig
from groundstation.trajectories.lemniscate import LemniscateConfig
from groundstation.trajectories.samples import SamplesConfig
from groundstation.trajectories.transit import TransitConfig
from groundstation.trajectories.waypoints import WaypointsConfig

__all__ = [
    "CircleConfig",
    "ExcitationConfig",
    "HoldConfig",
    "LemniscateConfig",
    "SamplesConfig",
    "TrajectoryConfig",
    "TransitConfig",
    "WaypointsConfig",
]

TrajectoryConfig: TypeAlias = (
    CircleConfig | ExcitationConfig | HoldConfig | LemniscateConfig | SamplesConfig | TransitConfig | WaypointsConfig
)
"""Any trajectory as the config file tells it, picked by its ``kind``; ``.build()`` gives the trajectory."""
