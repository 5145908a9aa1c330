"""The MAVLink link to PX4 and ArduPilot: transport, connection, and the link itself."""

from links.mavlink.connection import HEARTBEAT_S, MavlinkConnection
from links.mavlink.link import MavlinkLink, MavlinkLinkConfig
from links.mavlink.stamp_file import StampFile
