"""The link to an RF bridge: the pacer and the module are on another computer, as in the paper's set-up.

To the link it is a pacer like any other (links/rf/paced_link.py, links/bridge/remote_pacer.py).
"""

import os
from pathlib import Path
from typing import Annotated

import msgspec

from links.bridge.remote_pacer import UNTIL_TOLD, Nonce, RemotePacer
from links.core.port import LinkLost
from links.io.address import beyond, parse_address
from links.io.key_file import read_key
from links.rf.paced_link import PacedLink
from links.rf.pacer_messages import Hear


class BridgeLinkConfig(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag="rf_bridge", tag_field="kind"
):
    """`groundstation rf-bridge` on another computer, which has the module. That one knows port, codec and channels."""

    remote: str = "127.0.0.1:14600"
    """Its address."""
    key_file: str = "bridge.key"
    """File with the key that both computers share, mode 0600; `groundstation rf-bridge --make-key FILE` makes one."""
    connect_timeout_s: Annotated[float, msgspec.Meta(gt=0.0, le=60.0)] = 5.0
    """How long to wait for the bridge [s]."""

    def __post_init__(self) -> None:
        """Check what the types cannot.

        Raises:
            ValueError: ``remote`` is no address.
        """
        parse_address(self.remote)

    @property
    def real(self) -> str | None:
        """The key that may lead to a real vehicle, and its value; None where all stays on this machine.

        A bridge with a real module takes no station of its own machine (links/bridge/server.py).
        """
        return beyond("remote", self.remote)

    @property
    def thrust_curve(self) -> None:
        """None: the vehicle's counts."""
        return None


class BridgeLink(PacedLink):
    """Implements :class:`links.core.port.CommandLink` (see there)."""

    def __init__(
        self,
        config: BridgeLinkConfig,
        *,
        thrust_max_n: float,
        thrust_curve: float = 0.0,
        key: bytes | None = None,
        nonce: Nonce = os.urandom,
    ) -> None:
        """Nothing is opened yet; ``thrust_max_n`` is the thrust at full throttle [N].

        ``thrust_curve`` is the vehicle's (links/core/thrust_curve.py); the bridge's own is applied on top. ``key``
        stands for the key file, and ``nonce`` for chance, where a simulation has its own.
        """

        async def open_pacer(hear: Hear) -> RemotePacer:
            try:
                shared = read_key(Path(config.key_file)) if key is None else key
            except ValueError as error:
                raise LinkLost(str(error)) from None
            pacer = RemotePacer(config.remote, thrust_max_n, thrust_curve, shared, nonce, hear)
            await pacer.open(config.connect_timeout_s)
            return pacer

        super().__init__(UNTIL_TOLD, open_pacer)
