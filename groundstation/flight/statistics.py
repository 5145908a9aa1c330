"""Flight statistics: what screens and telemetry show, kept up to date as poses, commands and events pass by."""

import asyncio
import math
from collections import deque

from groundstation.core import Tick
from groundstation.core.geometry import Quat, Vec3
from groundstation.core.messages import Certificate, Check, Pose, PoseStatus, Snapshot, SteadyError
from groundstation.core.mission import State
from groundstation.settings import Config
from links.core import CommandLink, Lateness, LinkStatus

ZERO: Vec3 = (0.0, 0.0, 0.0)
LEVEL: Quat = (1.0, 0.0, 0.0, 0.0)


class FrameLateness:
    """When the next frame is due; a late one is skipped, never made up for (:class:`Pacing` has the same rule)."""

    def __init__(self, link: CommandLink) -> None:
        """Nothing is asked of ``link`` before the first command: some tell their period only once connected."""
        self._link = link
        self._due_s: float | None = None
        self._pose_id: int | None = None

    def begin(self) -> None:
        """The next command is the first."""
        self._due_s = None

    def late_s(self, now_s: float, pose_id: int, arrival_s: float) -> float | None:
        """How late the command of this instant is [s]; None for one in between, that is no frame's and no new pose's.

        It rests on the pose ``pose_id``, which came at ``arrival_s`` [s].
        """
        if not self._link.follows_poses:
            return self._late_for_frame(now_s, self._link.period_s)
        new, self._pose_id = pose_id != self._pose_id, pose_id
        return now_s - arrival_s if new else None

    def _late_for_frame(self, now_s: float, period_s: float) -> float | None:
        if self._due_s is None:
            self._due_s = now_s
        late = now_s - self._due_s
        if late < -0.5 * period_s:
            return None
        self._due_s += period_s
        if self._due_s < now_s:
            self._due_s = now_s + period_s
        return late


class FlightStatistics:
    """Counts and remembers; makes a :class:`Snapshot` only when one is asked for."""

    def __init__(self, config: Config, link: CommandLink) -> None:
        """Begin with nothing seen; ``link`` is the one that commands leave by."""
        self._vehicle = config.vehicle
        self._arrivals: deque[float] = deque(maxlen=1000)
        self._events: deque[str] = deque(maxlen=20)
        self._tick: Tick | None = None
        self._steady = SteadyError()
        self._due = FrameLateness(link)
        self._lateness = Lateness()

    def pose(self, pose: Pose) -> None:
        """One pose was taken."""
        self._arrivals.append(pose.arrival_s)

    def tick(self, tick: Tick, *, counts: bool) -> None:
        """One command left; ``counts`` where its error belongs to the trajectory."""
        late = self._due.late_s(tick.time_s, tick.pose.id, tick.pose.arrival_s)
        if late is not None:
            self._lateness.add(late)
        self._tick = tick
        if counts:
            error = math.dist(tick.estimate.motion.position, tick.reference.position_ned)
            self._steady.add(tick.flight_time_s, error)

    def event(self, line: str) -> None:
        """One line for the operator."""
        self._events.append(line)

    def snapshot(
        self,
        *,
        state: State,
        reason: str,
        started_s: float | None,
        pose: Pose | None,
        source: PoseStatus,
        link: LinkStatus,
        certificate: Certificate | None,
        checks: tuple[Check, ...],
        gains: dict[str, float],
    ) -> Snapshot:
        """The flight as it is now; before the first command, position and attitude are the newest pose's."""
        now = asyncio.get_running_loop().time()
        position, velocity, attitude = ZERO, ZERO, LEVEL
        if self._tick is not None:
            motion = self._tick.estimate.motion
            position, velocity, attitude = motion.position, motion.velocity, motion.attitude
        elif pose is not None:
            position, attitude = pose.position_ned, pose.attitude
        tick = self._tick
        reference = position if tick is None else tick.reference.position_ned
        roll, pitch, yaw = self._vehicle.rate_limits_deg_s
        return Snapshot(
            vehicle=self._vehicle.name,
            state=state,
            reason=reason,
            time_s=now,
            flight_time_s=0.0 if started_s is None else now - started_s,
            pose_id=-1 if pose is None else pose.id,
            pose_age_s=0.0 if pose is None else now - pose.time_s,
            pose_rate_hz=self._rate(now),
            poses_dropped=source.dropped,
            position_ned=position,
            velocity_ned=velocity,
            attitude=attitude,
            reference_ned=reference,
            error_m=math.dist(position, reference),
            rms_m=self._steady.rms_m or 0.0,
            thrust_n=0.0 if tick is None else tick.decision.drive.thrust,
            thrust_max_n=self._vehicle.thrust_max_n,
            rates_rad_s=ZERO if tick is None else tick.decision.drive.rates,
            saturated=tick is not None and tick.decision.saturated,
            diagnostics=None if tick is None else tick.decision.diagnostics,
            link=link,
            events=tuple(self._events),
            rate_limits_rad_s=(math.radians(roll), math.radians(pitch), math.radians(yaw)),
            thrust_effectiveness=1.0 if tick is None else tick.estimate.effectiveness,
            pose_latency_s=source.latency_s,
            pose_latency_max_s=source.latency_max_s,
            pose_gaps=source.gaps,
            pose_clock_steps=source.clock_steps + source.clock_restarts,
            certificate=certificate,
            checks=checks,
            gains=gains,
            late_us=self._lateness.percentiles_us() if self._lateness.count else None,
            late_octaves=tuple(self._lateness.octaves) if self._lateness.count else (),
        )

    def _rate(self, now: float) -> float:
        """Poses that arrived within the last second."""
        while self._arrivals and self._arrivals[0] < now - 1.0:
            self._arrivals.popleft()
        return float(len(self._arrivals))
