"""The RF bridge: the pacer and the module on another computer, and the link to it."""

from links.bridge import codec as codec
from links.bridge.link import BridgeLink, BridgeLinkConfig
from links.bridge.server import Bridge, BridgeConfig
