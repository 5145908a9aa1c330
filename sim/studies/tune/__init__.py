"""The search for gains, and how wrong the world may be with them."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.studies.tune.flights import Flyers, Staged, own, space, stage_scenarios, station_of, with_gains
    from sim.studies.tune.margins import AXES, criterion, markdown_table, report, text
    from sim.studies.tune.tune import (
        SEARCH_SEED,
        Evidence,
        Floors,
        Search,
        TuningTrial,
        margins_table,
        run,
        table,
        toml,
        unverified_toml,
        verify,
    )

_MODULES = {
    "flights": ("Flyers", "Staged", "own", "space", "stage_scenarios", "station_of", "with_gains"),
    "margins": ("AXES", "criterion", "markdown_table", "report", "text"),
    "tune": (
        "Evidence",
        "Floors",
        "SEARCH_SEED",
        "Search",
        "TuningTrial",
        "margins_table",
        "run",
        "table",
        "toml",
        "unverified_toml",
        "verify",
    ),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
