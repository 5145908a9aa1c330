"""Wrong pictures of the cameras, and ways of frames: late, seldom, repeated, wrongly stamped."""

import asyncio
import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from groundstation.core.geometry import Quat, Vec3, so3
from sim.trackers import TrackedBody
from sim.world import World

NOISE_M = World().pose_noise_m
"""Position noise of invented poses [m], 1σ an axis: as much as the cameras' own."""
NOISE_RAD = World().attitude_noise_rad
"""Attitude noise of invented poses [rad], 1σ an axis."""
NEAR_M = 0.08
"""Distance of another body that is taken for ours in flight [m]: too near for a visible jump."""
CARRY_M_S = 0.5
"""Speed at which a hand carries a body [m/s]."""
CARRY_TILT_DEG = 10.0
"""Tilt of the carried body [deg]."""
CARRY_RAMP_S = 0.5
"""Time to reach that speed [s]."""


class Struck(NamedTuple):
    """When and where a picture begins to be wrong."""

    time_s: float
    """[s]"""
    position_ned: Vec3
    """Position shown last, or the place before anything was shown [m]."""
    attitude: Quat
    normals: Iterator[tuple[float, ...]]
    """Rows of six standard normal numbers."""


Picture = Callable[[float, Sequence[TrackedBody]], Sequence[TrackedBody]]
"""Instant of the exposure [s] and the bodies, ours first → the bodies that are shown."""
Change = Callable[[float, Vec3, Quat], tuple[Vec3, Quat]]
"""Instant [s] and pose of our body → the pose that is shown of it."""


def _ours(change: Change) -> Picture:
    def picture(time_s: float, bodies: Sequence[TrackedBody]) -> Sequence[TrackedBody]:
        ours = bodies[0]
        position, attitude = change(time_s, ours.position_ned, ours.attitude)
        return [ours._replace(position_ned=position, attitude=attitude), *bodies[1:]]

    return picture


def _noisy(struck: Struck, position: Vec3, attitude: Quat) -> tuple[Vec3, Quat]:
    i, j, k, *turn = next(struck.normals)
    x, y, z = position
    p, q, r = (NOISE_RAD * n for n in turn)
    return (x + NOISE_M * i, y + NOISE_M * j, z + NOISE_M * k), so3.rotate(attitude, (p, q, r))


def _places(change: Callable[[float, Vec3], Vec3]) -> Picture:
    """The place is seen otherwise, and the attitude truly."""
    return _ours(lambda time_s, position, attitude: (change(time_s, position), attitude))


def _attitudes(change: Callable[[float, Quat], Quat]) -> Picture:
    """The attitude is seen otherwise, and the place truly."""
    return _ours(lambda time_s, position, attitude: (position, change(time_s, attitude)))


def _axis_of(position: Vec3, axis: int, value: float) -> Vec3:
    """``position`` with another coordinate along ``axis``: 0 is north, 1 east, 2 down."""
    x, y, z = (value if number == axis else one for number, one in enumerate(position))
    return x, y, z


# ---- pictures that stand still


def freeze(struck: Struck, flicker_m: float = 0.0) -> Picture:
    """Frames go on, and show what they showed last: to the last bit, or but for a flicker [m]."""

    def change(time_s: float, position: Vec3, attitude: Quat) -> tuple[Vec3, Quat]:
        x, y, z = struck.position_ned
        i, j, k, *_ = next(struck.normals)
        return (x + flicker_m * i, y + flicker_m * j, z + flicker_m * k), struck.attitude

    return _ours(change)


def _last(struck: Struck) -> tuple[Vec3, Quat]:
    """The pose that was shown last, under noise."""
    return _noisy(struck, struck.position_ned, struck.attitude)


def still(struck: Struck) -> Picture:
    """Freeze the pose under noise."""
    return _ours(lambda time_s, position, attitude: _last(struck))


def still_position(struck: Struck) -> Picture:
    """The position alone stands still, with noise."""
    return _places(lambda time_s, position: _last(struck)[0])


def still_attitude(struck: Struck) -> Picture:
    """The attitude alone stands still, with noise."""
    return _attitudes(lambda time_s, attitude: _last(struck)[1])


def still_coordinate(struck: Struck, axis: int) -> Picture:
    """One coordinate of the position stands still, with noise: 0 is north, 1 east, 2 down."""
    return _places(lambda time_s, position: _axis_of(position, axis, _last(struck)[0][axis]))


def fading_coordinate(struck: Struck, axis: int, fades_s: float) -> Picture:
    """One coordinate (0 is north, 1 east, 2 down) comes to a standstill within so long [s]."""

    def change(time_s: float, position: Vec3) -> Vec3:
        share = min(max((time_s - struck.time_s) / fades_s, 0.0), 1.0)
        off = share * (_last(struck)[0][axis] - position[axis])
        return _axis_of(position, axis, position[axis] + off)

    return _places(change)


