"""The scenarios by name, and how one becomes the truth and what the controller is told."""

from sim.scenarios import gale as gale
from sim.scenarios.scenarios import (
    BETAFLIGHT,
    SCENARIOS,
    Scenario,
    choose_scenario,
    find_scenario,
    find_timing,
    make_configured_world,
    override_world,
    parse_world,
    place_others,
    prepare,
    prepare_at_desk,
    prepare_own,
    split_overrides,
    with_betaflight,
)
