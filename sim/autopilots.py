"""The simulated autopilots by name."""

from sim.autopilot import Px4Autopilot
from sim.autopilot_ardupilot import ArduPilotAutopilot
from sim.autopilot_base import SimulatedAutopilot

AUTOPILOTS: dict[str, type[SimulatedAutopilot]] = {"px4": Px4Autopilot, "ardupilot": ArduPilotAutopilot}
"""What ``--autopilot`` takes."""
