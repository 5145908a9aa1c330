"""From records to the messages of the channels. Sans-IO."""

import math
from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from typing import Any

import msgspec

from groundstation.core import Tick
from groundstation.core.geometry import Quat, Vec3
from groundstation.recording import channels as ch
from groundstation.recording.channels import (
    DISPLAY,
    VEHICLE,
    WORLD,
    FoxglovePose,
    FrameTransform,
    Log,
    PoseInFrame,
    Time,
    Vector3,
    quaternion,
    vector,
)
from groundstation.recording.records import (
    NO_PORT,
    Asked,
    Ended,
    Followed,
    Idled,
    Looked,
    Lost,
    Opened,
    Peer,
    Posed,
    Received,
    Record,
    Sent,
    Switched,
    Ticked,
    Told,
)
from links.core import Command

Message = tuple[str, float, msgspec.Struct]
"""Topic, time on the event loop's clock [s], and what it says."""

INFO, WARNING = 2, 3
"""Levels of foxglove.Log."""
NAME = "groundstation"


class Messages:
    """Makes messages of the records of one flight, in their order."""

    def __init__(self, epoch_ns: int) -> None:
        """``epoch_ns``: see :meth:`stamp`."""
        self._epoch_ns = epoch_ns
        self._last: float | None = None
        self._often: dict[type, Callable[[Any], Iterable[Message]]] = {
            Received: self._received,
            Sent: self._sent,
            Posed: self._pose,
            Ticked: self._tick,
        }

    def stamp(self, time_s: float) -> int:
        """``time_s`` on the event loop's clock [s] as wall time [ns since 1970]."""
        return self._epoch_ns + round(time_s * 1e9)

    def of(self, record: Record) -> Iterable[Message]:
        """The messages of one record."""
        make = self._often.get(type(record))
        return self._rare(record) if make is None else make(record)

    def _received(self, r: Received) -> Iterable[Message]:
        return (("/raw/received", r.time_s, ch.RawReceived(r.time_s, r.wire, r.turn, address(r.peer), r.data)),)

    def _sent(self, r: Sent) -> Iterable[Message]:
        return (("/raw/sent", r.time_s, ch.RawSent(r.time_s, r.wire, address(r.peer), r.data)),)

    def _rare(self, record: Record) -> Iterator[Message]:
        match record:
            case Idled(time_s, _, command):
                self._last = None
                yield "/idle", time_s, ch.Idle(time_s, *_command(command))
            case Looked(time_s, link, source):
                yield "/link", time_s, ch.Link(time_s, link)
                yield "/source", time_s, ch.Source(time_s, source)
            case Opened(time_s, wire, kind, local, remote):
                if wire == 0:  # screens with z up see the world as it stands
                    yield self._transform(time_s, DISPLAY, WORLD, (0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0))
                yield "/raw/opened", time_s, ch.WireOpened(time_s, wire, kind, address(local), address(remote))
            case Followed(time_s):
                yield "/follow", time_s, ch.Follow(time_s)
            case Switched(time_s, what, values):
                yield "/switch", time_s, ch.Switch(time_s, what, list(values))
            case Told(time_s, state, text):
                yield "/mission", time_s, ch.Mission(time_s, state, text)
                yield self._log(time_s, INFO, f"{state}: {text}")
            case Ended(time_s, state, reason):
                yield self._log(time_s, INFO, f"the flight is over, {state}: {reason}")
            case Asked(time_s, what, reason):
                yield "/request", time_s, ch.Request(time_s, what, reason)
            case Lost(time_s, count):
                yield "/lost", time_s, ch.Missing(time_s, count)
                yield self._log(time_s, WARNING, f"{count} records are missing here: the recorder could not keep up")

    def _log(self, time_s: float, level: int, text: str) -> Message:
        return "/log", time_s, Log(self._time(time_s), level, text, NAME, "", 0)

    def _pose(self, record: Posed) -> Iterable[Message]:
        p = record.pose
        position, attitude = vector(p.position_ned), quaternion(p.attitude)
        velocity = msgspec.UNSET if p.velocity_ned is None else vector(p.velocity_ned)
        measured = ch.Measured(p.time_s, p.arrival_s, p.id, position, attitude, p.reset_count, velocity)
        shown = PoseInFrame(self._time(p.time_s), WORLD, FoxglovePose(position, attitude))
        return ("/measured", p.arrival_s, measured), ("/pose", p.arrival_s, shown)

    def _tick(self, record: Ticked) -> Iterable[Message]:
        tick = record.tick
        t, estimate, reference, d = tick.time_s, tick.estimate, tick.reference, tick.decision.diagnostics
        motion = estimate.motion
        thrust, rates, pose_id, pose_time, deadline, parts = _command(tick.command)
        saturated = bool(tick.decision.saturated)
        commanded = ch.Commanded(t, tick.flight_time_s, thrust, rates, saturated, pose_id, pose_time, deadline, parts)
        refer = ch.Refer(
            t,
            vector(reference.position_ned),
            vector(reference.velocity_ned),
            vector(reference.acceleration_ned),
            vector(reference.jerk_ned),
            reference.yaw_rad,
            reference.yaw_rate_rad_s,
        )
        position, attitude = vector(motion.position), quaternion(motion.attitude)
        estimated = ch.Estimated(
            t, estimate.time_s, position, vector(motion.velocity), attitude, motion.thrust, vector(motion.rates)
        )
        error = math.dist(motion.position, reference.position_ned)
        adaptation = ch.Adaptation(
            t, vector(d.b_hat), vector(d.b_hat_dot), vector(d.disturbance), estimate.effectiveness
        )
        lyapunov = ch.Lyapunov(t, d.v_known, *d.v_terms, d.w, *d.w_terms, d.certificate, *tick.seen[:2])
        return (
            ("/command", t, commanded),
            ("/reference", t, refer),
            ("/estimate", t, estimated),
            ("/errors", t, ch.Errors(t, error, vector(d.z1), vector(d.z2), vector(d.z3), vector(d.u_star))),
            ("/adaptation", t, adaptation),
            ("/lyapunov", t, lyapunov),
            ("/timing", t, self._timing(tick, record.late_s)),
            ("/tf", t, FrameTransform(self._time(estimate.time_s), WORLD, VEHICLE, position, attitude)),
        )

    def _timing(self, tick: Tick, late_s: float | None) -> ch.Timing:
        now, last = tick.time_s, self._last
        self._last = now
        interval = 0.0 if last is None else now - last
        return ch.Timing(now, now - tick.pose.time_s, interval, msgspec.UNSET if late_s is None else late_s)

    def _transform(self, time_s: float, parent: str, child: str, at: Vec3, turned: Quat) -> Message:
        return "/tf", time_s, FrameTransform(self._time(time_s), parent, child, vector(at), quaternion(turned))

    def _time(self, time_s: float) -> Time:
        return Time(*divmod(self.stamp(time_s), 1_000_000_000))


def _command(c: Command) -> tuple[float, Vector3, int, float, float, tuple[ch.Part, ...]]:
    parts = tuple(ch.Part(p.duration_s, p.thrust_n, vector(p.rates_rad_s)) for p in c.bring_down)
    return c.thrust_n, vector(c.rates_rad_s), c.pose_id, c.pose_time_s, c.deadline_s, parts


@lru_cache(64)
def address(peer: Peer) -> str:
    """``host:port``, the name of a serial port, or an empty string."""
    if peer is None:
        return ""
    return peer[0] if peer[1] == NO_PORT else f"{peer[0]}:{peer[1]}"
