"""The poses of one object in Vicon's stream (vicon_codec.py), on our clock. Sans-IO."""

from collections.abc import Sequence

from groundstation.core.messages.pose import Pose, PoseStatus
from groundstation.pose.intake.intake import FrameCount, Intake
from groundstation.pose.sources.vicon_codec import ViconDecoder, ViconFrame, ViconObject, ViconPose, decode


class ViconReader:
    """Implements :class:`groundstation.pose.intake.intake.Reader`.

    The datagrams hold no time, but frames come at a steady rate: their numbers are the clock.
    """

    def __init__(self, name: str, intake: Intake, *, drop_frozen: bool = True) -> None:
        """Look for the object ``name``; the stamps of ``intake`` are frame numbers.

        ``drop_frozen``: a pose that equals the one before to the last bit was not measured.

        Raises:
            ValueError: no object can have that name.
        """
        self._decoder = ViconDecoder(name)
        self._decoder.dropped = intake.dropped  # one account for both
        self._intake = intake
        self._drop_frozen = drop_frozen
        self._frames = FrameCount()
        self._last: ViconPose | None = None
        self._last_others: dict[str, ViconObject] = {}

    @property
    def status(self) -> PoseStatus:
        """Counters as they are now; adds duplicate, out_of_order and frozen to the decoder's reasons."""
        return self._intake.status

    @property
    def names(self) -> tuple[str, ...]:
        """The objects of the last datagram that lacked ours, for the operator."""
        return self._decoder.names

    def read(self, datagram: bytes, arrival_s: float) -> Sequence[Pose]:
        """The pose of our object, or nothing."""
        found = decode(datagram)
        if isinstance(found, str):
            self._intake.drop(found)
            return ()
        self._intake.heard(arrival_s)
        if self._intake.others is not None:
            self._look_around(found, arrival_s)
        seen = self._decoder.pose(found)
        if seen is None:
            return ()
        last = self._last
        if (
            self._drop_frozen
            and last is not None
            and (seen.position_m, seen.attitude) == (last.position_m, last.attitude)
            and seen.frame_number != last.frame_number
        ):
            self._intake.drop("frozen")
            return ()
        frame = self._frames.whole(seen.frame_number)
        pose = self._intake.pose(frame, arrival_s, seen.position_m, seen.attitude)
        if pose is None:
            return ()
        self._last = seen
        return (pose,)

    def _look_around(self, frame: ViconFrame, arrival_s: float) -> None:
        """Take the other bodies; a hidden one stands still to the last bit."""
        others = self._intake.others
        for item in frame.objects:
            if others is None or item.name not in others:
                continue
            if self._drop_frozen and self._last_others.get(item.name) == item:
                continue
            self._last_others[item.name] = item
            x, y, z = item.translation_mm
            self._intake.other(item.name, arrival_s, (x / 1000.0, y / 1000.0, z / 1000.0))
