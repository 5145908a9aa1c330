"""The MAVLink link to PX4 and ArduPilot: transport, connection, and the link itself."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from links.mavlink.connection import MavlinkConnection
    from links.mavlink.link import MavlinkLink, MavlinkLinkConfig
    from links.mavlink.signing_key import StampFile

_MODULES = {
    "connection": ("MavlinkConnection",),
    "link": ("MavlinkLink", "MavlinkLinkConfig"),
    "signing_key": ("StampFile",),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
