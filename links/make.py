"""Links by kind: each one by the name that a configuration gives it (``kind = "mavlink"``)."""

from importlib import import_module

TYPE_CHECKING = False  # typing's own would have to be imported, also for --help
if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

    from links.core import CommandLink

LINKS = {
    "mavlink": ("links.mavlink", "MavlinkLink"),
    "dsm": ("links.rf", "SerialRfLink"),
    "crsf": ("links.rf", "SerialRfLink"),
    "rf_bridge": ("links.bridge", "BridgeLink"),
}
"""Kind → the room that is imported for it, and the link's class there."""


def make_link(
    config: "Any", *, thrust_max_n: float, thrust_curve: float = 0.0, **wires: "Any"
) -> "CommandLink":
    """The link that ``config``, the configuration of one kind, describes.

    ``thrust_max_n`` is the thrust of the full signal [N], ``thrust_curve`` the vehicle's
    (:func:`links.core.deadman.signal`).

    ``wires`` go to the link as they are: what a simulation puts in the place of hardware.
    """
    room, name = LINKS[config.kind]
    link_type: Callable[..., CommandLink] = getattr(import_module(room), name)
    return link_type(config, thrust_max_n=thrust_max_n, thrust_curve=thrust_curve, **wires)
