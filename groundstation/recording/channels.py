"""Channels of a recording: topic → type of its messages, in JSON, each with its JSON schema as Foxglove reads it.

``/pose``, ``/tf`` and ``/log`` are Foxglove's own, which its panels know how to draw (foxglove-sdk,
schemas/jsonschema); the others are typed here. Names end in units; world NED, body FRD; ``time_s`` is the event loop's
clock [s], the log time its wall time.
"""

import json
from typing import Any

import msgspec

from groundstation.core.geometry import Quat, Vec3
from groundstation.core.messages import PoseStatus
from links.core import LinkStatus

WORLD, VEHICLE = "world_ned", "vehicle"
"""Frames of /tf and /pose."""
DISPLAY = "world"
"""The same world with z up, for screens: its x is north, its y is west."""


class Vector3(msgspec.Struct, frozen=True, gc=False):
    """Three components."""

    x: float
    y: float
    z: float


class Quaternion(msgspec.Struct, frozen=True, gc=False):
    """Body to world, unit."""

    x: float
    y: float
    z: float
    w: float


def vector(v: Vec3) -> Vector3:
    """The same, with names."""
    return Vector3(v[0], v[1], v[2])


def quaternion(q: Quat) -> Quaternion:
    """The same, with names."""
    return Quaternion(q[1], q[2], q[3], q[0])


class Time(msgspec.Struct, frozen=True, gc=False):
    """Since 1970, or since the beginning of virtual time."""

    sec: int
    nsec: int


class FoxglovePose(msgspec.Struct, frozen=True, gc=False):
    """foxglove.Pose."""

    position: Vector3
    orientation: Quaternion


class PoseInFrame(msgspec.Struct, frozen=True, gc=False):
    """foxglove.PoseInFrame."""

    timestamp: Time
    frame_id: str
    pose: FoxglovePose


class FrameTransform(msgspec.Struct, frozen=True, gc=False):
    """foxglove.FrameTransform."""

    timestamp: Time
    parent_frame_id: str
    child_frame_id: str
    translation: Vector3
    rotation: Quaternion


class Log(msgspec.Struct, frozen=True, gc=False):
    """foxglove.Log; level 2 is info, 3 a warning."""

    timestamp: Time
    level: int
    message: str
    name: str
    file: str
    line: int


class Measured(msgspec.Struct, frozen=True, gc=False):
    """A pose as the pilot got it."""

    time_s: float
    arrival_s: float
    id: int
    position_ned: Vector3
    attitude: Quaternion
    reset_count: int
    velocity_ned: Vector3 | msgspec.UnsetType = msgspec.UNSET


class Part(msgspec.Struct, frozen=True, gc=False):
    """One part of a bring-down (links/core/port.py)."""

    duration_s: float
    thrust_n: float
    rates_rad_s: Vector3


class Commanded(msgspec.Struct, frozen=True, gc=False):
    """A command as it was handed to the link."""

    time_s: float
    flight_time_s: float
    thrust_n: float
    rates_rad_s: Vector3
    saturated: bool
    pose_id: int
    pose_time_s: float
    deadline_s: float
    bring_down: tuple[Part, ...]


class Idle(msgspec.Struct, frozen=True, gc=False):
    """An idle command."""

    time_s: float
    thrust_n: float
    rates_rad_s: Vector3
    pose_id: int
    pose_time_s: float
    deadline_s: float
    bring_down: tuple[Part, ...]


class Refer(msgspec.Struct, frozen=True, gc=False):
    """The reference at the instant that the command acts."""

    time_s: float
    position_ned: Vector3
    velocity_ned: Vector3
    acceleration_ned: Vector3
    jerk_ned: Vector3
    yaw_rad: float
    yaw_rate_rad_s: float


class Estimated(msgspec.Struct, frozen=True, gc=False):
    """The vehicle at the instant that the command acts, ``acting_s``."""

    time_s: float
    acting_s: float
    position_ned: Vector3
    velocity_ned: Vector3
    attitude: Quaternion
    thrust_n: float
    rates_rad_s: Vector3


class Errors(msgspec.Struct, frozen=True, gc=False):
    """The backstepping errors, and the distance from the reference."""

    time_s: float
    error_m: float
    z1_m: Vector3
    z2_m_s: Vector3
    z3_m_s2: Vector3
    u_star_m_s2: Vector3


class Adaptation(msgspec.Struct, frozen=True, gc=False):
    """b̂ and its rate, the observer's d̂, and the thrust's effectiveness λ̂."""

    time_s: float
    b_hat_m_s2: Vector3
    b_hat_dot_m_s3: Vector3
    d_hat_m_s2: Vector3
    effectiveness: float


