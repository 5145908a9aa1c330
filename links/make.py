"""Links by kind: each one by the name that a configuration gives it (``kind = "mavlink"``)."""

from collections.abc import Callable

TYPE_CHECKING = False  # typing's own would have to be imported, also for --help
if TYPE_CHECKING:
    from typing import Any

    from links.core import CommandLink


def _mavlink() -> "tuple[type, Callable[..., CommandLink]]":
    from links.mavlink import MavlinkLink, MavlinkLinkConfig

    return MavlinkLinkConfig, MavlinkLink


def _dsm() -> "tuple[type, Callable[..., CommandLink]]":
    from links.rf import DsmLinkConfig, SerialRfLink

    return DsmLinkConfig, SerialRfLink


def _crsf() -> "tuple[type, Callable[..., CommandLink]]":
    from links.rf import CrsfLinkConfig, SerialRfLink

    return CrsfLinkConfig, SerialRfLink


def _rf_bridge() -> "tuple[type, Callable[..., CommandLink]]":
    from links.bridge import BridgeLink, BridgeLinkConfig

    return BridgeLinkConfig, BridgeLink


LINKS: "dict[str, Callable[[], tuple[type, Callable[..., CommandLink]]]]" = {
    "mavlink": _mavlink,
    "dsm": _dsm,
    "crsf": _crsf,
    "rf_bridge": _rf_bridge,
}
"""Kind → a function that imports it and returns its configuration and its class."""


def make_link(config: "Any", *, thrust_max_n: float, thrust_curve: float = 0.0, **wires: "Any") -> "CommandLink":
    """The link that ``config``, the configuration of one kind, describes.

    ``thrust_max_n`` is the thrust of the full signal [N], ``thrust_curve`` the vehicle's
    (:func:`links.core.deadman.signal`).

    ``wires`` go to the link as they are: what a simulation puts in the place of hardware.

    Raises:
        TypeError: ``config`` is the configuration of no link.
    """
    for load in LINKS.values():
        config_type, link_type = load()
        if isinstance(config, config_type):
            return link_type(config, thrust_max_n=thrust_max_n, thrust_curve=thrust_curve, **wires)
    raise TypeError(f"no link is configured by {config!r}")
