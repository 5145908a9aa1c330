"""How commands leave: every kind of link, by the name that a configuration gives it (``kind = "mavlink"``)."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from links.port import CommandLink


def _mavlink() -> "tuple[type, Callable[..., CommandLink]]":
    from links.mavlink import MavlinkLink, MavlinkLinkConfig

    return MavlinkLinkConfig, MavlinkLink


LINKS: "dict[str, Callable[[], tuple[type, Callable[..., CommandLink]]]]" = {"mavlink": _mavlink}
"""Kind → a function that imports it and returns its configuration and its class."""


def make_link(config: Any, *, thrust_max_n: float, thrust_curve: float = 0.0) -> "CommandLink":
    """The link that ``config``, the configuration of one kind, describes.

    ``thrust_max_n`` is the thrust of the full signal [N], ``thrust_curve`` the vehicle's (see thrust_curve.py).

    Raises:
        TypeError: ``config`` is the configuration of no link.
    """
    for load in LINKS.values():
        config_type, link_type = load()
        if isinstance(config, config_type):
            return link_type(config, thrust_max_n=thrust_max_n, thrust_curve=thrust_curve)
    raise TypeError(f"no link is configured by {config!r}")