class Lyapunov(msgspec.Struct, frozen=True, gc=False):
    """V without its b̃ term, W, the terms of both, and V against its bound in flight (control/watch.py)."""

    time_s: float
    v_known: float
    v_sigma: float
    v_omega: float
    v_z3: float
    w: float
    w_sigma: float
    w_rho: float
    w_z3: float
    certificate: str
    state: str
    excess: float


class Timing(msgspec.Struct, frozen=True, gc=False):
    """How late the command was for its frame (or after its pose came), how old its pose, how long after the last."""

    time_s: float
    pose_age_s: float
    interval_s: float
    lateness_s: float | msgspec.UnsetType = msgspec.UNSET


class Follow(msgspec.Struct, frozen=True, gc=False):
    """A new trajectory begins."""

    time_s: float


class Switch(msgspec.Struct, frozen=True, gc=False):
    """The pilot flies otherwise from here on: on the floor, off it, descending."""

    time_s: float
    what: str
    values: list[float]


class Mission(msgspec.Struct, frozen=True, gc=False):
    """A line for the operator, and the mission's state."""

    time_s: float
    state: str
    text: str


class Request(msgspec.Struct, frozen=True, gc=False):
    """Somebody asked the flight for ``what``."""

    time_s: float
    what: str
    reason: str


class Missing(msgspec.Struct, frozen=True, gc=False):
    """So many records are missing here."""

    time_s: float
    count: int


class Link(msgspec.Struct, frozen=True, gc=False):
    """How the command link is."""

    time_s: float
    status: LinkStatus


class Source(msgspec.Struct, frozen=True, gc=False):
    """How the pose source is."""

    time_s: float
    status: PoseStatus


class WireOpened(msgspec.Struct, frozen=True, gc=False):
    """A wire was opened; addresses are host:port, or empty."""

    time_s: float
    wire: int
    kind: str
    local: str
    remote: str


class RawReceived(msgspec.Struct, frozen=True, gc=False):
    """Bytes that came in, in base64."""

    time_s: float
    wire: int
    turn: int
    peer: str
    data: bytes


class RawSent(msgspec.Struct, frozen=True, gc=False):
    """Bytes that left, in base64."""

    time_s: float
    wire: int
    peer: str
    data: bytes


CHANNELS: dict[str, tuple[str, type[msgspec.Struct]]] = {
    "/pose": ("foxglove.PoseInFrame", PoseInFrame),
    "/tf": ("foxglove.FrameTransform", FrameTransform),
    "/log": ("foxglove.Log", Log),
    "/measured": ("groundstation.Measured", Measured),
    "/command": ("groundstation.Command", Commanded),
    "/idle": ("groundstation.Idle", Idle),
    "/reference": ("groundstation.Reference", Refer),
    "/estimate": ("groundstation.Estimate", Estimated),
    "/errors": ("groundstation.Errors", Errors),
    "/adaptation": ("groundstation.Adaptation", Adaptation),
    "/lyapunov": ("groundstation.Lyapunov", Lyapunov),
    "/timing": ("groundstation.Timing", Timing),
    "/follow": ("groundstation.Follow", Follow),
    "/switch": ("groundstation.Switch", Switch),
    "/mission": ("groundstation.Mission", Mission),
    "/request": ("groundstation.Request", Request),
    "/lost": ("groundstation.Lost", Missing),
    "/link": ("groundstation.Link", Link),
    "/source": ("groundstation.Source", Source),
    "/raw/opened": ("groundstation.WireOpened", WireOpened),
    "/raw/received": ("groundstation.RawReceived", RawReceived),
    "/raw/sent": ("groundstation.RawSent", RawSent),
}
"""Topic → name of its schema, and type of its messages."""


def schema(name: str, message: type[msgspec.Struct]) -> bytes:
    """The JSON schema of ``message``, titled ``name``, without references and unions: Foxglove follows none.

    What may be null is not required, and has the type that it has otherwise.
    """
    (top,), parts = msgspec.json.schema_components([message], ref_template="{name}")
    whole = _inlined(parts[top["$ref"]], parts)
    return json.dumps({**whole, "title": name}).encode()


def _inlined(part: Any, parts: dict[str, Any]) -> Any:
    if isinstance(part, list):
        return [_inlined(item, parts) for item in part]
    if not isinstance(part, dict):
        return part
    if "$ref" in part:
        return _inlined(parts[part["$ref"]], parts)
    if "anyOf" in part:
        return _inlined(next(kind for kind in part["anyOf"] if kind != {"type": "null"}), parts)
    whole = {key: _inlined(value, parts) for key, value in part.items() if key not in ("title", "default")}
    if "properties" in part:
        always = [key for key in part.get("required", ()) if "anyOf" not in part["properties"][key]]
        whole["required"] = always
    return {"title": "time", **whole} if part.get("title") == "Time" else whole  # by this Foxglove knows a time
