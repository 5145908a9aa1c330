"""Poses from a Vicon system: listens for the UDP Object Stream (vicon_codec.py has the bytes)."""

import asyncio
from collections.abc import Callable
from typing import Annotated

import msgspec

from groundstation.frames import Body, World, pose_to_ned_frd
from groundstation.poses.port import Pose, PoseStatus
from groundstation.poses.vicon_codec import ViconDecoder, ViconPose, name_bytes
from links.address import parse_address

RESTART_AFTER_S = 1.0
"""A frame number may step back once no pose was accepted for this long [s]."""


class ViconConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="vicon"):
    """Vicon Tracker's UDP Object Stream, which carries no time stamps and no validity flags."""

    object: str = "quad"
    """Name of the vehicle's object in Tracker."""
    listen: str = "127.0.0.1:51001"
    """Address that Tracker sends to, host:port of this machine."""
    world: World = "nwu"
    """Axes of the lab frame; ``nwu`` is the usual z-up frame, its x axis taken as north."""
    body: Body = "flu"
    """Axes of the object: ``flu`` is x forward, y left, z up."""
    latency_s: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.02
    """Time from the cameras' exposure to the arrival here [s]; the datagram does not tell."""
    rate_hz: Annotated[float, msgspec.Meta(gt=0.0, le=1000.0)] = 50.0
    """Poses per second that Tracker is set to send [1/s], for judging the stream."""
    drop_frozen: bool = True
    """Drop a pose that equals the one before to the last bit: nothing was measured, as when the object is hidden.
    Only a simulation without noise turns this off."""

    def __post_init__(self) -> None:
        """Check what the types cannot.

        Raises:
            ValueError: ``listen`` is no address, or ``object`` no name that fits the stream.
        """
        parse_address(self.listen)
        name_bytes(self.object)

    def build(self) -> "ViconSource":
        """The source of this config."""
        return ViconSource(self)


class ViconSource(asyncio.DatagramProtocol):
    """Delivers the poses of one object, each frame once and never one older than the last (see the port)."""

    def __init__(self, config: ViconConfig) -> None:
        self._config = config
        self._decoder = ViconDecoder(config.object)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._transport: asyncio.DatagramTransport | None = None
        self._deliver: Callable[[Pose], None] | None = None
        self._last: ViconPose | None = None
        self._accepted_s = 0.0
        self._accepted = 0
        self._resets = 0

    @property
    def status(self) -> PoseStatus:
        """Counters as they are now; adds duplicate, out_of_order and frozen to the decoder's reasons."""
        return PoseStatus(accepted=self._accepted, dropped=dict(self._decoder.dropped))

    @property
    def other_objects(self) -> tuple[str, ...]:
        """Names in the last datagram that lacked our object: tells a misspelt name from a silent stream."""
        return self._decoder.names

    async def start(self, deliver: Callable[[Pose], None]) -> None:
        """Begin to listen; ``deliver`` is called on the event loop for each pose.

        Raises:
            OSError: the address cannot be listened on; the message says which and why.
        """
        self._deliver = deliver
        self._loop = asyncio.get_running_loop()
        listen = self._config.listen
        try:
            self._transport, _ = await self._loop.create_datagram_endpoint(
                lambda: self, local_addr=parse_address(listen)
            )
        except OSError as error:
            reason = error.strerror or str(error)
            raise OSError(
                error.errno,
                f"cannot listen for Vicon poses on {listen} ({reason}); "
                "stop the program that holds this port, or give an address of this machine",
            ) from error

    async def close(self) -> None:
        """Stop listening; no pose is delivered afterwards."""
        self._deliver = None
        if self._transport is not None:
            self._transport.close()
            self._transport = None

    def datagram_received(self, data: bytes, addr: object) -> None:
        """Take one datagram (called by the event loop)."""
        if self._deliver is None or self._loop is None:
            return
        now = self._loop.time()
        seen = self._decoder.decode(data)
        if seen is None:
            return
        if self._last is not None:
            reason = self._stale(seen, self._last, now)
            if reason:
                self._decoder.dropped[reason] += 1
                return
        self._last = seen
        self._accepted_s = now
        pose_id = self._accepted
        self._accepted += 1
        position_ned, attitude = pose_to_ned_frd(seen.position_m, seen.attitude, self._config.world, self._config.body)
        self._deliver(
            Pose(pose_id, now - self._config.latency_s, now, position_ned, attitude, reset_count=self._resets)
        )

    def _stale(self, seen: ViconPose, last: ViconPose, now: float) -> str:
        """Why this pose tells nothing new, or an empty string."""
        # The counter has 32 bits: half of its circle is ahead, the other half behind.
        step = (seen.frame_number - last.frame_number) & 0xFFFFFFFF
        if step == 0:
            return "duplicate"
        if self._config.drop_frozen and (seen.position_m, seen.attitude) == (last.position_m, last.attitude):
            return "frozen"
        if step >= 0x80000000:
            # Tracker starts to count anew after a restart, and takes longer than this to do so. However large the
            # step, it does not count before: of two Trackers sending here at once only one is heard.
            if now - self._accepted_s <= RESTART_AFTER_S:
                return "out_of_order"
            self._resets += 1
        return ""
