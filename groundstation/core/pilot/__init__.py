"""From a pose to a command: the estimator, what judges it, the controller and its limits, put together."""

from groundstation.core.pilot.pilot import NOISE_POSES, Pilot
