"""Channels of a recording: topic → type of its messages, in JSON, each with its JSON schema as
Foxglove reads it.

``/pose``, ``/tf`` and ``/log`` are Foxglove's own, which its panels know how to draw (foxglove-sdk,
schemas/jsonschema); the others are typed here. Names end in units; world NED, body FRD; ``time_s``
is the event loop's clock [s], the log time its wall time.

:class:`MessageMaker` makes these messages of a flight's records; ``read_…`` makes of them what was
recorded. Sans-IO.
"""

import json
import math
from collections.abc import Iterable, Iterator
from enum import IntEnum
from functools import lru_cache
from typing import Any

import msgspec

from groundstation.core.geometry import Quat, Vec3
from groundstation.core.messages import (
    EndRecord,
    IdleRecord,
    Numbers,
    Pose,
    PoseRecord,
    PoseStatus,
    RequestRecord,
    StatusRecord,
    SwitchRecord,
    Tick,
    TickRecord,
    TrajectoryRecord,
)
from groundstation.core.trajectory import Reference
from groundstation.recording.records import (
    NO_PORT,
    LineRecord,
    LossRecord,
    Peer,
    ReceivedRecord,
    Record,
    SentRecord,
    TruthRecord,
    WireRecord,
)
from links.core import Command, LinkStatus, Segment

WORLD, VEHICLE = "world_ned", "vehicle"
"""Frames of /tf and /pose."""
DISPLAY = "world"
"""World with z up, for screens: its x is north, its y is west."""


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


def quaternion(q: Quat) -> Quaternion:
    """Name the parts of ``q``."""
    w, x, y, z = q
    return Quaternion(x, y, z, w)


class Time(msgspec.Struct, frozen=True, gc=False):
    """Since 1970, or since the beginning of virtual time."""

    sec: int
    nsec: int

    @classmethod
    def of(cls, stamp_ns: int) -> "Time":
        """The time ``stamp_ns`` [ns]."""
        return cls(*divmod(stamp_ns, 1_000_000_000))


class FoxglovePose(msgspec.Struct, frozen=True, gc=False):
    """foxglove.Pose."""

    position: Vector3
    orientation: Quaternion = Quaternion(0.0, 0.0, 0.0, 1.0)


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


def turn_world_over(stamp: Time) -> FrameTransform:
    """The world, whose z is down, in a world with z up: as screens show it from ``stamp`` on."""
    return FrameTransform(
        stamp, DISPLAY, WORLD, Vector3(0.0, 0.0, 0.0), Quaternion(1.0, 0.0, 0.0, 0.0)
    )


class LogMessage(msgspec.Struct, frozen=True, gc=False):
    """foxglove.Log; level 2 is info, 3 a warning."""

    timestamp: Time
    level: int
    message: str
    name: str
    file: str
    line: int


class MeasuredMessage(msgspec.Struct, frozen=True, gc=False):
    """A pose as the pilot got it."""

    time_s: float
    arrival_s: float
    id: int
    position_ned: Vector3
    attitude: Quaternion
    reset_count: int
    velocity_ned: Vector3 | msgspec.UnsetType = msgspec.UNSET


class Part(msgspec.Struct, frozen=True, gc=False):
    """One part of a bring-down (links/core/deadman.py)."""

    duration_s: float
    thrust_n: float
    rates_rad_s: Vector3


class CommandMessage(msgspec.Struct, frozen=True, gc=False):
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


class IdleMessage(msgspec.Struct, frozen=True, gc=False):
    """An idle command."""

    time_s: float
    thrust_n: float
    rates_rad_s: Vector3
    pose_id: int
    pose_time_s: float
    deadline_s: float
    bring_down: tuple[Part, ...]


class ReferenceMessage(msgspec.Struct, frozen=True, gc=False):
    """The reference at the instant that the command acts."""

    time_s: float
    position_ned: Vector3
    velocity_ned: Vector3
    acceleration_ned: Vector3
    jerk_ned: Vector3
    yaw_rad: float
    yaw_rate_rad_s: float


