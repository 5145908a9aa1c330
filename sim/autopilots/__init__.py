"""Simulated autopilots: PX4 and ArduPilot, as they were seen to behave towards a ground station."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.autopilots.base import SimulatedAutopilot
    from sim.autopilots.betaflight import (
        GAINS,
        STEP_S,
        Firmware,
        FlightBoard,
        configure,
        describe_settings,
        pack_pulses,
    )
    from sim.autopilots.dialect import Parameters
    from sim.autopilots.peer import AUTOPILOTS, AutopilotPeer, OpenWire, accept_at, at_end_of, speak_to, wait_at
    from sim.autopilots.px4 import Px4Autopilot

_MODULES = {
    "base": ("SimulatedAutopilot",),
    "betaflight": ("Firmware", "FlightBoard", "GAINS", "STEP_S", "configure", "describe_settings", "pack_pulses"),
    "dialect": ("Parameters",),
    "peer": ("AUTOPILOTS", "AutopilotPeer", "OpenWire", "accept_at", "at_end_of", "speak_to", "wait_at"),
    "px4": ("Px4Autopilot",),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
