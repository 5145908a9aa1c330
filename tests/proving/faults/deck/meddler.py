"""What stands between the cameras and the network and spoils what they say, from the instant that it is told to."""

from collections.abc import Sequence

from sim.trackers import TrackedBody, Tracker
from tests.proving.faults.deck.pictures import Picture
from tests.proving.faults.deck.ways import Way


class Meddler:
    """Implements :class:`sim.trackers.trackers.Tracker` around another one."""

    def __init__(self, tracker: Tracker) -> None:
        """Pass everything on."""
        self.picture: Picture | None = None
        """What becomes of what is seen; None: it is true."""
        self.way: Way | None = None
        """What becomes of the frames; None: each is sent at once, as it is."""
        self.shown: TrackedBody | None = None
        """Our body in the newest frame."""
        self._tracker = tracker

    async def open(self) -> None:
        """Join the network."""
        await self._tracker.open()

    def close(self) -> None:
        """Leave the network."""
        self._tracker.close()

    def send(self, frame: int, exposure_s: float, bodies: Sequence[TrackedBody]) -> None:
        """Send one frame, as it has become."""
        if self.picture is not None:
            bodies = self.picture(exposure_s, bodies)
        self.shown = bodies[0]
        if self.way is not None:
            self.way(self._tracker.send, frame, exposure_s, bodies)
        else:
            self._tracker.send(frame, exposure_s, bodies)
