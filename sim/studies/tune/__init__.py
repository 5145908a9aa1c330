"""The search for gains, and how wrong the world may be with them."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.studies.tune.flights import (
        AXES,
        DELAY,
        Flyers,
        Key,
        SortieOutcome,
        Staged,
        criterion,
        failure,
        limit_cm,
        loses_proof,
        markdown_table,
        own,
        report,
        sorties,
        space,
        stage_scenarios,
        station_of,
        text,
        with_gains,
    )
    from sim.studies.tune.tune import (
        SEARCH_SEED,
        Evidence,
        Floors,
        Search,
        TuningTrial,
        broken_cost,
        geometric_mean,
        margins_table,
        run,
        table,
        toml,
        unverified_toml,
        verify,
    )

_MODULES = {
    "flights": (
        "AXES",
        "DELAY",
        "Flyers",
        "Key",
        "SortieOutcome",
        "Staged",
        "criterion",
        "failure",
        "limit_cm",
        "loses_proof",
        "markdown_table",
        "own",
        "report",
        "sorties",
        "space",
        "stage_scenarios",
        "station_of",
        "text",
        "with_gains",
    ),
    "tune": (
        "Evidence",
        "Floors",
        "SEARCH_SEED",
        "Search",
        "TuningTrial",
        "broken_cost",
        "geometric_mean",
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
