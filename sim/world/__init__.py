"""The truth of a simulated flight: plant, wind, vehicle, and the scenarios."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.world.draws import generator, rows, stream
    from sim.world.hand import HOLD_S, MOVE_S, make_hand
    from sim.world.plant import AirDrag, Body, Physics, compute_drag, integrate
    from sim.world.quadrotor import Airframe, Quadrotor, TrueState
    from sim.world.rotors import (
        Actuators,
        FourRotors,
        RateLoop,
        begin_rotors,
        describe_air,
        describe_rotors,
        turn_rotors,
    )
    from sim.world.vehicle import Horizon, PositionWander, SimulatedVehicle, with_noise
    from sim.world.world import (
        STILL,
        Eddies,
        RotorConstants,
        Wind,
        WindTunnel,
        World,
        begin_eddies,
        cell,
        compute_turbulence,
        stir,
    )

_MODULES = {
    "draws": ("generator", "rows", "stream"),
    "hand": ("HOLD_S", "MOVE_S", "make_hand"),
    "plant": ("AirDrag", "Body", "Physics", "compute_drag", "integrate"),
    "quadrotor": ("Airframe", "Quadrotor", "TrueState"),
    "rotors": ("Actuators", "FourRotors", "RateLoop", "begin_rotors", "describe_air", "describe_rotors", "turn_rotors"),
    "vehicle": ("Horizon", "PositionWander", "SimulatedVehicle", "with_noise"),
    "world": (
        "Eddies",
        "RotorConstants",
        "STILL",
        "Wind",
        "WindTunnel",
        "World",
        "begin_eddies",
        "cell",
        "compute_turbulence",
        "stir",
    ),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
