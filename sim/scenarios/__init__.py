"""The scenarios by name, and how one becomes the truth and what the controller is told."""

from sim.scenarios import gale as gale
from sim.scenarios.scenarios import (
    BETAFLIGHT,
    SCENARIOS,
    Scenario,
    at_desk,
    by_betaflight,
    by_side,
    choose,
    others_of,
    overridden,
    prepare,
    prepare_own,
    scenario_of,
    timing,
    world_as_told,
    world_from,
)