class EstimateMessage(msgspec.Struct, frozen=True, gc=False):
    """The vehicle at the instant that the command acts, ``acting_s``."""

    time_s: float
    acting_s: float
    position_ned: Vector3
    velocity_ned: Vector3
    attitude: Quaternion
    thrust_n: float
    rates_rad_s: Vector3


class ErrorsMessage(msgspec.Struct, frozen=True, gc=False):
    """The backstepping errors, and the distance from the reference."""

    time_s: float
    error_m: float
    z1_m: Vector3
    z2_m_s: Vector3
    z3_m_s2: Vector3
    u_star_m_s2: Vector3


class AdaptationMessage(msgspec.Struct, frozen=True, gc=False):
    """b̂ and its rate, the observer's d̂, the thrust's effectiveness λ̂, and the standard deviation
    of that.
    """

    time_s: float
    b_hat_m_s2: Vector3
    b_hat_dot_m_s3: Vector3
    d_hat_m_s2: Vector3
    effectiveness: float
    effectiveness_deviation: float


class LyapunovMessage(msgspec.Struct, frozen=True, gc=False):
    """V without its b̃ term, W, the terms of both, and V against its bound in flight
    (control/certificate.py).
    """

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


class TimingMessage(msgspec.Struct, frozen=True, gc=False):
    """Delay of the command (for frame or pose), age of its pose, time since the last."""

    time_s: float
    pose_age_s: float
    interval_s: float
    lateness_s: float | msgspec.UnsetType = msgspec.UNSET


class FollowMessage(msgspec.Struct, frozen=True, gc=False):
    """A new trajectory begins."""

    time_s: float


class SwitchMessage(msgspec.Struct, frozen=True, gc=False):
    """The pilot flies otherwise from here on: on the floor, off it, descending."""

    time_s: float
    what: str
    values: list[float]


class MissionMessage(msgspec.Struct, frozen=True, gc=False):
    """A line for the operator, and the mission's state."""

    time_s: float
    state: str
    text: str
    id: str = ""
    numbers: Numbers = {}


class FlightRequestMessage(msgspec.Struct, frozen=True, gc=False):
    """Somebody asked the flight for ``what``."""

    time_s: float
    what: str
    reason: str


class LostMessage(msgspec.Struct, frozen=True, gc=False):
    """Number of records that are missing here."""

    time_s: float
    count: int


class LinkMessage(msgspec.Struct, frozen=True, gc=False):
    """State of the command link."""

    time_s: float
    status: LinkStatus


class SourceMessage(msgspec.Struct, frozen=True, gc=False):
    """State of the pose source."""

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


class TruthMessage(msgspec.Struct, frozen=True, gc=False):
    """Truth of a simulated flight: true place, distance from the reference, wind."""

    time_s: float
    position_ned: Vector3
    velocity_ned: Vector3
    attitude: Quaternion
    wind_m_s2: Vector3
    error_m: float | None = None


