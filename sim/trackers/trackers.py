"""Simulated trackers: they sample the plant at the cameras' rate, and send real bytes to a source.

Two answer requests. QTM speaks its real-time protocol over TCP, as far as qtm-rt needs
it for 6D bodies; Motive answers NatNet clients and streams rigid bodies to them, or to a multicast
group.
"""

import asyncio
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol, TypeVar

import msgspec

from groundstation.core.geometry import Frames, Quat, Vec3, frames_of, so3
from groundstation.machine import sleep_until
from groundstation.pose import PoseConfig
from groundstation.pose.sources import (
    JsonConfig,
    NatNetConfig,
    QualisysConfig,
    UnreadableNatNet,
    ViconConfig,
    VisionConfig,
    json_codec,
    mavlink_codec,
    natnet_codec as natnet,
    qualisys_codec as qtm,
    send_by,
    vicon_codec,
)
from links.io import parse_address
from links.mavlink.protocol import MavlinkCodec
from sim.world import PositionWander, Quadrotor, World, generator, normals, rows, with_noise

CLOCK_AHEAD_S = 1000.0
"""Lead of the tracking computer's clock over ours [s]: the clocks are not synchronized."""


class TrackedBody(NamedTuple):
    """One body as the cameras see it."""

    name: str
    position_ned: Vec3
    attitude: Quat
    tracked: bool
    """False where it is hidden; the pose is then an old one."""

    def pose(self, frames: Frames) -> tuple[Vec3, Quat]:
        """Return position [m] and attitude in the axes of a lab."""
        return frames.to_theirs(self.position_ned, self.attitude)


class Tracker(Protocol):
    """The tracking computer."""

    async def open(self) -> None:
        """Join the network."""

    def send(self, frame: int, exposure_s: float, bodies: Sequence[TrackedBody]) -> None:
        """Send frame ``frame``, exposed at ``exposure_s`` [s, event loop's clock], now.

        Our body is the first.
        """

    def close(self) -> None:
        """Leave the network."""


W = TypeVar("W", bound=Tracker)
Encoder = Callable[[int, float, Sequence[TrackedBody]], bytes]
"""Frame number, its stamp [s, the tracker's clock] and the bodies → the datagram; empty: nothing is
sent."""


class UdpTracker:
    """Tracker that sends a datagram to an address for each frame."""

    def __init__(self, encode: Encoder, target: str) -> None:
        """``target`` is host:port."""
        self._encode = encode
        self._target = parse_address(target)
        self._transport: asyncio.DatagramTransport | None = None

    async def open(self) -> None:
        """Join the network."""
        loop = asyncio.get_running_loop()
        self._transport, _ = await loop.create_datagram_endpoint(
            asyncio.DatagramProtocol, remote_addr=self._target
        )

    def send(self, frame: int, exposure_s: float, bodies: Sequence[TrackedBody]) -> None:
        """Send one frame."""
        data = self._encode(frame, exposure_s + CLOCK_AHEAD_S, bodies)
        if data and self._transport is not None:
            self._transport.sendto(data)

    def close(self) -> None:
        """Leave the network."""
        if self._transport is not None:
            self._transport.close()
            self._transport = None


def make_tracker(configured: PoseConfig, yaw_deg: float = 0.0) -> tuple[str, Tracker] | None:
    """Return our body's name and the tracking system that ``configured`` expects.

    None where poses come some other way. The tracker's north is ``yaw_deg`` [deg] east of the
    configured one.
    """
    if configured.by_autopilot:
        return None
    config: Any = configured
    roll, pitch, yaw = config.alignment.lab_rotation_deg
    turned = msgspec.structs.replace(
        config.alignment, lab_rotation_deg=(roll, pitch, yaw + yaw_deg)
    )
    config = msgspec.structs.replace(config, alignment=turned)
    match config:
        case ViconConfig():
            return config.object, UdpTracker(vicon_encoder(config), config.listen)
        case JsonConfig():
            return config.name, UdpTracker(json_encoder(config), config.listen)
        case VisionConfig():
            return "quad", UdpTracker(vision_encoder(config), config.listen)
        case NatNetConfig():
            return config.name, NatNetServer(config)
        case QualisysConfig():
            return config.name, QtmServer(config)
        case _:
            return None


