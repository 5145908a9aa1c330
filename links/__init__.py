"""Command links: how thrust and body rates leave for a vehicle, and stop when nobody commands.

This is all that a user imports; what is behind it may change.

- ``make_link``: the link that a configuration describes.
- ``MavlinkLinkConfig``: PX4 or ArduPilot over UDP, TCP or a serial port; ``DsmLinkConfig``,
  ``CrsfLinkConfig``: a transmitter module on a serial port; ``BridgeLinkConfig``: such a module on
  another computer.
- ``CommandLink``: what every link does: ``connect``, ``arm``, ``send``, ``disarm``, ``kill``,
  ``close``.
- ``Command``: thrust and body rates, the pose that they came from, a deadline, and the bring-down
  after it.
- ``Segment``: one part of a bring-down.
- ``LinkStatus``: what a link tells of itself and of its vehicle.
- ``Attitude``: how the vehicle itself believes that it lies and turns.
- ``LinkError``: anything that a link reports to the operator; ``LinkLost``: the other end went
  silent; ``LinkRejected``: the vehicle refused; ``LinkMisuse``: the caller broke the port's
  contract.
"""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from links.bridge.link import BridgeLinkConfig
    from links.core.deadman import (
        Attitude,
        Command,
        CommandLink,
        LinkError,
        LinkLost,
        LinkMisuse,
        LinkRejected,
        LinkStatus,
        Segment,
    )
    from links.make import make_link
    from links.mavlink.protocol.config import MavlinkLinkConfig
    from links.rf.module_codec import CrsfLinkConfig, DsmLinkConfig

_MODULES = {
    "BridgeLinkConfig": "links.bridge.link",
    "Attitude": "links.core.deadman",
    "Command": "links.core.deadman",
    "CommandLink": "links.core.deadman",
    "LinkError": "links.core.deadman",
    "LinkLost": "links.core.deadman",
    "LinkMisuse": "links.core.deadman",
    "LinkRejected": "links.core.deadman",
    "LinkStatus": "links.core.deadman",
    "Segment": "links.core.deadman",
    "make_link": "links.make",
    "MavlinkLinkConfig": "links.mavlink.protocol.config",
    "CrsfLinkConfig": "links.rf.module_codec",
    "DsmLinkConfig": "links.rf.module_codec",
}
"""Public names, each with the module that is loaded at its first use (PEP 562)."""


def __getattr__(name: str) -> object:
    from importlib import import_module

    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)
