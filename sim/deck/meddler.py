"""What stands between the cameras and the network and spoils what they say, from the instant that it is told to."""

import asyncio
from collections.abc import Sequence
from enum import StrEnum

from groundstation import so3
from sim.trackers import Seen, Tracker

TELEPORT_M = 1.0
"""How far away a vehicle is seen that teleports [m]."""
CLOCK_STEP_S = 5.0
"""How far ahead the tracking computer's clock leaps [s]."""
LATENCY_STEP_S = 0.060
"""How much later everything comes [s]."""
COPIES = 3
"""How often a datagram comes that comes more than once."""
HALF_TURN = (0.0, 0.0, 0.0, 1.0)


class Mishap(StrEnum):
    """What may happen to poses on their way."""

    NONE = "none"
    FREEZE = "freeze"
    """Frames go on, and show for ever what they showed last."""
    TELEPORT = "teleport"
    YAW_FLIP = "yaw flip"
    """The object's axes are found half a turn off, as on a symmetric pattern of markers."""
    SWAP = "marker swap"
    """Our body and the next one change names."""
    DUPLICATES = "duplicates"
    REORDER = "reorder"
    """Each second datagram overtakes the one before."""
    CLOCK_STEP = "clock step"
    LATENCY_STEP = "latency step"


class Meddler:
    """Implements :class:`sim.trackers.Tracker` around another one."""

    def __init__(self, tracker: Tracker) -> None:
        """Pass everything on."""
        self.mishap = Mishap.NONE
        """What happens now."""
        self._tracker = tracker
        self._newest: Sequence[Seen] = ()
        self._held: tuple[int, float, Sequence[Seen]] | None = None

    async def open(self) -> None:
        """Join the network."""
        await self._tracker.open()

    def close(self) -> None:
        """Leave the network."""
        self._tracker.close()

    def send(self, frame: int, exposure_s: float, bodies: Sequence[Seen]) -> None:
        """Send one frame, as it has become."""
        send = self._tracker.send
        match self.mishap:
            case Mishap.FREEZE:
                send(frame, exposure_s, self._newest)
                return
            case Mishap.DUPLICATES:
                for _ in range(COPIES):
                    send(frame, exposure_s, bodies)
            case Mishap.REORDER:
                held, self._held = self._held, None if self._held is not None else (frame, exposure_s, bodies)
                if held is not None:
                    send(frame, exposure_s, bodies)
                    send(*held)
            case Mishap.CLOCK_STEP:
                send(frame, exposure_s + CLOCK_STEP_S, bodies)
            case Mishap.LATENCY_STEP:
                asyncio.get_running_loop().call_later(LATENCY_STEP_S, send, frame, exposure_s, bodies)
            case _:
                send(frame, exposure_s, self._wrong(bodies))
        self._newest = bodies

    def _wrong(self, bodies: Sequence[Seen]) -> Sequence[Seen]:
        ours, others = bodies[0], bodies[1:]
        match self.mishap:
            case Mishap.TELEPORT:
                x, y, z = ours.position_ned
                return [ours._replace(position_ned=(x + TELEPORT_M, y, z)), *others]
            case Mishap.YAW_FLIP:
                return [ours._replace(attitude=so3.multiply(ours.attitude, HALF_TURN)), *others]
            case Mishap.SWAP:
                next_ = others[0]
                swapped = (
                    next_._replace(name=ours.name, tracked=True),
                    ours._replace(name=next_.name),
                )
                return [*swapped, *others[1:]]
            case _:
                return bodies