def vicon_encoder(config: ViconConfig) -> Encoder:
    """Return the encoder of a Vicon Tracker: an occluded object keeps its last pose."""
    frames = frames_of(config)

    def encode(frame: int, stamp_s: float, bodies: Sequence[TrackedBody]) -> bytes:
        objects = []
        for seen in bodies:
            (x, y, z), attitude = seen.pose(frames)
            angles = vicon_codec.euler_xyz_from_quaternion(attitude)
            objects.append(vicon_codec.ViconObject(seen.name, (1e3 * x, 1e3 * y, 1e3 * z), angles))
        # Vicon Tracker's block sizes: 3 objects fit into 256 bytes, 6 into 512.
        size = 256 if len(objects) <= 3 else 512 if len(objects) <= 6 else 1024
        return vicon_codec.encode(frame, objects, size)

    return encode


def json_encoder(config: JsonConfig) -> Encoder:
    """Return the encoder of a home-made tracker: an occluded body is not valid."""
    frames = frames_of(config)

    def encode(frame: int, stamp_s: float, bodies: Sequence[TrackedBody]) -> bytes:
        return json_codec.encode(
            json_codec.json_pose(
                seen.name, *seen.pose(frames), t=stamp_s, frame=frame, valid=seen.tracked
            )
            for seen in bodies
        )

    return encode


def vision_encoder(config: VisionConfig) -> Encoder:
    """Return the encoder of a bridge: our body only, and nothing while it is occluded."""
    frames = frames_of(config)
    codec = MavlinkCodec(config.system_id or 1, 197)  # MAV_COMP_ID_VISUAL_INERTIAL_ODOMETRY

    def encode(frame: int, stamp_s: float, bodies: Sequence[TrackedBody]) -> bytes:
        ours = bodies[0]
        if not ours.tracked:
            return b""
        return mavlink_codec.encode_vision(
            codec, mavlink_codec.VisionEstimate(stamp_s, *ours.pose(frames))
        )

    return encode


CIRCLE_M = 2.5
"""Radius of the circle on which the other bodies fly, one radian apart [m]. Chosen: off the
figures."""
CIRCLE_RAD_S = 0.4
"""Angular speed of the other bodies [rad/s]: they fly at 1 m/s."""


class SeenVehicle:
    """One vehicle before the cameras, and the noise of its measured poses."""

    def __init__(self, name: str, plant: Quadrotor, world: World, seed: int) -> None:
        """Track the vehicle ``name``; the noise is drawn from ``seed``."""
        self.name, self.plant = name, plant
        self._world = world
        self._noise = normals(seed, "noise", 6)
        self._wander = PositionWander(world, normals(seed, "cameras' wander", 3))

    def measure(self, when: float) -> tuple[Vec3, Quat]:
        """Return position [m, NED] and attitude as the cameras measure them at ``when`` [s]."""
        truth = with_noise(self.plant.truth(when), self._world, next(self._noise))
        truth = self._wander.distort(truth, self.plant.released_s)
        return truth.position_ned, truth.attitude


OCCLUSION_SHARE = 0.5
"""Share of each mishap period after which our body is occluded [-]. Chosen: apart from a swap."""
SWAP_SHARE = 0.75
"""Share of each mishap period after which two bodies are swapped [-]. Chosen, as above."""


