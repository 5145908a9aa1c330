"""A body that moves, as a tracker and as an autopilot see it, and what the witness says of the two."""

import math
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from groundstation.core.geometry import Quat, Vec3, so3
from groundstation.core.messages import Pose
from groundstation.core.safety import Agreement, Witness
from links.core import Attitude

ARMED_S = 10.0
"""It stands until then."""
ZERO: Vec3 = (0.0, 0.0, 0.0)

Lie = Callable[[float, Quat], Quat]
"""(time [s], true attitude) → what the tracker says."""


@dataclass(frozen=True)
class Motion:
    """Roll, pitch and yaw each swing by so much [deg] and so often [Hz] once it flies."""

    swing_deg: Vec3 = (12.0, 9.0, 20.0)
    swing_hz: Vec3 = (0.5, 0.37, 0.2)

    def angles(self, time_s: float) -> Vec3:
        """[rad]"""
        since = max(time_s - ARMED_S - 1.0, 0.0)
        rise = min(since, 1.0)
        roll, pitch, yaw = (
            rise * math.radians(deg) * math.sin(2.0 * math.pi * hz * since)
            for deg, hz in zip(self.swing_deg, self.swing_hz, strict=True)
        )
        return roll, pitch, yaw

    def attitude(self, time_s: float) -> Quat:
        """Body FRD to NED."""
        return so3.from_euler_zyx(*self.angles(time_s))

    def rates(self, time_s: float) -> Vec3:
        """Body rates [rad/s]."""
        h = 1e-4
        turn = so3.multiply(so3.conjugate(self.attitude(time_s - h)), self.attitude(time_s + h))
        x, y, z = so3.rotation_vector(turn)
        return x / (2.0 * h), y / (2.0 * h), z / (2.0 * h)


@dataclass(frozen=True)
class Scene:
    """Twenty seconds: it stands for ten, then it flies."""

    motion: Motion = Motion()
    seed: int = 0
    pose_hz: float = 100.0
    pose_late_s: float = 0.02
    noise_deg: float = 0.15
    """Of the poses' attitude, 1σ an axis."""
    askew_deg: Vec3 = ZERO
    """How the tracked body is mounted: roll, pitch, yaw."""
    heading_deg: float = 70.0
    """The autopilot's north against the tracker's."""
    told_hz: float = 50.0
    told_late_s: float = 0.01
    told_jitter_s: float = 0.0
    """How late the autopilot's messages come beyond that, at most."""
    told_loss: float = 0.0
    clocks_apart_s: float = 0.0
    """How much younger the autopilot's stamps are on our clock than they should be."""
    slow_error_deg: float = 0.5
    pulled_upright: float = 0.0
    """The share of a lean that the autopilot takes for level."""
    vibration_deg_s: float = 0.0
    """Of the gyros, 1σ an axis, beyond what turns the body."""
    resets: tuple[tuple[float, float], ...] = ()
    """When [s] the autopilot's heading leaps, and by how much [deg]."""
    dropouts: tuple[tuple[float, float], ...] = ()
    """From when to when no pose comes [s]."""
    stamped: bool = True
    """Whether the autopilot's time is known; else messages are true as they come."""
    gyros: bool = True
    """Whether the autopilot tells its rates; a radio does not."""
    until_s: float = 20.0
    lies: tuple[tuple[float, Lie], ...] = field(default=())
    """From when on the tracker says something else."""

    def events(self) -> Iterator[tuple[float, Pose | Attitude]]:
        """What arrives, and when [s], in order."""
        rng = random.Random(self.seed)
        events: list[tuple[float, int, Pose | Attitude]] = []
        roll, pitch, yaw = map(math.radians, self.askew_deg)
        mounted = so3.from_euler_zyx(roll, pitch, yaw)
        noise = math.radians(self.noise_deg)
        for n in range(int(self.pose_hz * self.until_s)):
            time_s = n / self.pose_hz
            attitude = so3.multiply(self.motion.attitude(time_s), mounted)
            for since_s, lie in self.lies:
                if time_s >= since_s:
                    attitude = lie(time_s, attitude)
            attitude = so3.rotate(attitude, (rng.gauss(0.0, noise), rng.gauss(0.0, noise), rng.gauss(0.0, noise)))
            if not any(begin <= time_s < end for begin, end in self.dropouts):
                arrival = time_s + self.pose_late_s
                events.append((arrival, n, Pose(n, time_s, arrival, ZERO, attitude)))
        arrival = 0.0
        for n in range(int(self.told_hz * self.until_s)):
            time_s = n / self.told_hz + 0.003
            late = self.told_late_s + rng.random() * self.told_jitter_s
            told = self._told(time_s, rng)
            if rng.random() >= self.told_loss:
                arrival = max(arrival + 1e-6, time_s + late)
                stamp = time_s + self.clocks_apart_s if self.stamped else arrival
                events.append((arrival, n, Attitude(stamp, told[0], told[1] if self.gyros else None)))
        events.sort(key=lambda event: event[:2])
        for arrival, _, what in events:
            yield arrival, what

    def _told(self, time_s: float, rng: random.Random) -> tuple[Quat, Vec3]:
        slow = math.radians(self.slow_error_deg)
        error = (slow * math.sin(0.31 * time_s + 1.0), slow * math.sin(0.23 * time_s), 0.0)
        roll, pitch, yaw = self.motion.angles(time_s)
        upright = 1.0 - self.pulled_upright
        attitude = so3.rotate(so3.from_euler_zyx(upright * roll, upright * pitch, yaw), error)
        heading = self.heading_deg + sum(by for when, by in self.resets if time_s >= when)
        attitude = so3.multiply(so3.from_euler_zyx(0.0, 0.0, math.radians(heading)), attitude)
        p, q, r = self.motion.rates(time_s)
        shake = math.radians(self.vibration_deg_s)
        return attitude, (p + rng.gauss(0.0, shake), q + rng.gauss(0.0, shake), r + rng.gauss(0.0, shake))


def heard(scene: Scene, armed_s: float = ARMED_S) -> list[tuple[float, Agreement | None]]:
    """What the witness says after each message and pose, and when that came [s]; it is armed at ``armed_s``."""
    witness, armed, said = Witness(), False, list[tuple[float, Agreement | None]]()
    for arrival, what in scene.events():
        if arrival >= armed_s and not armed:
            armed = True
            witness.arm()
        if isinstance(what, Pose):
            witness.pose(what)
        else:
            witness.attitude(what)
        said.append((arrival, witness.verdict(arrival)))
    return said


def largest(scene: Scene) -> float:
    """The largest statistic as a share of its threshold."""
    shares = [told.share for _, told in heard(scene) if told is not None]
    assert len(shares) > 1000, "the witness was silent"
    return max(shares)


def doubted_s(scene: Scene) -> float | None:
    """When it was first known that they disagree [s]."""
    return next((when for when, told in heard(scene) if told is not None and told.doubts_s is not None), None)


def warned(scene: Scene) -> list[tuple[float, str]]:
    """What the operator is told of it in flight, and when [s]."""
    witness, armed, said = Witness(), False, list[tuple[float, str]]()
    for arrival, what in scene.events():
        if arrival >= ARMED_S and not armed:
            armed = True
            witness.arm()
        if isinstance(what, Pose):
            witness.pose(what)
            if armed and (news := witness.describe_news()):
                said.append((arrival, news))
        else:
            witness.attitude(what)
    return said
