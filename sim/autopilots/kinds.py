"""The simulated autopilots by name."""

from sim.autopilots.ardupilot import ArduPilotAutopilot
from sim.autopilots.base import SimulatedAutopilot
from sim.autopilots.px4 import Px4Autopilot

AUTOPILOTS: dict[str, type[SimulatedAutopilot]] = {"px4": Px4Autopilot, "ardupilot": ArduPilotAutopilot}
"""What ``--autopilot`` takes."""
