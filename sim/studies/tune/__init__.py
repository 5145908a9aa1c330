"""The search for gains, and how wrong the world may be with them."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.studies.tune.evidence import Evidence, margins_table, table, toml, unverified_toml, verify
    from sim.studies.tune.flights import Flyers, Staged, own, stage_scenarios, station_of
    from sim.studies.tune.margins import AXES, criterion, markdown_table, report, text
    from sim.studies.tune.search_space import space, with_gains
    from sim.studies.tune.tune import SEARCH_SEED, Floors, Search, TuningTrial, run

_MODULES = {
    "evidence": ("Evidence", "margins_table", "table", "toml", "unverified_toml", "verify"),
    "flights": ("Flyers", "Staged", "own", "stage_scenarios", "station_of"),
    "margins": ("AXES", "criterion", "markdown_table", "report", "text"),
    "search_space": ("space", "with_gains"),
    "tune": ("Floors", "SEARCH_SEED", "Search", "TuningTrial", "run"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
