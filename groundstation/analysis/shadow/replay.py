"""The shadow: our estimator and controller over a recording, at the recorded instants. Deterministic.

The estimator gets the poses as in flight, with the autopilot's own velocity and its resets, and the set-points that
were sent, as they are what the vehicle obeyed. At each set-point in flight the controller says what it would have
sent along the path that was flown (path.py). What it says goes nowhere: the next set-point is again the recorded one.
So a correction that it asks for is never made, and it keeps asking: its commands are livelier than they would be in
flight. Most of all where the autopilot's velocity is corrected (by GPS): that looks like wind, and wind is answered.

What came of it in numbers are the fields of ``groundstation replay --json``, all but the verdict.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from groundstation.analysis.shadow.path import UNKNOWN, FlownPath, flying, thrust_shares
from groundstation.analysis.shadow.recording import RecordedVehicle
from groundstation.core.control import Adaptive, make_controller
from groundstation.core.estimation import ModelEstimator
from groundstation.core.geometry import Vec3, conjugate, multiply, rotation_vector
from groundstation.core.messages import Controller, Estimate, Pose
from groundstation.core.vehicle import Drive
from groundstation.settings import Config


class ShadowedPose(NamedTuple):
    """What the shadow made of one pose."""

    pose: Pose
    velocity_ned: Vec3
    """Estimated velocity at the pose's instant, after its correction [m/s]."""
    innovation_m: float
    """Distance from where the model expected the pose."""
    flying: bool


class ShadowedCommand(NamedTuple):
    """One set-point that was sent, and what the shadow would have sent."""

    sent: Drive
    shadow: Drive
    saturated: bool


class ShadowedFlight(NamedTuple):
    """A whole recording."""

    known: list[ShadowedPose]
    compared: list[ShadowedCommand]
    ignored: int
    """Poses not newer than the one before, on our clock."""


class Shadow:
    """Estimator and controller of one vehicle, driven by what was recorded."""

    def __init__(self, config: Config, path: FlownPath) -> None:
        """``path`` is what the controller follows."""
        self._vehicle = config.vehicle
        self._config = config.controller
        self._path = path
        self._estimator = ModelEstimator(self._vehicle, self._config)
        self._controller: Controller | None = None
        self._last_decision_s = 0.0
        self._steps: Vec3 = (0.0, 0.0, 0.0)

    def pose(self, pose: Pose) -> tuple[Vec3, float]:
        """Take one pose; the estimated velocity there [m/s] and the innovation [m]."""
        innovation = 0.0
        if self._estimator.ready:
            innovation = math.dist(pose.position_ned, self._estimate(pose.time_s).motion.position)
        self._estimator.pose(pose)
        return self._estimate(pose.time_s).motion.velocity, innovation

    def compare_command(self, time_s: float, drive: Drive, *, flying: bool) -> ShadowedCommand | None:
        """``drive`` was sent at ``time_s`` [s]; in flight, what the shadow would have sent, where there is a path."""
        acting = time_s + self._vehicle.command_delay_s
        reference = self._path.at(acting) if flying else None
        compared = None
        if reference is not None and self._estimator.ready:
            if self._controller is None:  # each take-off begins without what the stand has taught, as in flight
                self._estimator.release()
                self._steps = (0.0, 0.0, 0.0)
                self._controller = make_controller(self._config, self._vehicle)
                self._last_decision_s = time_s
            estimate = self._estimate(acting)._replace(disturbance_step=self._steps)
            self._steps = (0.0, 0.0, 0.0)
            decision = self._controller.decide(estimate, reference, time_s - self._last_decision_s)
            self._last_decision_s = time_s
            compared = ShadowedCommand(drive, decision.drive, decision.saturated)
        elif not flying:
            self._controller = None
        self._estimator.sent(acting, drive)
        if isinstance(self._controller, Adaptive) and self._config.composite != "provable":
            self._estimator.follow(self._controller.b_hat)
        return compared

    def _estimate(self, time_s: float) -> Estimate:
        """The estimate; what it asks b̂ to change by is kept for the controller, as it is told only once."""
        estimate = self._estimator.predict(time_s)
        (a, b, c), (x, y, z) = self._steps, estimate.disturbance_step
        self._steps = (a + x, b + y, c + z)
        return estimate


