"""A channel of the operator's transmitter, as the autopilot tells it (RC_CHANNELS, MAVLink common message 65)."""

import asyncio

from groundstation.flight.hold_to_run.hold import InputLost
from links.mavlink import MavlinkConnection
from links.mavlink.protocol import Message

RATE_HZ = 25.0
"""How often it is asked for [1/s]."""
OLD_S = 0.5
"""What was told so long ago is not known any more [s]."""
_RECEIVER = 0x10000
"""MAV_SYS_STATUS_SENSOR_RC_RECEIVER."""
_UNUSED = (0, 0xFFFF)


class ChannelInput:
    """One channel. Implements :class:`groundstation.flight.hold_to_run.watch.Input`."""

    def __init__(self, connection: MavlinkConnection, number: int) -> None:
        """``number`` is from 1 to 18; the messages are asked for as ``connection`` opens."""
        self.what = f"channel {number} of the transmitter"
        self._field = f"chan{number}_raw"
        self._raw: int | None = None
        self._told_s = 0.0
        self._receives = True
        connection.request(lambda _: {"RC_CHANNELS": RATE_HZ})
        connection.subscribe(self._hear)

    def share(self) -> float | None:
        """Where it stands, 0 at 1000 µs and 1 at 2000 µs; None before the autopilot has told.

        Raises:
            InputLost: the autopilot tells it no more, or does not hear the transmitter.
        """
        if self._raw is None:
            return None
        old_s = asyncio.get_running_loop().time() - self._told_s
        if not old_s <= OLD_S:
            raise InputLost(f"the autopilot has not told it for {old_s:.1f} s")
        if not self._receives:
            raise InputLost("the autopilot's receiver does not hear the transmitter")
        if self._raw in _UNUSED:
            raise InputLost("the receiver has no such channel")
        return (self._raw - 1000) / 1000

    def close(self) -> None:
        """Nothing to release: the connection is the link's."""

    def _hear(self, message: Message, arrival_s: float) -> None:
        match message.get_type():
            case "RC_CHANNELS":
                self._raw, self._told_s = getattr(message, self._field), arrival_s
            case "SYS_STATUS":
                enabled, healthy = message.onboard_control_sensors_enabled, message.onboard_control_sensors_health
                self._receives = not enabled & _RECEIVER or bool(healthy & _RECEIVER)
