"""The simulated radio: how a scenario's serial link is set up, and the bridge that stands before it."""

from collections.abc import Callable
from typing import Any

import msgspec

from groundstation.config import from_dict
from groundstation.core.vehicle import Vehicle
from groundstation.settings import Config
from links.bridge import Bridge, BridgeConfig, BridgeLinkConfig
from links.rf import RF_CODECS, RfConfig
from sim.radio.inline_pacer import WirePort, opened_on
from sim.world import World

KINDS = (*RF_CODECS, "rf_bridge")
"""Every link that ends at a radio's receiver."""
BEHIND_BRIDGE = "dsm"
"""The module that a simulated bridge has."""
FASTEST_STICK_DEG_S = 720.0
"""Body rate at full stick where the vehicle has no limit [deg/s]: a stick has few steps."""
KEY = bytes(range(32))
"""What a simulated station and bridge share."""


def section(kind: str, world: World, told: Vehicle) -> dict[str, Any]:
    """The link's section of a configuration; full stick is the vehicle's limit."""
    if kind == "rf_bridge":
        return {"kind": kind}
    rates = dict(zip(("roll", "pitch", "yaw"), told.rate_limits_deg_s, strict=True))
    order = RF_CODECS[kind]().map
    sticks = {
        axis: {**msgspec.to_builtins(getattr(order, axis)), "full_rate_deg_s": min(rate, FASTEST_STICK_DEG_S)}
        for axis, rate in rates.items()
    }
    sticks["arm"] = {"channel": 5}
    return {
        "kind": kind,
        "period_s": world.frame_period_s,
        "lead_s": min(0.005, 0.25 * world.frame_period_s),
        "map": sticks,
    }


def module(config: Config, world: World) -> RfConfig:
    """The module that the commands of ``config`` leave by in the end."""
    if isinstance(config.link, RfConfig):
        return config.link
    found = from_dict({"link": section(BEHIND_BRIDGE, world, config.vehicle)}, Config).link
    assert isinstance(found, RfConfig), "this section is a module's"
    return found


def wires(
    config: Config, radio: RfConfig, nonce: Callable[[int], bytes], port: WirePort
) -> tuple[dict[str, Any], Bridge | None]:
    """What the link of ``config`` gets in the place of hardware, and the bridge to run beside it, if it wants one.

    ``port`` is the wire to the module.
    """
    open_pacer = opened_on(port)
    if not isinstance(config.link, BridgeLinkConfig):
        return {"open_pacer": open_pacer}, None
    bridge = Bridge(BridgeConfig(listen=config.link.remote, link=radio), KEY, open_pacer=open_pacer, nonce=nonce)
    return {"key": KEY, "nonce": nonce}, bridge
