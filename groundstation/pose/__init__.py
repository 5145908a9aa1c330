"""Poses: sources by kind, recorded poses, and forwarding to the autopilot."""

from groundstation.pose.forward import ForwardingSource
from groundstation.pose.recorded_codec import (
    CSV_COLUMNS,
    CsvRow,
    Sender,
    TlogReader,
    TlogRecord,
    describe_senders,
    encode_csv,
    find_autopilots,
    is_autopilot,
    read_csv,
)
from groundstation.pose.registry import (
    IN_RUN_FOLDER,
    PoseConfig,
    make_source,
    pose_decoder,
)
from groundstation.pose.stamps import check_stamp_rate
