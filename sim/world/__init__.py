"""The truth of a simulated flight: plant, wind, vehicle, and the scenarios."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.world.airframe import Airframe, Truth
    from sim.world.draws import generator, rows, stream
    from sim.world.horizon import Horizon
    from sim.world.plant import Body, Physics, moved
    from sim.world.quadrotor import Quadrotor
    from sim.world.vehicle import SimulatedVehicle, Wander, with_noise
    from sim.world.wind import Eddies, Wind, begun, cell, felt, stirred
    from sim.world.world import World

_MODULES = {
    "airframe": ("Airframe", "Truth"),
    "draws": ("generator", "rows", "stream"),
    "horizon": ("Horizon",),
    "plant": ("Body", "Physics", "moved"),
    "quadrotor": ("Quadrotor",),
    "vehicle": ("SimulatedVehicle", "Wander", "with_noise"),
    "wind": ("Eddies", "Wind", "begun", "cell", "felt", "stirred"),
    "world": ("World",),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
