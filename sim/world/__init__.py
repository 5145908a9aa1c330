"""The truth of a simulated flight: plant, wind, vehicle, and the scenarios."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.world.draws import generator, rows, stream
    from sim.world.plant import Body, Physics, integrate
    from sim.world.quadrotor import Airframe, Quadrotor, TrueState
    from sim.world.vehicle import Horizon, PositionWander, SimulatedVehicle, with_noise
    from sim.world.world import Eddies, Wind, World, begin_eddies, cell, compute_turbulence, stir

_MODULES = {
    "draws": ("generator", "rows", "stream"),
    "plant": ("Body", "Physics", "integrate"),
    "quadrotor": ("Airframe", "Quadrotor", "TrueState"),
    "vehicle": ("Horizon", "PositionWander", "SimulatedVehicle", "with_noise"),
    "world": ("Eddies", "Wind", "World", "begin_eddies", "cell", "compute_turbulence", "stir"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
