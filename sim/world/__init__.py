"""The truth of a simulated flight: plant, wind, vehicle, and the scenarios."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.world.draws import generator, rows, stream
    from sim.world.horizon import Horizon
    from sim.world.plant import Body, Physics, moved
    from sim.world.quadrotor import Airframe, Quadrotor, Truth
    from sim.world.vehicle import SimulatedVehicle, Wander, with_noise
    from sim.world.world import Eddies, Wind, World, begun, cell, felt, stirred

_MODULES = {
    "draws": ("generator", "rows", "stream"),
    "horizon": ("Horizon",),
    "plant": ("Body", "Physics", "moved"),
    "quadrotor": ("Airframe", "Quadrotor", "Truth"),
    "vehicle": ("SimulatedVehicle", "Wander", "with_noise"),
    "world": ("Eddies", "Wind", "World", "begun", "cell", "felt", "stirred"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
