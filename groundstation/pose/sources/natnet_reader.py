"""One client of a NatNet server: what it sends to be streamed to, and the poses of one body. Sans-IO."""

from collections.abc import Sequence

from groundstation.core.geometry import Quat
from groundstation.core.messages import Pose, PoseStatus
from groundstation.pose.intake import Intake
from groundstation.pose.sources import natnet_codec as codec
from groundstation.pose.sources.natnet_codec import Frame, RigidBody, ServerInfo, UnreadableNatNet

SILENT_BEATS = 4
"""A server that says nothing for so many beats is asked anew: it may have been started again."""
OLDEST_S = 1.0
"""A frame that was older than this as it left is absurd [s]."""
MAX_NAMES = 256
"""So many bodies' names are kept."""


class NatNetReader:
    """Implements :class:`groundstation.pose.intake.intake.Reader`; :meth:`due` gives what must be sent."""

    def __init__(self, name: str, intake: Intake, *, body_id: int | None = None, keep_alive: bool = True) -> None:
        """Look for the rigid body ``name``, or for the one with streaming id ``body_id``.

        ``keep_alive``: a unicast server streams to those only who say every second that they are there.
        """
        self.server: ServerInfo | None = None
        """The server as it described itself last."""
        self.names: tuple[str, ...] = ()
        """The bodies it has, for the operator."""
        self._name = name
        self._intake = intake
        self._fixed_id = body_id
        self._id = body_id
        self._wants_names = body_id is None or intake.others is not None
        self._ask_names = self._wants_names
        self._others: dict[int, str] = {}
        self._keep_alive = keep_alive
        self._silent_beats = 0

    @property
    def status(self) -> PoseStatus:
        """Counters as they are now.

        Reasons beside the intake's: truncated, oversized, wrong_version, unknown_message, no_server_info, no_such_body,
        not_tracked, no_exposure_stamp, other_address.
        """
        return self._intake.status

    def due(self) -> list[bytes]:
        """What to send to the server now; to be asked for once a beat (about half a second)."""
        self._silent_beats += 1
        if self.server is None or self._silent_beats > SILENT_BEATS:
            return [codec.message(codec.CONNECT, b"Ping\0")]
        messages = []
        if self._ask_names:
            messages.append(codec.message(codec.REQUEST_MODELDEF))
        if self._keep_alive:
            messages.append(codec.message(codec.KEEPALIVE))
        return messages

    def other_address(self) -> None:
        """Count a datagram that somebody else sent."""
        self._intake.drop("other_address")

    def read(self, datagram: bytes, arrival_s: float) -> Sequence[Pose]:
        """The pose of our body, or nothing."""
        try:
            pose = self._take(*codec.split(datagram), arrival_s)
        except UnreadableNatNet as fault:
            pose = self._intake.drop(str(fault))
        return () if pose is None else (pose,)

    def _take(self, number: int, payload: bytes, arrival_s: float) -> Pose | None:
        if number == codec.SERVERINFO:
            self.server = codec.decode_server_info(payload)
            self._silent_beats = 0
        elif number not in (codec.MODELDEF, codec.FRAMEOFDATA):
            return self._intake.drop("unknown_message")
        elif self.server is None:
            return self._intake.drop("no_server_info")
        elif number == codec.MODELDEF:
            models = codec.decode_models(payload, self.server.version)
            self.names = tuple(models)[:MAX_NAMES]
            self._id = models.get(self._name) if self._fixed_id is None else self._fixed_id
            others = self._intake.others
            if others is not None:
                self._others = {
                    number: name for name, number in models.items() if name in others and number != self._id
                }
            self._ask_names = self._id is None or (others is not None and len(self._others) < len(others.names))
        else:
            frame = codec.decode_frame(payload, self.server.version)
            self._silent_beats = 0
            self._intake.heard(arrival_s)
            return self._pose(frame, self.server.ticks_per_s, arrival_s)
        return None

    def _pose(self, frame: Frame, ticks_per_s: int, arrival_s: float) -> Pose | None:
        if self._others:
            self._look_around(frame, ticks_per_s, arrival_s)
        body = next((body for body in frame.bodies if body.id == self._id), None)
        if frame.models_changed:
            self._ask_names = self._wants_names  # until the answer, the id that we know stands
        if body is None:
            return self._intake.drop("no_such_body")
        if not body.tracked:
            return self._intake.drop("not_tracked")
        if frame.exposure_ticks == 0 or frame.transmit_ticks == 0:
            return self._intake.drop("no_exposure_stamp")  # a recording that is played back
        age_s = (frame.transmit_ticks - frame.exposure_ticks) / ticks_per_s
        if not 0.0 <= age_s <= OLDEST_S:
            return self._intake.drop("absurd")
        stamp_s = frame.transmit_ticks / ticks_per_s
        return self._intake.pose(stamp_s, arrival_s, body.position, _wxyz(body), age_s=age_s)

    def _look_around(self, frame: Frame, ticks_per_s: int, arrival_s: float) -> None:
        """Take the other bodies that are seen now."""
        age_s = (frame.transmit_ticks - frame.exposure_ticks) / ticks_per_s
        if not 0.0 <= age_s <= OLDEST_S:
            return
        for body in frame.bodies:
            if body.tracked and body.id in self._others:
                self._intake.other(self._others[body.id], arrival_s, body.position, age_s=age_s)


def _wxyz(body: RigidBody) -> Quat:
    x, y, z, w = body.quaternion_xyzw
    return (w, x, y, z)