CHANNELS: dict[str, tuple[str, type[msgspec.Struct]]] = {
    "/pose": ("foxglove.PoseInFrame", PoseInFrame),
    "/tf": ("foxglove.FrameTransform", FrameTransform),
    "/log": ("foxglove.Log", LogMessage),
    "/measured": ("groundstation.Measured", MeasuredMessage),
    "/command": ("groundstation.Command", CommandMessage),
    "/idle": ("groundstation.Idle", IdleMessage),
    "/reference": ("groundstation.Reference", ReferenceMessage),
    "/estimate": ("groundstation.Estimate", EstimateMessage),
    "/errors": ("groundstation.Errors", ErrorsMessage),
    "/adaptation": ("groundstation.Adaptation", AdaptationMessage),
    "/lyapunov": ("groundstation.Lyapunov", LyapunovMessage),
    "/timing": ("groundstation.Timing", TimingMessage),
    "/follow": ("groundstation.Follow", FollowMessage),
    "/switch": ("groundstation.Switch", SwitchMessage),
    "/mission": ("groundstation.Mission", MissionMessage),
    "/request": ("groundstation.Request", FlightRequestMessage),
    "/lost": ("groundstation.Lost", LostMessage),
    "/link": ("groundstation.Link", LinkMessage),
    "/source": ("groundstation.Source", SourceMessage),
    "/raw/opened": ("groundstation.WireOpened", WireOpened),
    "/raw/received": ("groundstation.RawReceived", RawReceived),
    "/raw/sent": ("groundstation.RawSent", RawSent),
    "/truth": ("groundstation.Truth", TruthMessage),
}
"""Topic → name of its schema, and type of its messages."""


ChannelForm = tuple[str, str, bytes, str, str]
"""Topic; name, text and encoding of its schema; encoding of its messages."""


def channel_form(topic: str, name: str, message: type[msgspec.Struct]) -> ChannelForm:
    """The form of a channel of ``message`` in JSON, with a schema called ``name``."""
    return topic, name, schema(name, message), "jsonschema", "json"


def describe_channels(topics: Iterable[str]) -> Iterator[ChannelForm]:
    """The forms of the channels on ``topics`` in a recording."""
    return (channel_form(topic, *CHANNELS[topic]) for topic in topics)


def schema(name: str, message: type[msgspec.Struct]) -> bytes:
    """The JSON schema of ``message``, titled ``name``, without references and unions: Foxglove
    follows none.

    What may be null is not required, and has the type that it has otherwise.
    """
    (top,), parts = msgspec.json.schema_components([message], ref_template="{name}")
    whole = _inline_refs(parts[top["$ref"]], parts)
    return json.dumps({**whole, "title": name}).encode()


def _inline_refs(part: Any, parts: dict[str, Any]) -> Any:
    if isinstance(part, list):
        return [_inline_refs(item, parts) for item in part]
    if not isinstance(part, dict):
        return part
    if "$ref" in part:
        return _inline_refs(parts[part["$ref"]], parts)
    if "anyOf" in part:
        return _inline_refs(next(kind for kind in part["anyOf"] if kind != {"type": "null"}), parts)
    whole = {
        key: _inline_refs(value, parts)
        for key, value in part.items()
        if key not in ("title", "default")
    }
    if "properties" in part:
        always = [key for key in part.get("required", ()) if "anyOf" not in part["properties"][key]]
        whole["required"] = always
    # By this Foxglove knows a time.
    return {"title": "time", **whole} if part.get("title") == "Time" else whole


Message = tuple[str, float, msgspec.Struct]
"""Topic, time on the event loop's clock [s], and what it says."""


class LogLevel(IntEnum):
    """Level of foxglove.Log."""

    INFO = 2
    WARNING = 3


NAME = "groundstation"


