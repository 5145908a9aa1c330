"""Simulated autopilots: PX4 and ArduPilot, as they were seen to behave towards a ground station."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.autopilots.base import SimulatedAutopilot
    from sim.autopilots.dialect import Parameters
    from sim.autopilots.peer import AUTOPILOTS, AutopilotPeer
    from sim.autopilots.px4 import Px4Autopilot

_MODULES = {
    "base": ("SimulatedAutopilot",),
    "dialect": ("Parameters",),
    "peer": ("AUTOPILOTS", "AutopilotPeer"),
    "px4": ("Px4Autopilot",),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
