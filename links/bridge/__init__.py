"""The RF bridge: the pacer and the module on another computer, and the link to it."""

from links.bridge import codec as codec

TYPE_CHECKING = False
if TYPE_CHECKING:
    from links.bridge.link import BridgeLink, BridgeLinkConfig
    from links.bridge.server import Bridge, BridgeConfig


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
