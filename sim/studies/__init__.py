"""Questions put to many flights: campaigns, comparisons, tuning, margins."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.studies.bring_down import CAUSES, cut_all, markdown
    from sim.studies.comparison import (
        CONTROLLERS,
        GUST,
        WITHOUT_ADAPTATION,
        Case,
        ComparedFlight,
        cases,
        check_markers,
        check_plot,
        compare,
        fly_case,
        markdown_table,
        plot,
        put_between_markers,
        rows,
        text_table,
        write_between_markers,
    )
    from sim.studies.equal_margins import (
        SEARCHED_LAWS,
        compare_at_equal_margins,
        describe_terms,
        draw_equal_margins,
        equal_margins_table,
        read_trials,
        write_trials,
    )
    from sim.studies.gale import gale_command
    from sim.studies.vectors import LIMIT, worst_disagreement

_MODULES = {
    "bring_down": ("CAUSES", "cut_all", "markdown"),
    "comparison": (
        "CONTROLLERS",
        "Case",
        "ComparedFlight",
        "GUST",
        "WITHOUT_ADAPTATION",
        "cases",
        "check_markers",
        "check_plot",
        "compare",
        "fly_case",
        "markdown_table",
        "plot",
        "put_between_markers",
        "rows",
        "text_table",
        "write_between_markers",
    ),
    "equal_margins": (
        "SEARCHED_LAWS",
        "compare_at_equal_margins",
        "describe_terms",
        "draw_equal_margins",
        "equal_margins_table",
        "read_trials",
        "write_trials",
    ),
    "gale": ("gale_command",),
    "vectors": ("LIMIT", "worst_disagreement"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
