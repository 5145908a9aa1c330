"""Frames of RF modules and the channels in them, sans-IO. A new module is a file and a line of kinds.py."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from links.rf.codecs.channel_map import Channels
    from links.rf.codecs.codec import Heard, Manner, RfLinkConfig, Service
    from links.rf.codecs.crsf_codec import CrsfLinkConfig
    from links.rf.codecs.dsm_codec import DsmLinkConfig
    from links.rf.codecs.kinds import RF_CODECS, RfConfig

_MODULES = {
    "channel_map": ("Channels",),
    "codec": ("Heard", "Manner", "RfLinkConfig", "Service"),
    "crsf_codec": ("CrsfLinkConfig",),
    "dsm_codec": ("DsmLinkConfig",),
    "kinds": ("RF_CODECS", "RfConfig"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
