"""Pilot: estimator, monitors, controller and limits of one vehicle, from a pose to a command."""

from groundstation.core.pilot.monitors import MONITORS, Monitors
from groundstation.core.pilot.pilot import Pilot
