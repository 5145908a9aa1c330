"""Pose sources by vendor, and what they share: intake, outlier gate and datagrams."""

from groundstation.pose.sources import (
    json_codec as json_codec,
    mavlink_codec as mavlink_codec,
    natnet_codec as natnet_codec,
    qualisys_codec as qualisys_codec,
    vicon_codec as vicon_codec,
)
from groundstation.pose.sources.datagram import (
    GatedSource,
    JsonConfig,
    cannot_listen,
    join,
    send_by,
)
from groundstation.pose.sources.intake import (
    FAST,
    Gate,
    GateConfig,
    Intake,
    PoseReader,
    describe_drop,
    describe_origin_moves,
    describe_unsteady_clock,
)
from groundstation.pose.sources.json_codec import JsonReader
from groundstation.pose.sources.libmotioncapture import LibmotioncaptureConfig
from groundstation.pose.sources.mavlink import MavlinkPoseConfig, MavlinkPoseSource, VisionConfig
from groundstation.pose.sources.mavlink_codec import (
    POSE_MESSAGES,
    LocalPositionDecoder,
    OdometryDecoder,
    PoseDecoder,
    VisionReader,
    decoder_for,
)
from groundstation.pose.sources.natnet import NatNetConfig
from groundstation.pose.sources.natnet_codec import NatNetReader, UnreadableNatNet
from groundstation.pose.sources.qualisys import QualisysConfig
from groundstation.pose.sources.qualisys_codec import Framer, QualisysReader
from groundstation.pose.sources.vicon import ViconConfig
from groundstation.pose.sources.vicon_codec import ViconReader