def replay(recording: RecordedVehicle, config: Config, path: FlownPath, hover: float | None) -> ShadowedFlight:
    """Run the shadow over ``recording``; ``hover``: see path.py."""
    shares = thrust_shares(recording.sent, config.thrust_curve)
    flags = flying(recording, shares, hover)
    shadow = Shadow(config, path)
    known: list[ShadowedPose] = []
    compared: list[ShadowedCommand] = []
    ignored = 0
    in_flight = False
    full_thrust_n = config.full_thrust_n
    events: list[tuple[float, int, int]] = [
        *((seen.pose.arrival_s, 0, i) for i, seen in enumerate(recording.poses)),
        *((each.time_s, 1, i) for i, each in enumerate(recording.sent)),
    ]
    for time_s, is_sent, index in sorted(events):
        if is_sent:
            drive = Drive(full_thrust_n * shares[index], recording.sent[index].rates)
            both = shadow.compare_command(time_s, drive, flying=in_flight)
            if both is not None:
                compared.append(both)
            continue
        pose = recording.poses[index].pose
        if known and pose.time_s <= known[-1].pose.time_s:
            ignored += 1
            continue
        in_flight = bool(flags[index])
        velocity, innovation = shadow.pose(pose)
        known.append(ShadowedPose(pose, velocity, innovation, in_flight))
    return ShadowedFlight(known, compared, ignored)


GAP = 3.0
"""An interval this many times the usual one is a gap."""

Array = npt.NDArray[np.float64]


class PoseGaps(msgspec.Struct, frozen=True):
    """Intervals between the arrivals of two poses, in flight (in the whole recording where nothing flies)."""

    count: int
    """How many are longer than three times the usual one."""
    longest_s: float
    """[s]"""
    limit_s: float
    """How long commands may rest on one pose (flight.coast_s) [s]."""


class PoseReset(msgspec.Struct, frozen=True):
    """The source moved its origin or its attitude in flight."""

    time_s: float
    """Since the recording began [s]."""
    moved_m: float
    """How far from where the model expected it the next pose was [m]."""
    turned_rad: float
    """Between the attitudes before and after it [rad]."""


class ComparedNumber(msgspec.Struct, frozen=True):
    """One number of the commands, as sent and as the shadow would have sent it, in flight."""

    sent_mean: float
    shadow_mean: float
    sent_std: float
    shadow_std: float
    difference_rms: float
    correlation: float | None
    """None where one of the two never changed."""


class ComparedCommands(msgspec.Struct, frozen=True):
    """The set-points that were sent in flight, beside those of the shadow."""

    compared: int
    thrust_n: ComparedNumber
    roll_rate_rad_s: ComparedNumber
    pitch_rate_rad_s: ComparedNumber
    yaw_rate_rad_s: ComparedNumber
    saturated_fraction: float
    """Share of the shadow's commands of which a part was at a limit."""


class ShadowFacts(msgspec.Struct, frozen=True, kw_only=True):
    """Everything measured. None: the recording does not tell."""

    file: str
    autopilot: str
    pose_source: str
    poses: int
    dropped: dict[str, int]
    """Bytes, frames, log times, poses and set-points not used, by reason."""
    rate_hz: float | None
    """Poses a second, in flight (in the whole recording where nothing flies)."""
    gaps: PoseGaps
    resets: int
    """Changes of the source's reset counter in the whole recording."""
    resets_in_flight: list[PoseReset]
    flights: int
    flight_s: float
    """Time in the air on set-points [s]."""
    hover_thrust: float | None
    """Share of full thrust that carries the vehicle, as flown."""
    hover_configured: float
    """The same by the configuration: m g / thrust_max."""
    velocity_rms_m_s: float | None
    """Estimated velocity against the autopilot's own, in flight: length of the difference [m/s]."""
    velocity_max_m_s: float | None
    velocity_path_rms_m_s: float | None
    """Estimated velocity against how fast the recorded positions move (path.py), in flight: as above [m/s]."""
    own_velocity_path_rms_m_s: float | None
    """The autopilot's own velocity against the same: how far its velocity and its positions disagree [m/s]."""
    innovation_rms_m: float | None
    """How far each pose was from where the model expected it, in flight [m]."""
    commands: ComparedCommands | None


