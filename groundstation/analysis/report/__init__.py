"""One page about a recorded flight, with its figures."""

from groundstation.analysis.report.figures import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    ReportFigure,
    draw_figure,
    figure_class,
    find_figure,
    finish_panels,
    save_figures,
)
from groundstation.analysis.report.flight import FlightColumns, NoCommand, read_columns
from groundstation.analysis.report.page import document, frame_picture, html_table, report_command
