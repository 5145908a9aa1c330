"""Trajectories to fly. ``TrajectoryConfig`` is the table of them: one line for each kind."""

from typing import TypeAlias

from groundstation.core.trajectory.circle import CircleConfig
from groundstation.core.trajectory.excitation import ExcitationConfig
from groundstation.core.trajectory.hold import HoldConfig
from groundstation.core.trajectory.lemniscate import LemniscateConfig
from groundstation.core.trajectory.samples import SamplesConfig
from groundstation.core.trajectory.transit import TransitConfig
from groundstation.core.trajectory.waypoints import WaypointsConfig

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
