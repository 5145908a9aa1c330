"""What each kind of tracking system sends, as real bytes, to the source that a config describes."""

import asyncio
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

from groundstation.core.geometry import Frames, Quat, Vec3, frames_of
from groundstation.pose import PoseConfig
from groundstation.pose.sources import (
    JsonConfig,
    NatNetConfig,
    QualisysConfig,
    ViconConfig,
    VisionConfig,
    json_codec,
    mavlink_codec,
    vicon_codec,
)
from links.io import parse_address
from links.mavlink.protocol import MavlinkCodec

CLOCK_AHEAD_S = 1000.0
"""How far the tracking computer's clock is ahead of ours: nobody told them to agree [s]."""


class Seen(NamedTuple):
    """One body as the cameras see it."""

    name: str
    position_ned: Vec3
    attitude: Quat
    tracked: bool
    """False where it is hidden; the pose is then an old one."""

    def pose(self, frames: Frames) -> tuple[Vec3, Quat]:
        """Position [m] and attitude in the axes of a lab."""
        return frames.theirs(self.position_ned, self.attitude)


class Tracker(Protocol):
    """The tracking computer."""

    async def open(self) -> None:
        """Join the network."""
        ...

    def send(self, frame: int, exposure_s: float, bodies: Sequence[Seen]) -> None:
        """Send frame ``frame``, exposed at ``exposure_s`` [s, event loop's clock], now; our body is the first."""
        ...

    def close(self) -> None:
        """Leave the network."""
        ...


Encoder = Callable[[int, float, Sequence[Seen]], bytes]
"""Frame number, its stamp [s, the tracker's clock] and the bodies → the datagram; empty: nothing is sent."""


class UdpTracker:
    """Sends a datagram for each frame to whoever listens at an address."""

    def __init__(self, encode: Encoder, target: str) -> None:
        """``target`` is host:port."""
        self._encode = encode
        self._target = parse_address(target)
        self._transport: asyncio.DatagramTransport | None = None

    async def open(self) -> None:
        """Join the network."""
        loop = asyncio.get_running_loop()
        self._transport, _ = await loop.create_datagram_endpoint(asyncio.DatagramProtocol, remote_addr=self._target)

    def send(self, frame: int, exposure_s: float, bodies: Sequence[Seen]) -> None:
        """Send one frame."""
        data = self._encode(frame, exposure_s + CLOCK_AHEAD_S, bodies)
        if data and self._transport is not None:
            self._transport.sendto(data)

    def close(self) -> None:
        """Leave the network."""
        if self._transport is not None:
            self._transport.close()
            self._transport = None


def make_tracker(config: PoseConfig) -> tuple[str, Tracker] | None:
    """Our body's name and the tracking system that ``config`` expects; None where poses come some other way."""
    match config:
        case ViconConfig():
            return config.object, UdpTracker(vicon_encoder(config), config.listen)
        case JsonConfig():
            return config.name, UdpTracker(json_encoder(config), config.listen)
        case VisionConfig():
            return "quad", UdpTracker(vision_encoder(config), config.listen)
        case NatNetConfig():
            from sim.trackers.natnet_server import NatNetServer

            return config.name, NatNetServer(config)
        case QualisysConfig():
            from sim.trackers.qtm_server import QtmServer

            return config.name, QtmServer(config)
        case _:
            return None


def vicon_encoder(config: ViconConfig) -> Encoder:
    """What a Vicon Tracker sends: a hidden object stands still."""
    frames = frames_of(config)

    def encode(frame: int, stamp_s: float, bodies: Sequence[Seen]) -> bytes:
        objects = []
        for seen in bodies:
            (x, y, z), attitude = seen.pose(frames)
            angles = vicon_codec.euler_xyz_from_quaternion(attitude)
            objects.append(vicon_codec.ViconObject(seen.name, (1e3 * x, 1e3 * y, 1e3 * z), angles))
        size = next(s for s, room in zip(vicon_codec.DATAGRAM_SIZES, (3, 6, 13), strict=True) if len(objects) <= room)
        return vicon_codec.encode(frame, objects, size)

    return encode


def json_encoder(config: JsonConfig) -> Encoder:
    """What a home-made tracker sends: a hidden body is not valid."""
    frames = frames_of(config)

    def encode(frame: int, stamp_s: float, bodies: Sequence[Seen]) -> bytes:
        return json_codec.encode(
            json_codec.json_pose(seen.name, *seen.pose(frames), t=stamp_s, frame=frame, valid=seen.tracked)
            for seen in bodies
        )

    return encode


def vision_encoder(config: VisionConfig) -> Encoder:
    """What a bridge sends: of our body only, and nothing while that is hidden."""
    frames = frames_of(config)
    codec = MavlinkCodec(config.system_id or 1, 197)  # MAV_COMP_ID_VISUAL_INERTIAL_ODOMETRY

    def encode(frame: int, stamp_s: float, bodies: Sequence[Seen]) -> bytes:
        ours = bodies[0]
        if not ours.tracked:
            return b""
        return mavlink_codec.encode_vision(codec, mavlink_codec.VisionEstimate(stamp_s, *ours.pose(frames)))

    return encode
