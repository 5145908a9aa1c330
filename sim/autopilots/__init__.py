"""Simulated autopilots: PX4 and ArduPilot, as they were seen to behave towards a ground station."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.autopilots.autopilot import Parameters, SimulatedAutopilot
    from sim.autopilots.betaflight import (
        GAINS,
        STEP_S,
        Firmware,
        FlightBoard,
        configure,
        describe_settings,
        pack_pulses,
    )
    from sim.autopilots.dialects import Px4Autopilot
    from sim.autopilots.peer import (
        AUTOPILOTS,
        AutopilotPeer,
        FrameCutter,
        OpenWire,
        accept_at,
        at_end_of,
        speak_to,
        wait_at,
    )


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
