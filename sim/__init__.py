"""Everything simulated: worlds, autopilots, trackers and radios, and the flights and studies that
are made of them.

This is what a user imports; what is behind it may change. A flight is two lines, in a fraction of
its own time:

    world, config = prepare(SCENARIOS["paper"], [])
    result = fly(world, config, seed=0, duration_s=20.0)

- ``SCENARIOS``: the scenarios by name, each a ``Scenario``: the truth, and the configuration of a
  flight in it.
- ``prepare``: the truth and the configuration of a scenario after overrides, such as
  ``"vehicle.mass_kg=0.9"``.
- ``prepare_own``: the same for a user's configuration file.
- ``World``: the truth of a flight: what the vehicle, the air, the cameras and the radio really do.
- ``simulate``: the two lines in one, with a controller or a trajectory of your own, recorded; its
  ``Run``, as arrays.
- ``compare``: controllers side by side in the same scenarios; their ``ControllerComparison``.
- ``error_budget``: a recorded flight flown again without each source of its error; the
  ``ErrorBudget``.
- ``fly``: a flight in virtual time, from its release on; its ``Result``.
- ``from_floor``, ``fly_mission``: a mission from the floor and back in virtual time; its
  ``MissionResult``.
- ``fly_fleet``: several missions at once; its ``FleetMission``.
- ``serve``, ``serve_fleet``: the simulated side alone, in real time, for whatever flies it.
"""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.runs.fleet import FleetMission, fly_fleet
    from sim.runs.flight import MissionResult, Result, fly, fly_mission, from_floor
    from sim.runs.server import serve, serve_fleet
    from sim.runs.simulation import Run, simulate
    from sim.scenarios.scenarios import SCENARIOS, Scenario, prepare, prepare_own
    from sim.studies.budget import ErrorBudget, error_budget
    from sim.studies.comparison import ControllerComparison, compare
    from sim.world.world import World

_MODULES = {
    "FleetMission": "sim.runs.fleet",
    "fly_fleet": "sim.runs.fleet",
    "MissionResult": "sim.runs.flight",
    "Result": "sim.runs.flight",
    "fly": "sim.runs.flight",
    "fly_mission": "sim.runs.flight",
    "from_floor": "sim.runs.flight",
    "serve": "sim.runs.server",
    "serve_fleet": "sim.runs.server",
    "Run": "sim.runs.simulation",
    "simulate": "sim.runs.simulation",
    "SCENARIOS": "sim.scenarios.scenarios",
    "Scenario": "sim.scenarios.scenarios",
    "prepare": "sim.scenarios.scenarios",
    "prepare_own": "sim.scenarios.scenarios",
    "ErrorBudget": "sim.studies.budget",
    "error_budget": "sim.studies.budget",
    "ControllerComparison": "sim.studies.comparison",
    "compare": "sim.studies.comparison",
    "World": "sim.world.world",
}
"""Public names, each with the module that is loaded at its first use (PEP 562)."""


def __getattr__(name: str) -> object:
    from importlib import import_module

    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)
