"""Simulated trackers: they sample the plant at the cameras' rate, and send real bytes to a source."""

import asyncio
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

from groundstation.core.geometry import Frames, Quat, Vec3, frames_of, so3
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
from groundstation.runtime import sleep_until
from links.io import parse_address
from links.mavlink.protocol import MavlinkCodec
from sim.world import PositionWander, Quadrotor, TrueState, World, rows, stream, with_noise

CLOCK_AHEAD_S = 1000.0
"""How far the tracking computer's clock is ahead of ours: nobody told them to agree [s]."""


class TrackedBody(NamedTuple):
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

    def send(self, frame: int, exposure_s: float, bodies: Sequence[TrackedBody]) -> None:
        """Send frame ``frame``, exposed at ``exposure_s`` [s, event loop's clock], now; our body is the first."""
        ...

    def close(self) -> None:
        """Leave the network."""
        ...


Encoder = Callable[[int, float, Sequence[TrackedBody]], bytes]
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
            from sim.trackers.qtm_server import NatNetServer

            return config.name, NatNetServer(config)
        case QualisysConfig():
            from sim.trackers.qtm_server import QtmServer

            return config.name, QtmServer(config)
        case _:
            return None


def vicon_encoder(config: ViconConfig) -> Encoder:
    """What a Vicon Tracker sends: a hidden object stands still."""
    frames = frames_of(config)

    def encode(frame: int, stamp_s: float, bodies: Sequence[TrackedBody]) -> bytes:
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

    def encode(frame: int, stamp_s: float, bodies: Sequence[TrackedBody]) -> bytes:
        return json_codec.encode(
            json_codec.json_pose(seen.name, *seen.pose(frames), t=stamp_s, frame=frame, valid=seen.tracked)
            for seen in bodies
        )

    return encode


def vision_encoder(config: VisionConfig) -> Encoder:
    """What a bridge sends: of our body only, and nothing while that is hidden."""
    frames = frames_of(config)
    codec = MavlinkCodec(config.system_id or 1, 197)  # MAV_COMP_ID_VISUAL_INERTIAL_ODOMETRY

    def encode(frame: int, stamp_s: float, bodies: Sequence[TrackedBody]) -> bytes:
        ours = bodies[0]
        if not ours.tracked:
            return b""
        return mavlink_codec.encode_vision(codec, mavlink_codec.VisionEstimate(stamp_s, *ours.pose(frames)))

    return encode


CIRCLE_M, APART_M, CIRCLE_RAD_S = 2.5, 0.5, 0.4
"""Where the other bodies are: radius of the first one's circle, and by how much each next one is larger; speed."""


class Mocap:
    """Cameras that run by themselves: their phase against our frames is drawn from the seed."""

    def __init__(self, world: World, plant: Quadrotor, seed: int, name: str, tracker: Tracker) -> None:
        """Have ``tracker`` send what the cameras see; the vehicle is called ``name``."""
        self._world = world
        self._plant = plant
        self._phase = stream(seed, "phase").random()
        self._noise = rows(stream(seed, "noise").standard_normal, 6)
        self._luck = rows(stream(seed, "pose loss").random, 1)
        self._wander = PositionWander(world, rows(stream(seed, "cameras' wander").standard_normal, 3))
        self._name = name
        self._tracker = tracker
        self._covered = False
        self._begun_s = 0.0
        self._last: tuple[Vec3, Quat] | None = None

    def cover(self, covered: bool) -> None:
        """Cover the cameras: no pose leaves until they are uncovered."""
        self._covered = covered

    def see(self, plant: Quadrotor) -> None:
        """From now on take that vehicle for ours."""
        self._plant = plant

    def through(self, wrap: Callable[[Tracker], Tracker]) -> None:
        """From now on let every frame pass what ``wrap`` puts before the tracking computer."""
        self._tracker = wrap(self._tracker)

    async def run(self) -> None:
        """Emit until cancelled."""
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
                # The instant of the exposure is the scheduled one: a late wake-up must not move the truth.
                truth = with_noise(self._plant.truth(when), world, next(self._noise))
                truth = self._wander.distort(truth, self._plant.released_s)
                if not self._loses(when, next(self._luck)[0]):
                    bodies = self._observe(truth, when)
                    if world.pose_latency_s > 0.0:
                        loop.call_at(when + world.pose_latency_s, self._tracker.send, frame, when, bodies)
                    else:
                        self._tracker.send(frame, when, bodies)
                frame += 1
        finally:
            self._tracker.close()

    def _observe(self, truth: TrueState, when: float) -> list[TrackedBody]:
        """Our body first: where it is hidden, the last that was seen of it."""
        world = self._world
        position, attitude = truth.position_ned, truth.attitude
        others = [_circling(n, when) for n in range(world.other_bodies)]
        hidden = self._mishap(when, world.occlusion_s, 0.5)
        if hidden and self._last is not None:
            position, attitude = self._last
        elif self._mishap(when, world.swap_s, 0.75):
            others[:1] = [(position, attitude)] if others else []
            position, attitude = _circling(0, when)
        self._last = position, attitude
        bodies = [TrackedBody(self._name, position, attitude, not hidden)]
        return bodies + [TrackedBody(f"other{n}", *pose, True) for n, pose in enumerate(others)]

    def _mishap(self, when: float, length_s: float, share: float) -> bool:
        """Whether one that begins after ``share`` of each period, and takes ``length_s``, is going on.

        The periods begin with the first frame, and anew as the vehicle is released: so a flight's do not depend on how
        long it was made ready.
        """
        if length_s <= 0.0:
            return False
        released, period = self._plant.released_s, self._world.mishap_period_s
        since = self._begun_s if released is None or when < released else released
        return 0.0 <= (when - since) % period - share * period < length_s

    def _loses(self, when: float, luck: float) -> bool:
        """Lost at random, or within one of the regular outages (the last part of each period)."""
        world = self._world
        if self._covered or luck < world.pose_loss:
            return True
        released = self._plant.released_s
        if not world.outage_s or released is None or when < released:
            return False
        return (when - released) % world.outage_period_s >= world.outage_period_s - world.outage_s


def _circling(number: int, when: float) -> tuple[Vec3, Quat]:
    angle = CIRCLE_RAD_S * when + number
    radius = CIRCLE_M + APART_M * number
    position = (radius * math.cos(angle), radius * math.sin(angle), -1.0)
    return position, so3.from_euler_zyx(0.0, 0.0, math.remainder(angle, math.tau))
