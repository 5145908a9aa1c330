"""For each pose source: a reader as the source would make it, and the datagrams of a short flight for it.

Shared by the fuzzer, which damages them, and by the benchmark, which times them.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from groundstation.core.geometry import frames_of, so3
from groundstation.core.messages import Pose, PoseStatus
from groundstation.pose.sources import (
    DatagramReader,
    Intake,
    JsonConfig,
    JsonReader,
    LocalPositionDecoder,
    NatNetConfig,
    NatNetReader,
    OdometryDecoder,
    PoseDecoder,
    QualisysConfig,
    QualisysReader,
    ViconConfig,
    ViconReader,
    VisionConfig,
    VisionReader,
    natnet_codec,
)
from links.mavlink.protocol import MavlinkCodec, Message
from sim.trackers import NatNetServer, QtmServer, TrackedBody, json_encoder, vicon_encoder, vision_encoder

PERIOD_S = 0.01
"""Time from one datagram to the next [s]."""


class PoseFlight(NamedTuple):
    """One source's reader and what it is to read."""

    reader: DatagramReader
    datagrams: list[bytes]
    """One every ``PERIOD_S``; handshakes come before."""


def _bodies(frame: int) -> list[TrackedBody]:
    """Ours among two others; it moves, and turns a little."""
    t = frame * PERIOD_S
    ours = TrackedBody("quad", (0.5 * t, 1.0, -1.0), so3.from_euler_zyx(0.1, -0.05, 0.3 + 0.01 * t), True)
    return [ours, *(TrackedBody(f"other{n}", (2.0, float(n), -1.0), so3.IDENTITY, True) for n in range(2))]


def vicon(frames: int) -> PoseFlight:
    """Vicon's UDP Object Stream."""
    config = ViconConfig()
    encode = vicon_encoder(config)
    reader = ViconReader(config.object, Intake(0.0, frames_of(config), frame_s=PERIOD_S))
    return PoseFlight(reader, [encode(n, 0.0, _bodies(n)) for n in range(frames)])


def natnet(frames: int, version: natnet_codec.Version = (4, 1)) -> PoseFlight:
    """OptiTrack's NatNet, from the server's description on."""
    config = NatNetConfig()
    server = NatNetServer(config, version)
    data = [server.encode(n, n * PERIOD_S, n * PERIOD_S + 0.005, _bodies(n)) for n in range(frames)]
    reader = NatNetReader(config.name, Intake(0.0, frames_of(config)))
    for message in natnet_handshake(version):
        reader.read(message, 0.0)
    return PoseFlight(reader, data)


def natnet_handshake(version: natnet_codec.Version) -> list[bytes]:
    """What a server says before its first frame is of use."""
    server = NatNetServer(NatNetConfig(), version)
    server.encode(0, 0.0, 0.0, _bodies(0))
    return [natnet_codec.encode_server_info(server.info), server.models()]


def qualisys(frames: int) -> PoseFlight:
    """The contents of QTM's data packets, as qtm-rt hands them over."""
    config = QualisysConfig()
    server = QtmServer(config)
    reader = QualisysReader(config.name, Intake(0.0, frames_of(config)))
    reader.names = tuple(seen.name for seen in _bodies(0))
    return PoseFlight(reader, [server.encode(n, n * PERIOD_S, _bodies(n))[8:] for n in range(frames)])


def json(frames: int) -> PoseFlight:
    """JSON poses."""
    config = JsonConfig()
    encode = json_encoder(config)
    intakes = [Intake(0.0, frames_of(config), frame_s=s) for s in (None, PERIOD_S)]
    reader = JsonReader(config.name, *intakes)
    return PoseFlight(reader, [encode(n, n * PERIOD_S, _bodies(n)) for n in range(frames)])


def vision(frames: int) -> PoseFlight:
    """VISION_POSITION_ESTIMATE."""
    encode = vision_encoder(VisionConfig())
    return PoseFlight(VisionReader(Intake(0.0)), [encode(n, n * PERIOD_S, _bodies(n)) for n in range(frames)])


class MessageReader:
    """A decoder of MAVLink messages behind the link's codec, as a reader of datagrams."""

    def __init__(self, decoder: PoseDecoder) -> None:
        """Count frames that are none beside what ``decoder`` drops."""
        self._decoder = decoder
        self._codec = MavlinkCodec(255, 190)
        self._codec.dropped = decoder.dropped

    @property
    def status(self) -> PoseStatus:
        """Counters as they are now."""
        return self._decoder.status

    def read(self, datagram: bytes, arrival_s: float) -> Sequence[Pose]:
        """The poses that ``datagram`` completes."""
        made = (self._decoder.decode(message, arrival_s) for message in self._codec.feed_datagram(datagram))
        return [pose for pose in made if pose is not None]


def odometry(frames: int) -> PoseFlight:
    """ODOMETRY, as PX4 sends it."""
    codec = MavlinkCodec(1, 1)

    def message(n: int) -> Message:
        position, attitude = _bodies(n)[0][1:3]
        nothing = [float("nan")] * 21
        return codec.dialect.MAVLink_odometry_message(
            round(n * PERIOD_S * 1e6),
            1,
            1,
            *position,
            attitude,
            0.5,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
            nothing,
            nothing,
            0,
            8,
            0,
        )

    return PoseFlight(MessageReader(OdometryDecoder(0.0)), [codec.pack(message(n)) for n in range(frames)])


def local_position(frames: int) -> PoseFlight:
    """ATTITUDE_QUATERNION and LOCAL_POSITION_NED in one datagram, as ArduPilot may send them."""
    codec = MavlinkCodec(1, 1)
    d = codec.dialect
    datagrams = []
    for n in range(frames):
        position, attitude = _bodies(n)[0][1:3]
        stamp_ms = round(n * PERIOD_S * 1e3)
        turned = d.MAVLink_attitude_quaternion_message(stamp_ms, *attitude, 0.0, 0.0, 0.0)
        placed = d.MAVLink_local_position_ned_message(stamp_ms, *position, 0.5, 0.0, 0.0)
        datagrams.append(codec.pack(turned) + codec.pack(placed))
    return PoseFlight(MessageReader(LocalPositionDecoder(0.0)), datagrams)


FLIGHTS: dict[str, Callable[[int], PoseFlight]] = {
    "vicon": vicon,
    "natnet": natnet,
    "natnet 3.0": lambda frames: natnet(frames, (3, 0)),
    "qualisys": qualisys,
    "odometry": odometry,
    "local_position": local_position,
    "vision": vision,
    "json": json,
}
"""By name; a new source adds its own here."""