def still_along(struck: Struck, north: float, east: float) -> Picture:
    """The position stands still along one horizontal direction, with noise."""
    n, e = north / math.hypot(north, east), east / math.hypot(north, east)

    def change(time_s: float, position: Vec3) -> Vec3:
        (x, y, z), (i, j, _) = position, _last(struck)[0]
        off = n * (x - i) + e * (y - j)
        return x - off * n, y - off * e, z

    return _places(change)


def now_and_again(struck: Struck, for_s: float, every_s: float) -> Picture:
    """The picture stands for so long of each period [s], with noise; else it is true."""
    turn, held = -1, (struck.position_ned, struck.attitude)

    def change(time_s: float, position: Vec3, attitude: Quat) -> tuple[Vec3, Quat]:
        nonlocal turn, held
        number, since_s = divmod(max(time_s - struck.time_s, 0.0), every_s)
        if since_s >= for_s:
            return position, attitude
        if number != turn:
            turn, held = int(number), (position, attitude)
        return _noisy(struck, *held)

    return _ours(change)


# ---- other bodies


def swap(struck: Struck) -> Picture:
    """Our body and the next one change names."""

    def picture(time_s: float, bodies: Sequence[TrackedBody]) -> Sequence[TrackedBody]:
        ours, other, *rest = bodies
        return [other._replace(name=ours.name, tracked=True), ours._replace(name=other.name), *rest]

    return picture


def resting(struck: Struck) -> Picture:
    """A body beside ours that rests: on the floor, or at its height on a stand."""
    x, y, z = struck.position_ned
    yaw = so3.euler_zyx(struck.attitude)[2]
    place, level = (x + NEAR_M, y, z), so3.from_euler_zyx(0.0, 0.0, yaw)
    return _ours(lambda time_s, position, attitude: _noisy(struck, place, level))


def carry(struck: Struck) -> Picture:
    """A body beside ours that a hand carries around: up by 0.3 m, and to and fro at 0.5 m/s."""
    yaw = so3.euler_zyx(struck.attitude)[2]

    def change(time_s: float, position: Vec3, attitude: Quat) -> tuple[Vec3, Quat]:
        t = time_s - struck.time_s
        begun = 1.0 - math.exp(-t / CARRY_RAMP_S)
        each = begun * CARRY_M_S * math.sqrt(0.5)
        x, y, z = struck.position_ned
        a, b, c = (2.0 * math.pi * hertz for hertz in (0.25, 0.19, 0.12))  # no two alike
        place = (
            x + NEAR_M + each / a * math.sin(a * t),
            y + each / b * math.sin(b * t),
            z - 0.15 * (1.0 - math.cos(c * t)),
        )
        lean = begun * math.radians(CARRY_TILT_DEG)
        tilted = so3.from_euler_zyx(
            lean * math.sin(2.1 * t), lean * math.sin(1.7 * t + 1.0), yaw + lean * math.sin(t)
        )
        return _noisy(struck, place, tilted)

    return _ours(change)


# ---- places that are not so


def teleport(struck: Struck, off_m: float) -> Picture:
    """The vehicle is seen north of where it is, by so far [m]."""
    return _places(lambda time_s, position: (position[0] + off_m, *position[1:]))


def drift(struck: Struck, speed_m_s: float) -> Picture:
    """The place drifts away at a steady speed [m/s], north-east."""
    each = speed_m_s * math.sqrt(0.5)

    def change(time_s: float, position: Vec3) -> Vec3:
        far, (x, y, z) = each * (time_s - struck.time_s), position
        return x + far, y + far, z

    return _places(change)


def sinking_height(struck: Struck, speed_m_s: float, for_s: float) -> Picture:
    """The height sinks beside the true one [m/s] for so long [s], and then stands."""
    stood: list[float] = []

    def change(time_s: float, position: Vec3, attitude: Quat) -> tuple[Vec3, Quat]:
        (x, y, z), since_s = position, time_s - struck.time_s
        if since_s < for_s:
            return (x, y, z + speed_m_s * since_s), attitude
        if not stood:
            stood.append(z + speed_m_s * since_s)
        return _noisy(struck, (x, y, stood[0]), attitude)

    return _ours(change)


def map_positions(struck: Struck, rows: tuple[Vec3, Vec3, Vec3]) -> Picture:
    """The world's axes are mixed up by a matrix, about the place of ours; attitudes are true."""
    at = struck.position_ned

    def change(time_s: float, position: Vec3) -> Vec3:
        gap = [p - q for p, q in zip(position, at, strict=True)]
        x, y, z = (
            q + sum(m * g for m, g in zip(row, gap, strict=True))
            for q, row in zip(at, rows, strict=True)
        )
        return x, y, z

    return _places(change)


