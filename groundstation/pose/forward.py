"""Forwarding of accepted poses to the autopilot's own estimator, which flies when we hand back.

Nothing is repeated: when poses stop, so does this, and the autopilot's estimator handles it.
Heights are above the floor, where the autopilot's barometer has its zero: ArduPilot's estimator
switches to it when poses stop.
"""

import asyncio
import math
from collections import deque
from collections.abc import Callable

from groundstation.core.geometry import Vec3, to_body
from groundstation.core.messages import OverheardSource, Pose, PoseSource
from links.mavlink import HEARTBEAT_S, MavlinkLink
from links.mavlink.protocol import (
    ARDUPILOT,
    ForwardConfig,
    Odometry,
    encode_odometry,
    encode_origin,
)

BASE_S = 0.04
"""Velocity is measured over at least this time [s]."""
GAP_S = 0.2
"""Largest time between two poses that give a velocity [s]."""
EARLY = 0.1
"""Share of the period by which a pose may be early [-]: jitter must not halve the rate."""


class Forward:
    """Choice and encoding of the forwarded poses. Sans-IO."""

    def __init__(self, config: ForwardConfig, floor_z_m: float) -> None:
        """``floor_z_m`` is the floor's down coordinate [m]: the zero of forwarded heights."""
        self._config, self._floor_z_m = config, floor_z_m
        self._period_s = 1.0 / config.rate_hz
        self._due_s = -math.inf
        self._recent: deque[Pose] = deque()
        self._resets = 0

    def take(self, pose: Pose, now_s: float) -> Odometry | None:
        """Return the odometry of ``pose`` at ``now_s`` [s]; None if it is not due or too old."""
        recent, config = self._recent, self._config
        if recent and pose.reset_count != recent[-1].reset_count:
            self._resets += 1
            recent.clear()
        if recent and not 0.0 < pose.time_s - recent[-1].time_s < GAP_S:
            recent.clear()
        recent.append(pose)
        while len(recent) > 2 and recent[1].time_s <= pose.time_s - BASE_S:
            recent.popleft()
        if (
            now_s - pose.time_s > config.oldest_s
            or pose.time_s < self._due_s - EARLY * self._period_s
        ):
            return None
        measured = pose.velocity_ned
        velocity, base_s = (measured, BASE_S) if measured is not None else self._difference()
        if velocity is None:
            return None
        late = pose.time_s - self._due_s > self._period_s
        self._due_s = (pose.time_s if late else self._due_s) + self._period_s
        north, east, down = pose.position_ned
        return Odometry(
            time_s=pose.time_s,
            position=(north, east, down - self._floor_z_m),
            attitude=pose.attitude,
            velocity=to_body(pose.attitude, velocity),
            measured_velocity=measured is not None,
            resets=self._resets,
            noise_m=config.noise_m,
            noise_rad=math.radians(config.noise_deg),
            noise_m_s=math.sqrt(2.0) * config.noise_m / base_s,
        )

    def _difference(self) -> tuple[Vec3 | None, float]:
        a, b = self._recent[0], self._recent[-1]
        base_s = b.time_s - a.time_s
        if base_s < 0.5 * BASE_S:
            return None, BASE_S
        x, y, z = ((q - p) / base_s for p, q in zip(a.position_ned, b.position_ned, strict=True))
        return (x, y, z), base_s


class ForwardingSource(OverheardSource):
    """A source of whose poses the autopilot gets those that the flight uses, too."""

    def __init__(
        self,
        source: PoseSource,
        link: MavlinkLink,
        config: ForwardConfig,
        *,
        floor_z_m: float,
        believes: Callable[[], bool],
    ) -> None:
        """``source`` is behind the gate; the frames leave on the connection of ``link``.

        ``floor_z_m`` is the down coordinate of the floor [m]. ``believes`` returns whether the
        flight uses the pose delivered last.
        """
        super().__init__(source, self._send)
        self._believes = believes
        self._connection = link.connection
        self._origin_due_s = -math.inf
        self._forward = Forward(config, floor_z_m)
        self._distrusted = False

    async def start(self, deliver: Callable[[Pose], None]) -> None:
        """Start the source.

        The autopilot gets each pose after ``deliver``, and after the resulting command.
        """
        loop = asyncio.get_running_loop()

        def both(pose: Pose) -> None:
            deliver(pose)
            if self._believes():
                loop.call_soon(self._tap, pose)

        await self._source.start(both)

    def distrust(self) -> None:
        """Stop forwarding poses, the one under way included."""
        self._distrusted = True

    def _send(self, pose: Pose) -> None:
        if self._distrusted:
            return
        connection = self._connection
        now_s = asyncio.get_running_loop().time()
        message = self._forward.take(pose, now_s)
        if (
            message is not None
            and connection.kind is not None
            and connection.state in ("connected", "armed")
        ):
            if (
                connection.kind == ARDUPILOT
                and connection.state == "connected"
                and now_s >= self._origin_due_s
            ):
                # A filter that has not begun takes none, so it comes as often as our HEARTBEAT.
                self._origin_due_s = now_s + HEARTBEAT_S
                connection.send(encode_origin(connection.codec))
            connection.send(encode_odometry(connection.codec, connection.kind, message))