class MessageMaker:
    """Makes messages of the records of one flight, in their order."""

    def __init__(self, epoch_ns: int) -> None:
        """``epoch_ns``: see :meth:`stamp`."""
        self._epoch_ns = epoch_ns
        self._last: float | None = None

    def stamp(self, time_s: float) -> int:
        """``time_s`` on the event loop's clock [s] as wall time [ns since 1970]."""
        return self._epoch_ns + round(time_s * 1e9)

    def of(self, record: Record) -> Iterator[Message]:
        """The messages of one record."""
        match record:  # those that come often first
            case ReceivedRecord(time_s, wire, turn, peer, data):
                yield "/raw/received", time_s, RawReceived(time_s, wire, turn, address(peer), data)
            case SentRecord(time_s, wire, peer, data):
                yield "/raw/sent", time_s, RawSent(time_s, wire, address(peer), data)
            case TickRecord():
                yield from self._tick(record)
            case PoseRecord():
                yield from self._pose(record)
            case TruthRecord():
                yield _make_truth(record)
            case IdleRecord(time_s, _, command):
                self._last = None
                yield "/idle", time_s, IdleMessage(time_s, *_command(command))
            case StatusRecord(time_s, link, source):
                yield "/link", time_s, LinkMessage(time_s, link)
                yield "/source", time_s, SourceMessage(time_s, source)
            case WireRecord(time_s, wire, kind, local, remote):
                if wire == 0:
                    yield "/tf", time_s, turn_world_over(self._time(time_s))
                yield (
                    "/raw/opened",
                    time_s,
                    WireOpened(time_s, wire, kind, address(local), address(remote)),
                )
            case TrajectoryRecord(time_s):
                yield "/follow", time_s, FollowMessage(time_s)
            case SwitchRecord(time_s, what, values):
                yield "/switch", time_s, SwitchMessage(time_s, what, list(values))
            case LineRecord(time_s, state, text, id, numbers):
                yield "/mission", time_s, MissionMessage(time_s, state, text, id, numbers)
                yield self._log(time_s, LogLevel.INFO, f"{state}: {text}")
            case EndRecord(time_s, state, reason):
                yield self._log(time_s, LogLevel.INFO, f"the flight is over, {state}: {reason}")
            case RequestRecord(time_s, what, reason):
                yield "/request", time_s, FlightRequestMessage(time_s, what, reason)
            case LossRecord(time_s, count):
                yield "/lost", time_s, LostMessage(time_s, count)
                yield self._log(
                    time_s,
                    LogLevel.WARNING,
                    f"{count} records are missing here: the recorder could not keep up",
                )

    def _log(self, time_s: float, level: int, text: str) -> Message:
        return "/log", time_s, LogMessage(self._time(time_s), level, text, NAME, "", 0)

    def _pose(self, record: PoseRecord) -> Iterable[Message]:
        p = record.pose
        position, attitude = Vector3(*p.position_ned), quaternion(p.attitude)
        velocity = msgspec.UNSET if p.velocity_ned is None else Vector3(*p.velocity_ned)
        measured = MeasuredMessage(
            p.time_s, p.arrival_s, p.id, position, attitude, p.reset_count, velocity
        )
        shown = PoseInFrame(self._time(p.time_s), WORLD, FoxglovePose(position, attitude))
        return ("/measured", p.arrival_s, measured), ("/pose", p.arrival_s, shown)

    def _tick(self, record: TickRecord) -> Iterator[Message]:
        tick, t, estimate = record.tick, record.tick.time_s, record.tick.estimate
        motion = estimate.motion
        position, attitude = Vector3(*motion.position), quaternion(motion.attitude)
        yield "/command", t, _make_command(tick)
        yield "/reference", t, _make_reference(t, tick.reference)
        estimated = EstimateMessage(
            t,
            estimate.time_s,
            position,
            Vector3(*motion.velocity),
            attitude,
            motion.thrust,
            Vector3(*motion.rates),
        )
        yield "/estimate", t, estimated
        yield from _make_law(tick)
        yield "/timing", t, self._timing(tick, record.late_s)
        stamp = self._time(estimate.time_s)
        yield "/tf", t, FrameTransform(stamp, WORLD, VEHICLE, position, attitude)

    def _timing(self, tick: Tick, late_s: float | None) -> TimingMessage:
        now, last = tick.time_s, self._last
        self._last = now
        interval = 0.0 if last is None else now - last
        return TimingMessage(
            now, now - tick.pose.time_s, interval, msgspec.UNSET if late_s is None else late_s
        )

    def _time(self, time_s: float) -> Time:
        return Time.of(self.stamp(time_s))


