"""Autopilots of the simulated vehicle: PX4 and ArduPilot as they were seen to behave, and real
firmware.
"""

from sim.autopilots.ardupilot import make_ardupilot
from sim.autopilots.autopilot import SimulatedAutopilot
from sim.autopilots.betaflight import (
    GAINS,
    STEP_S,
    BetaflightFirmware,
    FlightBoard,
    configure,
    describe_settings,
    pack_pulses,
)
from sim.autopilots.dialects import Px4Autopilot
from sim.autopilots.onboard import Airworthy, Make, OnboardFirmware
from sim.autopilots.parameters import Parameters
from sim.autopilots.peer import (
    AUTOPILOTS,
    AutopilotPeer,
    OpenWire,
    open_far_end,
    open_tcp,
    open_udp,
)
from sim.autopilots.px4 import Px4, make_px4
