"""How frames come that do not come as they should: late, seldom, several times, with stamps that are not true."""

import asyncio
from collections.abc import Callable, Iterator, Sequence

from sim.trackers import TrackedBody

CLOCK_STEP_S = 5.0
"""How far ahead the tracking computer's clock leaps [s]."""
COPIES = 3
"""How often a datagram comes that comes more than once."""
GROWS_PER_S, GROWN_S = 0.050, 0.400
"""How fast a delay grows [s/s], and up to what [s]."""
WIFI_S = 0.060
"""By how much a wireless network delays a frame at most [s]."""

Send = Callable[[int, float, Sequence[TrackedBody]], None]
"""Frame number, instant of its exposure [s], bodies."""
Way = Callable[[Send, int, float, Sequence[TrackedBody]], None]
"""Sends a frame on, or not, or later; the first argument sends."""


def duplicates(send: Send, frame: int, exposure_s: float, bodies: Sequence[TrackedBody]) -> None:
    """Every datagram comes three times."""
    for _ in range(COPIES):
        send(frame, exposure_s, bodies)


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


def clock_step(send: Send, frame: int, exposure_s: float, bodies: Sequence[TrackedBody]) -> None:
    """The trackers' clock has leapt ahead."""
    send(frame, exposure_s + CLOCK_STEP_S, bodies)


def every(nth: int) -> Way:
    """Only every ``nth`` frame comes."""

    def way(send: Send, frame: int, exposure_s: float, bodies: Sequence[TrackedBody]) -> None:
        if frame % nth == 0:
            send(frame, exposure_s, bodies)

    return way


def jitter(sigma_s: float, normals: Iterator[list[float]]) -> Way:
    """Stamps are off by normal noise [s]; frames come when they should."""

    def way(send: Send, frame: int, exposure_s: float, bodies: Sequence[TrackedBody]) -> None:
        send(frame, exposure_s + sigma_s * next(normals)[0], bodies)

    return way


def late(delay_s: Callable[[float], float], period_s: float, *, fresh: bool) -> Way:
    """Every frame comes later, by a function of the time since this began [s].

    Stamps and numbers tell of it; or, ``fresh``, a relay puts its own there, as if each frame had been exposed as much
    later. ``period_s`` is the time from frame to frame.
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


def growing(since_s: float) -> float:
    """A delay that grows steadily to its end [s]."""
    return min(GROWS_PER_S * since_s, GROWN_S)
