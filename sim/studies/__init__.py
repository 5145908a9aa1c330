"""Questions put to many flights: campaigns, comparisons, tuning, margins."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.studies.bring_down import cut_all, markdown
    from sim.studies.compare import (
        CONTROLLERS,
        GUST,
        WITHOUT_ADAPTATION,
        Case,
        Flown,
        cases,
        check_markers,
        check_plot,
        flown,
        fly_all,
        markdown_table,
        plot,
        put_between_markers,
        rows,
        text_table,
        write_between_markers,
    )
    from sim.studies.vectors import LIMIT, worst_disagreement

_MODULES = {
    "bring_down": ("cut_all", "markdown"),
    "compare": (
        "CONTROLLERS",
        "Case",
        "Flown",
        "GUST",
        "WITHOUT_ADAPTATION",
        "cases",
        "check_markers",
        "check_plot",
        "flown",
        "fly_all",
        "markdown_table",
        "plot",
        "put_between_markers",
        "rows",
        "text_table",
        "write_between_markers",
    ),
    "vectors": ("LIMIT", "worst_disagreement"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
