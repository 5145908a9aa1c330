"""Recorded pose sources: CSV and .tlog, played back."""

from groundstation.pose.recorded import csv_codec as csv_codec

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.pose.recorded.csv import IN_RUN_FOLDER, CsvConfig
    from groundstation.pose.recorded.csv_codec import COLUMNS, Row, encode, rows
    from groundstation.pose.recorded.tlog import TlogConfig, pose_decoder
    from groundstation.pose.recorded.tlog_codec import Record, TlogReader

_MODULES = {
    "csv": ("CsvConfig", "IN_RUN_FOLDER"),
    "csv_codec": ("COLUMNS", "Row", "encode", "rows"),
    "tlog": ("TlogConfig", "pose_decoder"),
    "tlog_codec": ("Record", "TlogReader"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
