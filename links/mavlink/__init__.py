"""The MAVLink link to PX4 and ArduPilot: transport, connection, and the link itself."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from links.mavlink.connection import MavlinkConnection, StampFile
    from links.mavlink.link import MavlinkLink, MavlinkLinkConfig


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