def scale_positions(struck: Struck, share: float) -> Picture:
    """Lengths are told in another unit, about the place where ours is."""
    return map_positions(struck, ((share, 0.0, 0.0), (0.0, share, 0.0), (0.0, 0.0, share)))


def late_position(struck: Struck, delay_s: float) -> Picture:
    """The place is that of so long ago [s], the attitude is of now."""
    past: deque[tuple[float, Vec3]] = deque([(struck.time_s, struck.position_ned)])

    def change(time_s: float, position: Vec3) -> Vec3:
        past.append((time_s, position))
        while len(past) > 1 and past[1][0] <= time_s - delay_s:
            past.popleft()
        return past[0][1]

    return _places(change)


def smoothed_position(struck: Struck, tau_s: float) -> Picture:
    """The place is smoothed with a time constant [s], the attitude is of now."""
    last_s, place = struck.time_s, struck.position_ned

    def change(time_s: float, position: Vec3) -> Vec3:
        nonlocal last_s, place
        keep = math.exp(-(time_s - last_s) / tau_s)
        (a, b, c), (x, y, z) = place, position
        last_s, place = time_s, (x + keep * (a - x), y + keep * (b - y), z + keep * (c - z))
        return place

    return _places(change)


# ---- attitudes that are not so


def turn_axes(struck: Struck, roll_deg: float, pitch_deg: float, yaw_deg: float) -> Picture:
    """The body's axes are found turned by these angles [deg]."""
    turn = so3.from_euler_zyx(*map(math.radians, (roll_deg, pitch_deg, yaw_deg)))
    return _attitudes(lambda time_s, attitude: so3.multiply(attitude, turn))


def turning(struck: Struck, rate_deg_s: float) -> Picture:
    """The body's axes turn about its vertical, slowly and for ever [deg/s]."""

    def change(time_s: float, attitude: Quat) -> Quat:
        angle = math.radians(rate_deg_s) * (time_s - struck.time_s)
        return so3.multiply(attitude, so3.from_euler_zyx(0.0, 0.0, math.remainder(angle, math.tau)))

    return _attitudes(change)


def mix_angles(struck: Struck, change: Callable[[float, float], tuple[float, float]]) -> Picture:
    """Roll and pitch [rad] are seen as ``change`` makes of them."""

    def mixed(time_s: float, attitude: Quat) -> Quat:
        phi, theta, psi = so3.euler_zyx(attitude)
        return so3.from_euler_zyx(*change(phi, theta), psi)

    return _attitudes(mixed)


# ---- ways of the frames

Send = Callable[[int, float, Sequence[TrackedBody]], None]
"""Frame number, instant of its exposure [s], bodies."""
Way = Callable[[Send, int, float, Sequence[TrackedBody]], None]
"""Sends a frame on, or not, or later; the first argument sends."""


def repeat(times: int) -> Way:
    """Every datagram comes so many times."""

    def way(send: Send, frame: int, exposure_s: float, bodies: Sequence[TrackedBody]) -> None:
        for _ in range(times):
            send(frame, exposure_s, bodies)

    return way


def reorder() -> Way:
    """Each second datagram overtakes the one before."""
    held: tuple[int, float, Sequence[TrackedBody]] | None = None

    def way(send: Send, frame: int, exposure_s: float, bodies: Sequence[TrackedBody]) -> None:
        nonlocal held
        before, held = held, None if held is not None else (frame, exposure_s, bodies)
        if before is not None:
            send(frame, exposure_s, bodies)
            send(*before)

    return way


def shift_stamps(by_s: Callable[[], float]) -> Way:
    """Stamps are off by what ``by_s`` returns for each frame [s]; frames come when they should."""
    return lambda send, frame, exposure_s, bodies: send(frame, exposure_s + by_s(), bodies)


def every(nth: int) -> Way:
    """Only every ``nth`` frame comes."""
    return lambda send, frame, exposure_s, bodies: (
        None if frame % nth else send(frame, exposure_s, bodies)
    )


def late(delay_s: Callable[[float], float], period_s: float, *, fresh: bool) -> Way:
    """Every frame comes later, by a function of the time since this began [s].

    Stamps and numbers show it; or, ``fresh``, a relay puts its own there. ``period_s`` is the time
    from frame to frame.
    """
    loop = asyncio.get_running_loop()
    begun_s = newest_s = loop.time()

    def way(send: Send, frame: int, exposure_s: float, bodies: Sequence[TrackedBody]) -> None:
        nonlocal newest_s
        now = loop.time()
        delay = delay_s(now - begun_s)
        newest_s = max(newest_s, now + delay)  # none overtakes another
        if fresh:
            frame, exposure_s = frame + round(delay / period_s), exposure_s + (newest_s - now)
        loop.call_at(newest_s, send, frame, exposure_s, bodies)

    return way
