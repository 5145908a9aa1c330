"""One page about a recorded flight, with its figures."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.analysis.report.figures import (
        BLUE,
        GREEN,
        GREY,
        ORANGE,
        ReportFigure,
        draw_columns,
        draw_figure,
        figure_class,
        find_figure,
        finish_panels,
    )
    from groundstation.analysis.report.flight import FlightColumns, NoCommand, read_columns
    from groundstation.analysis.report.page import document, frame_picture, report_command


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
