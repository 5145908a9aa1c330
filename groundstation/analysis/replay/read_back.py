"""From messages of the channels back to what they were made of (recording/messages.py)."""

import msgspec

from groundstation.core.geometry.ops import Quat, Vec3
from groundstation.core.messages.pose import Pose
from groundstation.core.trajectory.port import Reference
from groundstation.recording import channels as ch
from groundstation.recording.channels import Quaternion, Vector3
from links.core.port import Command, Segment


def pose(seen: ch.Measured) -> Pose:
    """The pose as the pilot got it."""
    velocity = None if seen.velocity_ned is msgspec.UNSET else _tuple(seen.velocity_ned)
    at, attitude = _tuple(seen.position_ned), _quat(seen.attitude)
    return Pose(seen.id, seen.time_s, seen.arrival_s, at, attitude, velocity, seen.reset_count)


def reference(r: ch.Refer) -> Reference:
    """Where the vehicle should have been."""
    return Reference(
        _tuple(r.position_ned),
        _tuple(r.velocity_ned),
        _tuple(r.acceleration_ned),
        _tuple(r.jerk_ned),
        r.yaw_rad,
        r.yaw_rate_rad_s,
    )


def command(c: ch.Commanded | ch.Idle) -> Command:
    """The command as it was handed to the link."""
    parts = tuple(Segment(part.duration_s, part.thrust_n, _tuple(part.rates_rad_s)) for part in c.bring_down)
    return Command(c.thrust_n, _tuple(c.rates_rad_s), c.pose_id, c.pose_time_s, c.deadline_s, parts)


def _tuple(v: Vector3) -> Vec3:
    return (v.x, v.y, v.z)


def _quat(q: Quaternion) -> Quat:
    return (q.w, q.x, q.y, q.z)
