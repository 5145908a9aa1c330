"""Controllers side by side."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.studies.compare.compare import CONTROLLERS, cases, fly_all, rows
    from sim.studies.compare.picture import check_plot, plot
    from sim.studies.compare.table import check_markers, put_between_markers, text_table, write_between_markers

_MODULES = {
    "compare": ("CONTROLLERS", "cases", "fly_all", "rows"),
    "picture": ("check_plot", "plot"),
    "table": ("check_markers", "put_between_markers", "text_table", "write_between_markers"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