class Mocap:
    """Cameras that run by themselves; their phase against our frames is drawn from the seed."""

    def __init__(
        self,
        world: World,
        vehicles: Sequence[SeenVehicle],
        seed: int,
        tracker: Tracker,
        standing: Sequence[tuple[str, Vec3]] = (),
    ) -> None:
        """Have ``tracker`` send the measured poses of ``vehicles``.

        Occlusions and losses are those of the first one. ``standing`` are further bodies at rest,
        each by its name and position [m, NED].
        """
        self._standing = [
            TrackedBody(other, place, so3.IDENTITY, True) for other, place in standing
        ]
        self._world = world
        self._vehicles = vehicles
        self._phase = generator(seed, "phase").random()
        self._luck = rows(generator(seed, "pose loss").random, 1)
        self._tracker = tracker
        self.hidden: set[str] = set()
        """Names of the vehicles that the cameras do not see now."""
        self.sent_s: float | None = None
        """Instant at which the newest frame left, on the event loop's clock [s]."""
        self._covered = False
        self._begun_s = 0.0
        self._last: dict[str, tuple[Vec3, Quat]] = {}

    def cover(self, covered: bool) -> None:
        """Cover the cameras: no pose leaves until they are uncovered."""
        self._covered = covered

    def see(self, plant: Quadrotor) -> None:
        """Track ``plant`` as our vehicle from now on."""
        self._vehicles[0].plant = plant

    def through(self, wrap: Callable[[Tracker], W]) -> W:
        """Wrap the tracking computer, and return the wrapper: every frame passes it from now on."""
        self._tracker = wrapped = wrap(self._tracker)
        return wrapped

    async def run(self) -> None:
        """Send frames until cancelled."""
        loop = asyncio.get_running_loop()
        world = self._world
        await self._tracker.open()
        period = 1.0 / world.pose_rate_hz
        start = self._begun_s = loop.time() + self._phase * period
        frame = 0
        try:
            while True:
                when = start + frame * period
                await sleep_until(when)
                # The instant of the exposure is the scheduled one: a late wake-up must not move the
                # truth.
                poses = [vehicle.measure(when) for vehicle in self._vehicles]
                if not self._loses(when, next(self._luck)[0]):
                    bodies = self._observe(poses, when)
                    if world.pose_latency_s > 0.0:
                        loop.call_at(when + world.pose_latency_s, self._send, frame, when, bodies)
                    else:
                        self._send(frame, when, bodies)
                frame += 1
        finally:
            self._tracker.close()

    def _send(self, frame: int, when: float, bodies: Sequence[TrackedBody]) -> None:
        self.sent_s = asyncio.get_running_loop().time()
        self._tracker.send(frame, when, bodies)

    def _observe(self, poses: Sequence[tuple[Vec3, Quat]], when: float) -> list[TrackedBody]:
        """Return all bodies, ours first; a hidden one keeps the last pose that was measured."""
        world = self._world
        others = [_circling(n, when) for n in range(world.other_bodies)]
        bodies = []
        for number, (vehicle, true) in enumerate(zip(self._vehicles, poses, strict=True)):
            pose = true
            occluded = number == 0 and self._is_during(when, world.occlusion_s, OCCLUSION_SHARE)
            hidden = occluded or vehicle.name in self.hidden
            if hidden:
                pose = self._last.get(vehicle.name, pose)
            elif number == 0 and self._is_during(when, world.swap_s, SWAP_SHARE):
                others[:1] = [pose] if others else []
                pose = _circling(0, when)
            self._last[vehicle.name] = pose
            bodies.append(TrackedBody(vehicle.name, *pose, not hidden))
        return (
            bodies
            + [TrackedBody(f"other{n}", *pose, True) for n, pose in enumerate(others)]
            + self._standing
        )

    def _is_during(self, when: float, length_s: float, share: float) -> bool:
        """Return whether a mishap is going on that begins after ``share`` of each period [-], and
        takes ``length_s`` [s].

        The periods begin with the first frame, and anew as the vehicle is released: those of a
        flight do not depend on the time of its preparation.
        """
        if length_s <= 0.0:
            return False
        released, period = self._vehicles[0].plant.released_s, self._world.mishap_period_s
        since = self._begun_s if released is None or when < released else released
        return 0.0 <= (when - since) % period - share * period < length_s

    def _loses(self, when: float, luck: float) -> bool:
        """Return whether a frame is lost: at random, or in an outage, the last part of each
        period.
        """
        world = self._world
        if self._covered or luck < world.pose_loss:
            return True
        released = self._vehicles[0].plant.released_s
        if not world.outage_s or released is None or when < released:
            return False
        return (when - released) % world.outage_period_s >= world.outage_period_s - world.outage_s


