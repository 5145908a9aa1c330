"""The search for gains, and how wrong the world may be with them."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.studies.tune.tune import (
        AXES,
        DELAY,
        SEARCH_SEED,
        Evidence,
        Floors,
        Flyers,
        Key,
        Search,
        SortieOutcome,
        Staged,
        TuningTrial,
        broken_cost,
        criterion,
        failure,
        geometric_mean,
        limit_cm,
        loses_proof,
        margins_table,
        markdown_table,
        own,
        report,
        run,
        sorties,
        space,
        stage_scenarios,
        station_of,
        table,
        text,
        toml,
        unverified_toml,
        verify,
        with_gains,
    )


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
