"""Monitors of one flight, handed in: health of the poses and guards.

A study flies with others of its own. Sans-IO.
"""

from collections.abc import Callable
from typing import NamedTuple

from groundstation.core.health import PoseHealth
from groundstation.core.safety import Guards


class Monitors(NamedTuple):
    """Factories of the monitors that may end a flight."""

    health: Callable[[float, float], PoseHealth] = PoseHealth
    """Factory of the monitor of the poses, from mass [kg] and g [m/s²]."""
    guards: Callable[..., Guards] = Guards
    """Factory of the guards; for the arguments see
    :class:`groundstation.core.safety.guards.Guards`."""


MONITORS = Monitors()
"""Monitors of every flight that is no study."""
