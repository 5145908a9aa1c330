"""Poses as JSON, for home-made trackers: one datagram, one object or an array of objects. Sans-IO.

    {"name": "quad", "t": 12.345, "frame": 617, "position": [1.0, 0.5, 1.2],
     "quaternion": {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}, "valid": true}

``name``, ``position`` [m] and ``quaternion`` (body to world; also [w, x, y, z]) must be there. ``t`` is the sender's
clock as the picture was taken [s, from any zero], ``frame`` a running number; the first pose taken decides by which of
them all the others are judged, ``t`` before ``frame``. ``valid`` false, or null for position or quaternion, says that
the body is not seen.
The whole of it: docs/how-to/extend.md.
"""

import json
import math
from collections.abc import Iterable, Sequence
from typing import Annotated, Any, Literal

import msgspec

from groundstation.core.geometry import Quat, Vec3
from groundstation.core.messages import Pose, PoseStatus
from groundstation.pose.sources.intake import Intake

MAX_DATAGRAM = 4096
"""Longest datagram that is read [bytes]."""
MAX_BODIES = 32
"""Most bodies in one datagram."""
MAX_NAME = 64
"""Longest name [characters]."""
ROUNDING = 0.01
"""Largest difference from 1 of a quaternion's length: printed numbers are rounded."""

_Name = Annotated[str, msgspec.Meta(min_length=1, max_length=MAX_NAME)]


class NamedQuaternion(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A quaternion whose parts can't be confused."""

    w: float
    x: float
    y: float
    z: float


class JsonPose(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """One body at one instant, as on the wire."""

    name: _Name
    """Which body."""
    position: tuple[float, float, float] | msgspec.UnsetType | None = msgspec.UNSET
    """[m]; None where the body is not seen."""
    quaternion: tuple[float, float, float, float] | NamedQuaternion | msgspec.UnsetType | None = msgspec.UNSET
    """w, x, y, z or by name; body to world. None where the body is not seen."""
    t: float | None = None
    """The sender's clock [s]."""
    frame: Annotated[int, msgspec.Meta(ge=0, lt=2**53)] | None = None
    """Running number."""
    valid: bool = True
    """False where the body is not seen: position and quaternion then mean nothing, and may be left out."""

    def __post_init__(self) -> None:
        """Refuse a body that is seen and has no place.

        Raises:
            ValueError: position or quaternion is missing.
        """
        if self.valid and msgspec.UNSET in (self.position, self.quaternion):
            raise ValueError("a body that is seen has a position and a quaternion")


_MESSAGE: Any = JsonPose | Annotated[list[Any], msgspec.Meta(max_length=MAX_BODIES)]
"""A datagram: one body, or a list whose bodies are looked at each."""
_DECODER = msgspec.json.Decoder(_MESSAGE)
_ENCODER = msgspec.json.Encoder()


def encode(poses: Iterable[JsonPose]) -> bytes:
    """The datagram of one instant, for simulators and tests: an object where there is one body, else an array."""
    bodies = list(poses)
    return _ENCODER.encode(bodies[0] if len(bodies) == 1 else bodies)


def decode(datagram: bytes) -> list[JsonPose] | str:
    """The bodies in a datagram, or why there are none: oversized, not_json, wrong_schema."""
    if len(datagram) > MAX_DATAGRAM:
        return "oversized"
    try:
        found = _decode_any(datagram)
        return [found] if isinstance(found, JsonPose) else msgspec.convert(found, list[JsonPose])
    except msgspec.ValidationError:
        return "wrong_schema"
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return "not_json"


def _decode_any(datagram: bytes) -> JsonPose | list[Any]:
    """Decode JSON; and what Python's own ``json`` writes of numbers that are none, NaN and Infinity."""
    found: JsonPose | list[Any]
    try:
        found = _DECODER.decode(datagram)
    except msgspec.ValidationError:
        raise
    except msgspec.DecodeError:
        if b"NaN" not in datagram and b"Infinity" not in datagram:
            raise
        try:
            said = json.loads(datagram)
        except ValueError as error:
            raise msgspec.DecodeError(str(error)) from None
        found = msgspec.convert(said, _MESSAGE)
    return found


class JsonReader:
    """Poses of one body: implements :class:`groundstation.pose.sources.intake.DatagramReader`."""

    def __init__(self, name: str, intake: Intake, frames: Intake) -> None:
        """Look for the body ``name``; ``intake`` takes stamps in seconds, ``frames`` frame numbers."""
        self._name = name
        self._intakes: dict[Stamp, Intake] = {"t": intake, "frame": frames, "arrival": intake}
        self._kind: Stamp | None = None
        frames.dropped = intake.dropped  # one account for both

    @property
    def status(self) -> PoseStatus:
        """Counters as they are now."""
        status = self._intakes[self._kind or "t"].status
        if self._kind == "frame":  # whose rate is found, whatever was told
            status = msgspec.structs.replace(status, stamp_rate=None)
        return status

    def read(self, datagram: bytes, arrival_s: float) -> Sequence[Pose]:
        """The pose of our body, or nothing."""
        drop = self._intakes["t"].drop
        bodies = decode(datagram)
        if isinstance(bodies, str):
            drop(bodies)
            return ()
        for each in self._intakes.values():
            each.mark_alive(arrival_s)
        intake = self._intakes["t"]
        if intake.others is not None:
            for other in bodies:
                place = _seen_place(other)
                if place is not None and other.name in intake.others:
                    intake.other(other.name, arrival_s, place)
        body = intake.choose([body for body in bodies if body.name == self._name])
        if body is None:
            return ()
        if (place := _seen_place(body)) is None or not body.quaternion:
            drop("not_tracked")
        elif (attitude := _unit(body.quaternion)) is None:
            drop("not_unit")
        elif pose := self._pose(body, place, attitude, arrival_s):
            return (pose,)
        return ()

    def _pose(self, body: JsonPose, position: Vec3, attitude: Quat, arrival_s: float) -> Pose | None:
        kind = self._kind or ("t" if body.t is not None else "frame" if body.frame is not None else "arrival")
        stamp = {"t": body.t, "frame": body.frame, "arrival": arrival_s}[kind]
        if stamp is None:
            return self._intakes["t"].drop("no_stamp")
        pose = self._intakes[kind].pose(stamp, arrival_s, position, attitude)
        if pose is not None:
            self._kind = kind
        return pose


Stamp = Literal["t", "frame", "arrival"]


def _seen_place(body: JsonPose) -> Vec3 | None:
    """Where a body is [m]; None where it is not seen."""
    if not body.valid or body.quaternion is None or isinstance(body.position, msgspec.UnsetType):
        return None
    return body.position


def _unit(given: tuple[float, float, float, float] | NamedQuaternion) -> Quat | None:
    w, x, y, z = (given.w, given.x, given.y, given.z) if isinstance(given, NamedQuaternion) else given
    length = math.hypot(w, x, y, z)
    if not abs(length - 1.0) <= ROUNDING:
        return None
    return (w / length, x / length, y / length, z / length)


def json_pose(name: str, position: Vec3, quaternion: Quat, **more: Any) -> JsonPose:
    """A pose with its quaternion's parts named."""
    return JsonPose(name=name, position=position, quaternion=NamedQuaternion(*quaternion), **more)