def measure_facts(
    file: str,
    recording: RecordedVehicle,
    replayed: ShadowedFlight,
    path: FlownPath,
    config: Config,
    hover: float | None,
) -> ShadowFacts:
    """The numbers of one replay with ``config``; ``hover``: see path.py."""
    known = replayed.known
    air = [each for each in known if each.flying]
    intervals = np.array([b.pose.arrival_s - a.pose.arrival_s for a, b in pairwise(known) if a.flying or not air])
    usual = float(np.median(intervals)) if len(intervals) else 0.0
    total = float(intervals.sum())
    own = np.array([each.pose.velocity_ned or UNKNOWN for each in air]).reshape(-1, 3)
    ours = np.array([each.velocity_ned for each in air]).reshape(-1, 3)
    moved = np.array([path.velocity_of_positions(each.pose.time_s) or UNKNOWN for each in air]).reshape(-1, 3)
    from_own = _lengths(ours - own)
    resets = [(a, b) for a, b in pairwise(known) if a.pose.reset_count != b.pose.reset_count]
    return ShadowFacts(
        file=file,
        autopilot=recording.autopilot,
        pose_source=recording.pose_source,
        poses=len(recording.poses),
        dropped=recording.dropped | ({"not_newer": replayed.ignored} if replayed.ignored else {}),
        rate_hz=len(intervals) / total if total > 0.0 else None,
        gaps=PoseGaps(
            int(np.count_nonzero(intervals > GAP * usual)),
            float(intervals.max(initial=0.0)),
            config.flight.coast_s,
        ),
        resets=len(resets),
        resets_in_flight=[
            PoseReset(b.pose.time_s, b.innovation_m, _turned_rad(a.pose, b.pose)) for a, b in resets if b.flying
        ],
        flights=sum(b.flying and not a.flying for a, b in pairwise(known)) + known[0].flying,
        flight_s=total if air else 0.0,
        hover_thrust=hover,
        hover_configured=config.vehicle.mass_kg * config.controller.gravity / config.full_thrust_n,
        velocity_rms_m_s=_rms(from_own),
        velocity_max_m_s=float(from_own.max()) if len(from_own) else None,
        velocity_path_rms_m_s=_rms(_lengths(ours - moved)),
        own_velocity_path_rms_m_s=_rms(_lengths(own - moved)),
        innovation_rms_m=_rms(np.array([each.innovation_m for each in air])),
        commands=_commands(replayed.compared),
    )


def _turned_rad(before: Pose, after: Pose) -> float:
    return math.hypot(*rotation_vector(multiply(conjugate(before.attitude), after.attitude)))


def _lengths(vectors: Array) -> Array:
    """Lengths (M,) of those of the vectors (N, 3) that are known."""
    lengths: Array = np.linalg.norm(vectors, axis=1)
    return lengths[np.isfinite(lengths)]


def _rms(values: Array) -> float | None:
    return float(np.sqrt(np.mean(values * values))) if len(values) else None


def _commands(compared: Sequence[ShadowedCommand]) -> ComparedCommands | None:
    if not compared:
        return None
    sent = np.array([(each.sent.thrust, *each.sent.rates) for each in compared])
    shadow = np.array([(each.shadow.thrust, *each.shadow.rates) for each in compared])
    thrust, roll, pitch, yaw = (_pair(sent[:, i], shadow[:, i]) for i in range(4))
    saturated = sum(each.saturated for each in compared) / len(compared)
    return ComparedCommands(len(compared), thrust, roll, pitch, yaw, saturated)


def _pair(sent: Array, shadow: Array) -> ComparedNumber:
    deviation = float(sent.std()), float(shadow.std())
    return ComparedNumber(
        float(sent.mean()),
        float(shadow.mean()),
        *deviation,
        float(np.sqrt(np.mean((shadow - sent) ** 2))),
        float(np.corrcoef(sent, shadow)[0, 1]) if min(deviation) > 0.0 else None,
    )
