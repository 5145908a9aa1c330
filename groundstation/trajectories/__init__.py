"""Trajectories to fly. ``TrajectoryConfig`` is the table of them: one line for each kind."""

from typing import TypeAlias

from groundstation.trajectories.circle import CircleConfig
from groundstation.trajectories.hold import HoldConfig
from groundstation.trajectories.lemniscate import LemniscateConfig
from groundstation.trajectories.transit import TransitConfig

__all__ = ["CircleConfig", "HoldConfig", "LemniscateConfig", "TrajectoryConfig", "TransitConfig"]

TrajectoryConfig: TypeAlias = CircleConfig | HoldConfig | LemniscateConfig | TransitConfig
"""Any trajectory as the config file tells it, picked by its ``kind``; ``.build()`` gives the trajectory."""
