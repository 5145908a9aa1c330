"""One page about a recorded flight, with its figures."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.analysis.report.command import report_command
    from groundstation.analysis.report.figures import DPI, PLOT_STYLE
    from groundstation.analysis.report.figures_control import BLUE, GREEN, GREY, ORANGE
    from groundstation.analysis.report.page import document, framed

_MODULES = {
    "command": ("report_command",),
    "figures": ("DPI", "PLOT_STYLE"),
    "figures_control": ("BLUE", "GREEN", "GREY", "ORANGE"),
    "page": ("document", "framed"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