def _circling(number: int, when: float) -> tuple[Vec3, Quat]:
    """Return position [m, NED] and attitude of another body at ``when`` [s]."""
    angle = CIRCLE_RAD_S * when + number
    position = (CIRCLE_M * math.cos(angle), CIRCLE_M * math.sin(angle), -1.0)
    return position, so3.from_euler_zyx(0.0, 0.0, math.remainder(angle, math.tau))


NEWEST_MINOR = 25
"""Newest minor version of the protocol: 1.8 to 1.25 are spoken, as by QTM of 2024 [-]."""


class QtmServer:
    """Implements :class:`sim.trackers.trackers.Tracker` at the address where ``config`` expects
    QTM.
    """

    def __init__(self, config: QualisysConfig) -> None:
        self._frames = frames_of(config)
        self.names: tuple[str, ...] = (config.name,)
        self._address = parse_address(config.server)
        self._server: asyncio.AbstractServer | None = None
        self.clients: set[QtmClient] = set()

    async def open(self) -> None:
        """Listen for clients."""
        self._server = await asyncio.get_running_loop().create_server(
            lambda: QtmClient(self), *self._address
        )

    def close(self) -> None:
        """Leave the network."""
        for client in tuple(self.clients):
            client.close()
        if self._server is not None:
            self._server.close()
            self._server = None

    def send(self, frame: int, exposure_s: float, bodies: Sequence[TrackedBody]) -> None:
        """Stream one frame."""
        self.names = tuple(seen.name for seen in bodies)
        data = self.encode(frame, exposure_s, bodies)
        for client in self.clients:
            client.stream(data)

    def encode(self, frame: int, exposure_s: float, bodies: Sequence[TrackedBody]) -> bytes:
        """Return the packet of one frame; a hidden body is full of NaN."""
        poses = [seen.pose(self._frames) if seen.tracked else None for seen in bodies]
        return qtm.encode_data(round((exposure_s + CLOCK_AHEAD_S) * 1e6), frame, poses)


class QtmClient(asyncio.Protocol):
    """Connection of one client to the simulated QTM."""

    def __init__(self, server: QtmServer) -> None:
        self._server = server
        self._framer = qtm.Framer()
        self._streaming = False
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Greet (called by the event loop)."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._server.clients.add(self)
        self._say(qtm.RtPacket.COMMAND, "QTM RT Interface connected")

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the client (called by the event loop)."""
        self._transport = None
        self._server.clients.discard(self)

    def data_received(self, data: bytes) -> None:
        """Answer commands (called by the event loop)."""
        for packet in self._framer.feed(data):
            self._answer(packet[8:].rstrip(b"\0").decode("ascii", "replace").lower())
        if self._framer.broken:
            self.close()

    def _answer(self, command: str) -> None:
        match command.split():
            case ["version", version]:
                if int(version.rpartition(".")[2]) <= NEWEST_MINOR:
                    self._say(qtm.RtPacket.COMMAND, f"Version set to {version}")
                else:
                    self._say(qtm.RtPacket.ERROR, "Version NOT supported")
            case ["getparameters", *_]:
                self._say(qtm.RtPacket.XML, qtm.parameters_xml(self._server.names))
            case ["streamframes", "stop"]:
                self._streaming = False
            case ["streamframes", *_]:
                self._streaming = True
            case _:
                self._say(qtm.RtPacket.ERROR, "Parse error")

    def _say(self, kind: int, text: str) -> None:
        if self._transport is not None:
            self._transport.write(qtm.text_packet(kind, text))

    def stream(self, data: bytes) -> None:
        """Send one frame, if the client has requested frames."""
        if self._streaming and self._transport is not None:
            self._transport.write(data)

    def close(self) -> None:
        """Close the connection."""
        if self._transport is not None:
            self._transport.close()


TICKS_PER_S = 10_000_000
"""Ticks of Windows' performance counter [1/s]."""
FORGET_S = 5.0
"""Silence after which a unicast client gets no more frames [s]: ten of its keep-alives."""