def _make_command(tick: Tick) -> CommandMessage:
    """The command of a tick, as it was handed to the link."""
    thrust, rates, pose_id, pose_time, deadline, parts = _command(tick.command)
    return CommandMessage(
        tick.time_s,
        tick.flight_time_s,
        thrust,
        rates,
        bool(tick.decision.saturated),
        pose_id,
        pose_time,
        deadline,
        parts,
    )


def _make_reference(time_s: float, reference: Reference) -> ReferenceMessage:
    return ReferenceMessage(
        time_s,
        Vector3(*reference.position_ned),
        Vector3(*reference.velocity_ned),
        Vector3(*reference.acceleration_ned),
        Vector3(*reference.jerk_ned),
        reference.yaw_rad,
        reference.yaw_rate_rad_s,
    )


def _make_law(tick: Tick) -> Iterator[Message]:
    """Quantities of the law in a tick: its errors, its adaptation, and its Lyapunov function."""
    t, estimate, d = tick.time_s, tick.estimate, tick.decision.diagnostics
    error = math.dist(estimate.motion.position, tick.reference.position_ned)
    z1, z2, z3, u_star = (Vector3(*v) for v in (d.z1, d.z2, d.z3, d.u_star))
    yield "/errors", t, ErrorsMessage(t, error, z1, z2, z3, u_star)
    adaptation = AdaptationMessage(
        t,
        Vector3(*d.b_hat),
        Vector3(*d.b_hat_dot),
        Vector3(*d.disturbance),
        estimate.effectiveness,
        estimate.effectiveness_deviation,
    )
    yield "/adaptation", t, adaptation
    lyapunov = LyapunovMessage(
        t, d.v_known, *d.v_terms, d.w, *d.w_terms, d.certificate, *tick.certificate[:2]
    )
    yield "/lyapunov", t, lyapunov


def _make_truth(r: TruthRecord) -> Message:
    at, velocity, attitude = (
        Vector3(*r.position_ned),
        Vector3(*r.velocity_ned),
        quaternion(r.attitude),
    )
    return (
        "/truth",
        r.time_s,
        TruthMessage(r.time_s, at, velocity, attitude, Vector3(*r.wind_m_s2), r.error_m),
    )


def _command(c: Command) -> tuple[float, Vector3, int, float, float, tuple[Part, ...]]:
    parts = tuple(Part(p.duration_s, p.thrust_n, Vector3(*p.rates_rad_s)) for p in c.bring_down)
    return c.thrust_n, Vector3(*c.rates_rad_s), c.pose_id, c.pose_time_s, c.deadline_s, parts


@lru_cache(64)
def address(peer: Peer) -> str:
    """``host:port``, the name of a serial port, or an empty string."""
    if peer is None:
        return ""
    return peer[0] if peer[1] == NO_PORT else f"{peer[0]}:{peer[1]}"


def read_pose(seen: MeasuredMessage) -> Pose:
    """The pose as the pilot got it."""
    velocity = None if seen.velocity_ned is msgspec.UNSET else _components(seen.velocity_ned)
    at, q = _components(seen.position_ned), seen.attitude
    return Pose(
        seen.id, seen.time_s, seen.arrival_s, at, (q.w, q.x, q.y, q.z), velocity, seen.reset_count
    )


def read_reference(r: ReferenceMessage) -> Reference:
    """Where the vehicle should have been."""
    return Reference(
        _components(r.position_ned),
        _components(r.velocity_ned),
        _components(r.acceleration_ned),
        _components(r.jerk_ned),
        r.yaw_rad,
        r.yaw_rate_rad_s,
    )


def read_command(c: CommandMessage | IdleMessage) -> Command:
    """The command as it was handed to the link."""
    parts = tuple(
        Segment(part.duration_s, part.thrust_n, _components(part.rates_rad_s))
        for part in c.bring_down
    )
    return Command(
        c.thrust_n, _components(c.rates_rad_s), c.pose_id, c.pose_time_s, c.deadline_s, parts
    )


def _components(v: Vector3) -> Vec3:
    return (v.x, v.y, v.z)
