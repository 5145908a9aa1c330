"""Poses: sources by kind, recorded poses, and forwarding to the autopilot."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.pose.forward import ForwardingSource
    from groundstation.pose.recorded_codec import CSV_COLUMNS, CsvRow, TlogReader, TlogRecord, encode_csv, read_csv
    from groundstation.pose.registry import (
        IN_RUN_FOLDER,
        PoseConfig,
        TlogConfig,
        make_source,
        pose_decoder,
    )
    from groundstation.pose.stamps import check_stamp_rate


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