class NatNetServer(asyncio.DatagramProtocol):
    """Implements :class:`sim.trackers.trackers.Tracker` at the address where ``config`` expects its
    server.
    """

    def __init__(self, config: NatNetConfig, version: natnet.Version = (4, 1)) -> None:
        """Speak NatNet ``version``."""
        self._config = config
        self._frames = frames_of(config)
        host, port = parse_address(config.server)
        self._address = (host, port)
        self.info = natnet.ServerInfo(
            "Motive", version, TICKS_PER_S, config.data_port, config.multicast, config.group
        )
        self._transport: asyncio.DatagramTransport | None = None
        self._clients: dict[Any, float] = {}
        self._ids: dict[str, int] = {config.name: 1}

    async def open(self) -> None:
        """Listen for clients."""
        loop = asyncio.get_running_loop()
        self._transport, _ = await loop.create_datagram_endpoint(
            lambda: self, local_addr=self._address
        )
        if self._config.multicast:
            send_by(self._transport, self._config.interface)

    def close(self) -> None:
        """Leave the network."""
        if self._transport is not None:
            self._transport.close()
            self._transport = None

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Answer a client (called by the event loop)."""
        try:
            number, _ = natnet.split(data)
        except UnreadableNatNet:
            return
        self._clients[addr] = asyncio.get_running_loop().time()
        if number == natnet.NatNetMessage.CONNECT:
            self._answer(natnet.encode_server_info(self.info), addr)
        elif number == natnet.NatNetMessage.REQUEST_MODELDEF:
            self._answer(self.models(), addr)

    def _answer(self, data: bytes, addr: Any) -> None:
        if self._transport is not None:
            self._transport.sendto(data, addr)

    def send(self, frame: int, exposure_s: float, bodies: Sequence[TrackedBody]) -> None:
        """Stream one frame."""
        now_s = asyncio.get_running_loop().time()
        config = self._config
        data = self.encode(frame, exposure_s, now_s, bodies)
        if config.multicast:
            self._answer(data, (config.group, config.data_port))
            return
        self._clients = {
            client: heard for client, heard in self._clients.items() if now_s - heard < FORGET_S
        }
        for client in self._clients:
            self._answer(data, client)

    def models(self) -> bytes:
        """Return the description of all bodies that were streamed so far."""
        return natnet.encode_models(self._ids, self.info.version)

    def encode(
        self, frame: int, exposure_s: float, transmit_s: float, bodies: Sequence[TrackedBody]
    ) -> bytes:
        """Return the packet of one frame; a hidden body's last pose is marked as not tracked."""
        rigid = []
        for seen in bodies:
            position, (w, x, y, z) = seen.pose(self._frames)
            number = self._ids.setdefault(seen.name, len(self._ids) + 1)
            mean_error_m = 0.0002
            rigid.append(
                natnet.RigidBody(number, position, (x, y, z, w), mean_error_m, seen.tracked)
            )
        exposure, transmit = (
            round((s + CLOCK_AHEAD_S) * TICKS_PER_S) for s in (exposure_s, transmit_s)
        )
        return natnet.encode_frame(
            natnet.NatNetFrame(frame, tuple(rigid), exposure, transmit),
            self.info.version,
            ticks_per_s=TICKS_PER_S,
        )
