"""Controllers to fly with. ``ControllerConfig`` is the table of them: one line for each kind."""

from typing import TypeAlias

from groundstation.core.control import Adaptive, Gains, Uncompensated
from groundstation.core.controllers.custom import Custom
from groundstation.core.controllers.geometric import Geometric
from groundstation.core.controllers.indi import Indi
from groundstation.core.controllers.pid import Pid
from groundstation.core.messages import Controller
from groundstation.core.vehicle import Vehicle

ControllerConfig: TypeAlias = Gains | Uncompensated | Geometric | Pid | Indi | Custom
"""Any controller as the config file tells it, picked by its ``kind``, with what its estimator is told."""


def make_controller(config: ControllerConfig, vehicle: Vehicle) -> Controller:
    """The controller that ``config`` describes.

    Raises:
        ConfigError: a controller of the user's own can't be loaded.
    """
    return Adaptive(vehicle, config) if isinstance(config, Gains) else config.build(vehicle)
