"""Pose sources by vendor: one or two files each."""

from groundstation.pose.sources import json_codec as json_codec
from groundstation.pose.sources import natnet_codec as natnet_codec
from groundstation.pose.sources import qualisys_codec as qualisys_codec
from groundstation.pose.sources import vicon_codec as vicon_codec
from groundstation.pose.sources import vision_codec as vision_codec

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.pose.sources.json import JsonConfig
    from groundstation.pose.sources.json_codec import JsonReader
    from groundstation.pose.sources.mavlink import MavlinkPoseConfig, MavlinkPoseSource
    from groundstation.pose.sources.mavlink_codec import Decoder, LocalPositionDecoder, OdometryDecoder, decoder_for
    from groundstation.pose.sources.natnet import NatNetConfig
    from groundstation.pose.sources.natnet_codec import UnreadableNatNet
    from groundstation.pose.sources.natnet_reader import NatNetReader
    from groundstation.pose.sources.qualisys import QualisysConfig
    from groundstation.pose.sources.qualisys_codec import Framer, QualisysReader
    from groundstation.pose.sources.vicon import ViconConfig
    from groundstation.pose.sources.vicon_codec import ViconReader
    from groundstation.pose.sources.vision import VisionConfig
    from groundstation.pose.sources.vision_codec import VisionReader

_MODULES = {
    "json": ("JsonConfig",),
    "json_codec": ("JsonReader",),
    "mavlink": ("MavlinkPoseConfig", "MavlinkPoseSource"),
    "mavlink_codec": ("Decoder", "LocalPositionDecoder", "OdometryDecoder", "decoder_for"),
    "natnet": ("NatNetConfig",),
    "natnet_codec": ("UnreadableNatNet",),
    "natnet_reader": ("NatNetReader",),
    "qualisys": ("QualisysConfig",),
    "qualisys_codec": ("Framer", "QualisysReader"),
    "vicon": ("ViconConfig",),
    "vicon_codec": ("ViconReader",),
    "vision": ("VisionConfig",),
    "vision_codec": ("VisionReader",),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
