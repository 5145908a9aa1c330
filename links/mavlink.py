"""The MAVLink link: thrust and body rates to PX4 or ArduPilot over UDP."""

import asyncio
import math
from collections.abc import Callable

from links.mavlink_codec import ARDUPILOT, ARM_DISARM
from links.mavlink_config import MavlinkLinkConfig
from links.mavlink_connection import MavlinkConnection
from links.mavlink_handshake import arming, disarming, landing_disarmed
from links.port import Command, LinkError, LinkMisuse, LinkRejected, LinkStatus
from links.thrust_curve import signal

__all__ = ["MavlinkLink", "MavlinkLinkConfig"]


class MavlinkLink:
    """Implements :class:`links.port.CommandLink` (see there); others may read along on ``connection``."""

    def __init__(self, config: MavlinkLinkConfig, *, thrust_max_n: float) -> None:
        """Nothing is opened yet; ``thrust_max_n`` is the thrust of the full signal [N]."""
        self._config = config
        self._thrust_max = thrust_max_n
        self._target = (config.target_system, config.target_component)
        self.connection = MavlinkConnection(config)
        """The socket, for whoever shares it."""
        self._sent = 0
        self._expired = 0
        self._loop: asyncio.AbstractEventLoop | None = None
        self._busy = "on a link that is not connected"
        """Why send() is out of place now; empty where it is not."""

    @property
    def period_s(self) -> float:
        """Time between two commands [s]."""
        return self._config.period_s

    @property
    def status(self) -> LinkStatus:
        """The link as it is now."""
        connection = self.connection
        return LinkStatus(
            state=connection.state,
            sent=self._sent,
            expired=self._expired,
            received=connection.codec.received,
            dropped=connection.dropped,
            text=connection.words.newest,
        )

    async def connect(self) -> None:
        """Open the socket, wait for the autopilot's HEARTBEAT, and ask for the messages that are wanted.

        Raises:
            LinkLost: the address can't be opened, or nobody answered within the configured time.
            LinkRejected: the autopilot refuses to send a message that was requested.
        """
        self._loop = asyncio.get_running_loop()
        await self.connection.open()
        self._busy = ""

    async def arm(self, idle: Callable[[], Command]) -> None:
        """Stream what ``idle()`` returns until the vehicle is in OFFBOARD (GUIDED on ArduPilot) and armed.

        Whatever ends this early, an order to disarm leaves after an order to arm.

        Raises:
            LinkRejected: the autopilot refused, in its own words.
            LinkLost: it did not answer.
            LinkError: ``idle()`` returned a command whose deadline had passed.
            LinkMisuse: the link is not connected.
        """

        def stream(now_s: float) -> None:
            if not self._send(idle(), now_s):
                raise LinkError("arming was abandoned: the idle command had expired, as its pose is too old")

        handshake = arming(self.connection.autopilot())
        self._busy = "while arm() streams"
        try:
            await self.connection.see_through(handshake, stream, self.period_s)
            self.connection.armed(True)
        except BaseException:
            if handshake.at_last_step:
                self.connection.leave(self.connection.codec.command(*self._target, ARM_DISARM, 0.0))
            raise
        finally:
            if self._busy == "while arm() streams":  # not closed meanwhile
                self._busy = ""

    def send(self, command: Command) -> bool:
        """Send one command now; returns False, and sends nothing, where its deadline has passed.

        Raises:
            LinkMisuse: a number in the command is not finite, the link is not connected, or ``arm`` is streaming.
        """
        if self._busy or self._loop is None:
            raise LinkMisuse(f"send() {self._busy}")
        return self._send(command, self._loop.time())

    def _send(self, command: Command, now_s: float) -> bool:
        if not now_s <= command.deadline_s:  # also true of a deadline that is no number
            self._expired += 1
            return False
        p, q, r = command.rates_rad_s
        if not math.isfinite(command.thrust_n + p + q + r):
            raise LinkMisuse(f"not finite: {command}")
        thrust = signal(command.thrust_n / self._thrust_max, self._config.thrust_curve)
        try:
            frame = self.connection.codec.attitude_target(now_s, *self._target, thrust, command.rates_rad_s)
        except OverflowError:
            raise LinkMisuse(f"no vehicle turns that fast: {command}") from None
        self.connection.leave(frame)
        self._sent += 1
        return True

    async def disarm(self) -> None:
        """Ask the vehicle, which stands on the ground, to stop its motors.

        Raises:
            LinkRejected: the autopilot refused, in its own words.
            LinkLost: it did not answer.
            LinkMisuse: the link is not connected.
        """
        autopilot = self.connection.autopilot()
        try:
            await self.connection.see_through(disarming(autopilot))
        except LinkRejected:
            if autopilot.kind != ARDUPILOT:
                raise
            await self.connection.see_through(landing_disarmed(autopilot))
        self.connection.armed(False)

    async def close(self) -> None:
        """Release the socket. Nothing leaves afterwards."""
        self._busy = "on a link that is not connected"
        self.connection.close()
