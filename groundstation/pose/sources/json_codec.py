"""Poses as JSON, for home-made trackers: one datagram, one object or an array of objects. Sans-IO.

    {"name": "quad", "t": 12.345, "frame": 617, "position": [1.0, 0.5, 1.2],
     "quaternion": {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}, "valid": true}

``name``, ``position`` [m] and ``quaternion`` (body to world; also [w, x, y, z]) are required. ``t``
is the sender's clock at the exposure of the image [s, from any zero], ``frame`` a running number;
the first accepted pose decides which of them is used, ``t`` before ``frame``. ``valid`` false, or
null for position or quaternion, means that the body is not seen. All of it: docs/how-to/extend.md.
"""

import json
import math
from collections.abc import Iterable
from typing import Annotated, Any, Literal

import msgspec

from groundstation.core.geometry import Quat, Vec3
from groundstation.core.messages import Pose, PoseStatus
from groundstation.pose.sources.intake import Intake, PoseReader

MAX_DATAGRAM = 4096
"""Longest datagram that is read [bytes]."""
MAX_NAME = 64
"""Longest name [characters]."""
ROUNDING = 0.01
"""Largest difference from 1 of a quaternion's length: printed numbers are rounded."""

_Name = Annotated[str, msgspec.Meta(min_length=1, max_length=MAX_NAME)]


class NamedQuaternion(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A quaternion with named parts."""

    w: float
    x: float
    y: float
    z: float


class JsonPose(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True
):
    """One body at one instant, as on the wire."""

    name: _Name
    """Name of the body."""
    position: tuple[float, float, float] | msgspec.UnsetType | None = msgspec.UNSET
    """[m]; None if the body is not seen."""
    quaternion: tuple[float, float, float, float] | NamedQuaternion | msgspec.UnsetType | None = (
        msgspec.UNSET
    )
    """w, x, y, z or by name; body to world. None if the body is not seen."""
    t: float | None = None
    """The sender's clock [s]."""
    frame: Annotated[int, msgspec.Meta(ge=0, lt=2**53)] | None = None
    """Running number."""
    valid: bool = True
    """False if the body is not seen: position and quaternion are then ignored."""

    def __post_init__(self) -> None:
        """Refuse a visible body without a position.

        Raises:
            ValueError: position or quaternion is missing.
        """
        if self.valid and msgspec.UNSET in (self.position, self.quaternion):
            raise ValueError("a visible body needs a position and a quaternion")


_MESSAGE: Any = JsonPose | list[Any]
"""A datagram: one body, or a list of bodies, each decoded by itself."""
_DECODER = msgspec.json.Decoder(_MESSAGE)
_ENCODER = msgspec.json.Encoder()


def encode(poses: Iterable[JsonPose]) -> bytes:
    """Return the datagram of one instant, for simulators and tests; one body is no array."""
    bodies = list(poses)
    return _ENCODER.encode(bodies[0] if len(bodies) == 1 else bodies)


def decode(datagram: bytes) -> list[JsonPose] | str:
    """Return the bodies in a datagram, or its fault: oversized, not_json, wrong_schema."""
    if len(datagram) > MAX_DATAGRAM:
        return "oversized"
    try:
        found = _decode_any(datagram)
        return [found] if isinstance(found, JsonPose) else msgspec.convert(found, list[JsonPose])
    except msgspec.ValidationError:
        return "wrong_schema"
    except (msgspec.DecodeError, ValueError, RecursionError):
        return "not_json"


def _decode_any(datagram: bytes) -> Any:
    """Decode JSON, and NaN and Infinity as Python's own ``json`` writes them."""
    try:
        return _DECODER.decode(datagram)
    except msgspec.ValidationError:
        raise
    except msgspec.DecodeError:
        if b"NaN" not in datagram and b"Infinity" not in datagram:
            raise
        return msgspec.convert(json.loads(datagram), _MESSAGE)


Stamp = Literal["t", "frame", "arrival"]


class JsonReader(PoseReader):
    """Reads the poses of one body."""

    def __init__(self, name: str, intake: Intake, frames: Intake) -> None:
        """Look for the body ``name``.

        ``intake`` takes stamps in seconds, ``frames`` frame numbers.
        """
        super().__init__(intake)
        self._name = name
        self._frames = frames
        self._kind: Stamp | None = None
        frames.dropped, frames.senders = intake.dropped, intake.senders  # one account for both

    @property
    def status(self) -> PoseStatus:
        """Present counters."""
        if self._kind == "frame":  # the rate of frames is measured, whatever is configured
            return msgspec.structs.replace(self._frames.status, stamp_rate=None)
        return self.intake.status

    def read_pose(self, data: bytes, arrival_s: float) -> Pose | None:
        """Return the pose of the vehicle's body in the datagram ``data``."""
        intake = self.intake
        bodies = decode(data)
        if isinstance(bodies, str):
            return intake.drop(bodies)
        for each in (intake, self._frames):
            each.clock.mark_alive(arrival_s)
        for other in bodies:
            if place := _seen_place(other):
                intake.see_other(other.name, arrival_s, place)
        body = intake.choose([body for body in bodies if body.name == self._name])
        if body is None:
            self.names = tuple(body.name for body in bodies)
            return None
        if (place := _seen_place(body)) is None or not body.quaternion:
            return intake.drop("not_tracked")
        if self.is_second(arrival_s):
            return None
        if (attitude := _unit(body.quaternion)) is None:
            return intake.drop("not_unit")
        kind = self._kind or (
            "t" if body.t is not None else "frame" if body.frame is not None else "arrival"
        )
        stamp = {"t": body.t, "frame": body.frame, "arrival": arrival_s}[kind]
        if stamp is None:
            return intake.drop("no_stamp")
        pose = (self._frames if kind == "frame" else intake).pose(stamp, arrival_s, place, attitude)
        if pose is not None:
            self._kind = kind
        return pose


def _seen_place(body: JsonPose) -> Vec3 | None:
    """Return the position of a body [m]; None if it is not seen."""
    if not body.valid or body.quaternion is None or isinstance(body.position, msgspec.UnsetType):
        return None
    return body.position


def _unit(given: tuple[float, float, float, float] | NamedQuaternion) -> Quat | None:
    w, x, y, z = (
        (given.w, given.x, given.y, given.z) if isinstance(given, NamedQuaternion) else given
    )
    length = math.hypot(w, x, y, z)
    if not abs(length - 1.0) <= ROUNDING:
        return None
    return (w / length, x / length, y / length, z / length)


def json_pose(name: str, position: Vec3, quaternion: Quat, **more: Any) -> JsonPose:
    """Return a pose with its quaternion's parts named."""
    return JsonPose(name=name, position=position, quaternion=NamedQuaternion(*quaternion), **more)
