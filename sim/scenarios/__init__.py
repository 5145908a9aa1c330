"""The scenarios by name, and how one becomes the truth and what the controller is told."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.scenarios.scenarios import (
        SCENARIOS,
        Scenario,
        by_side,
        overridden,
        prepare,
        prepare_own,
        scenario_of,
        timing,
    )

_MODULES = {
    "scenarios": ("SCENARIOS", "Scenario", "by_side", "overridden", "prepare", "prepare_own", "scenario_of", "timing")
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
