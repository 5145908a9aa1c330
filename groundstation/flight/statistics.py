"""Statistics of one flight for screens and telemetry, updated by poses, commands and events."""

import asyncio
import math
from collections import deque

from groundstation.core.geometry import IDENTITY, ZERO
from groundstation.core.messages import (
    FLOWN,
    LEAST_JUDGED_S,
    STEADY_S,
    Certificate,
    Check,
    CommandSent,
    DisturbanceMeter,
    FlightEvent,
    Notice,
    Pose,
    PoseRecord,
    PoseStatus,
    Sentence,
    Snapshot,
    SteadyError,
    Tick,
    TickRecord,
    notice,
)
from groundstation.core.mission import State
from groundstation.core.vehicle import Vehicle
from links.core import Lateness, LinkStatus
from links.text import to_cm


class FlightStatistics:
    """Statistics of one flight, for its :class:`Snapshot`."""

    def __init__(self, vehicle: Vehicle, floor_z_m: float) -> None:
        """``floor_z_m`` is the zero of heights [m, NED]."""
        self._vehicle = vehicle
        self._floor_z_m = floor_z_m
        self._arrivals: deque[float] = deque(maxlen=1000)
        self._notices: deque[Notice] = deque(maxlen=20)
        self._tick: Tick | None = None
        self._state = State.IDLE
        self._disturbance = DisturbanceMeter(vehicle.mass_kg)
        self._steady = SteadyError()
        self._flown_s = 0.0
        self._lateness = Lateness()
        self._late_s: float | None = None

    def take(self, event: FlightEvent) -> None:
        """Count ``event``; the error counts on the trajectory alone."""
        match event:
            case PoseRecord(pose):
                self._arrivals.append(pose.arrival_s)
            case TickRecord(_, late_s):
                self._late_s = late_s
            case CommandSent(tick):
                self._tick = tick
                if self._late_s is not None:
                    self._lateness.add(self._late_s)
                if self._state in FLOWN:
                    self._disturbance.add(tick.time_s, tick.estimate)
                if self._state == State.TRACKING and tick.flight_time_s >= 0.0:
                    error = math.dist(tick.estimate.motion.position, tick.reference.position_ned)
                    self._steady.add(tick.flight_time_s, error)
                    self._flown_s = tick.flight_time_s
            case Notice(_, state):
                self._notices.append(event)
                self._state = State(state)

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
        """Return the flight as it is now.

        Before the first command with the newest pose's position and attitude.
        """
        now = asyncio.get_running_loop().time()
        position, velocity, attitude = ZERO, ZERO, IDENTITY
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
            floor_z_m=self._floor_z_m,
            events=tuple(self._notices),
            rate_limits_rad_s=(math.radians(roll), math.radians(pitch), math.radians(yaw)),
            disturbance=self._disturbance.reading,
            pose_latency_s=source.latency_s,
            pose_latency_max_s=source.latency_max_s,
            pose_gaps=source.gaps,
            pose_clock_steps=source.clock_steps + source.clock_restarts,
            certificate=certificate,
            checks=checks,
            gains=gains,
            late_us=self._lateness.percentiles_us() if self._lateness.count else None,
        )

    def describe_tracking_error(self) -> Sentence:
        """Describe the tracking error of a finished flight for which the recorder did not."""
        rms_m, max_m = self._steady.rms_m, self._steady.max_m
        flown_s = self._flown_s
        if rms_m is None or max_m is None:
            return notice("recording.none_short", least_s=LEAST_JUDGED_S, flown_s=flown_s)
        return notice(
            "recording.none_figures",
            rms_cm=to_cm(rms_m),
            max_cm=to_cm(max_m),
            from_s=STEADY_S,
            flown_s=flown_s,
        )

    def _rate(self, now: float) -> float:
        """Number of poses that arrived within the last second."""
        while self._arrivals and self._arrivals[0] < now - 1.0:
            self._arrivals.popleft()
        return float(len(self._arrivals))
