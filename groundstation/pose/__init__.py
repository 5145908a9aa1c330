"""Poses: sources by kind, recorded poses, and forwarding to the autopilot."""

from groundstation.pose.forward import ForwardingSource
from groundstation.pose.recorded_codec import (
    Sender,
    TlogReader,
    TlogRecord,
    describe_senders,
    find_autopilots,
)
from groundstation.pose.registry import PoseConfig, make_source, pose_decoder
from groundstation.pose.stamps import check_stamp_rate
