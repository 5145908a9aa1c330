"""Offline comparison, ``groundstation replay LOG.tlog``: what our estimator and controller make of a recorded flight.

The shadow is our estimator and controller at the recorded instants. The estimator gets the poses as in flight, with the
autopilot's own velocity and its resets, and the set-points that were sent. At each set-point in flight the controller
says what it would have sent along the path that was flown. As no correction that it asks for is ever made, it keeps
asking: its commands are livelier than in flight, most where the autopilot's velocity is corrected (by GPS).

The reference is a polynomial fitted to the poses around each instant, later ones included (local regression; Savitzky
and Golay's filter, but for uneven stamps). Where poses carry a velocity, the estimator takes it for the motion and lets
the positions wander against it: there velocity and its derivatives are those of the recorded velocities.
"""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from groundstation.config import ConfigError, from_dict, load, refuse_io
from groundstation.core.control import Adaptive, make_controller
from groundstation.core.estimation import ModelEstimator
from groundstation.core.geometry import Vec3, so3, third_column
from groundstation.core.messages import Controller, Estimate, Pose, notice
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import ActuatorCommand
from groundstation.pose import (
    Sender,
    TlogReader,
    TlogRecord,
    describe_senders,
    find_autopilots,
    is_autopilot,
    pose_decoder,
)
from groundstation.pose.sources import MavlinkPoseConfig, PoseDecoder
from groundstation.runtime import Exit
from groundstation.settings import Config
from links.core import thrust
from links.mavlink import MavlinkLinkConfig
from links.mavlink.protocol import ARDUPILOT, ARMED, PX4, AttitudeTargetMask, MavCommand, Message

AUTOPILOTS = {PX4: "PX4", ARDUPILOT: "ArduPilot"}
"""Names of autopilots by HEARTBEAT.autopilot."""
ON_GROUND = 1
"""EXTENDED_SYS_STATE.landed_state (MAV_LANDED_STATE_ON_GROUND)."""
JITTER_S = 0.1
"""Loggers write messages of several wires out of order by this much at most [s]: no reason to drop one."""
FASTEST_RAD_S = 100.0
"""No vehicle turns faster [rad/s]: a set-point that asks for more is not believed."""
LEAP_S = 60.0
"""A log time further than this from the one before is believed only if the next one agrees [s]."""


class SentSetPoint(NamedTuple):
    """One set-point of a ground station: SET_ATTITUDE_TARGET with thrust and body rates alone."""

    time_s: float
    """When it was logged, since the recording began [s]."""
    signal: float
    """Thrust as it was on the wire [0..1]."""
    rates: Vec3
    """Body rates [rad/s, FRD]."""


class RecordedPose(NamedTuple):
    """One pose, and whether the autopilot then said that it may be flying: armed, and not on the ground."""

    pose: Pose
    """``arrival_s`` and ``time_s`` count from the beginning of the recording [s]."""
    may_fly: bool


class RecordedVehicle(NamedTuple):
    """One vehicle's part of a .tlog."""

    autopilot: str
    """PX4, ArduPilot, or what else its HEARTBEAT says."""
    pose_source: str
    """Names of the messages that the poses come from."""
    poses: list[RecordedPose]
    """In order of arrival."""
    sent: list[SentSetPoint]
    """In order of time."""
    dropped: dict[str, int]
    """Bytes, frames, log times, poses and set-points that were not used, by reason."""


def read_recording(path: Path, latency_s: float, system: int) -> RecordedVehicle:
    """The part of the vehicle ``system``, or of the first one that sends poses where that one sends none.

    ``latency_s`` is the time from the instant of a pose to its earliest arrival in the log [s].

    Raises:
        ConfigError: the file can't be read, or holds no poses; the text says what to do.
    """
    with refuse_io("", "cannot read the recording", str(path)):
        data = path.read_bytes()
    if not data:
        raise ConfigError("", "the recording is empty", str(path))
    reader, leaps = TlogReader(data), Counter[str]()
    records = list(in_order(reader, leaps))
    fault = reader.find_fault() or _find_time_fault(records, leaps)
    if fault:
        raise ConfigError("", fault, str(path))
    vehicles = find_autopilots(records)
    vehicles.sort(key=lambda vehicle: (vehicle.system != system, vehicle))
    for vehicle in vehicles:
        own = [record for record in records if record.sender == vehicle]
        decoder = pose_decoder(own, latency_s)
        if decoder is not None:
            if fault := _find_pace_fault(own):
                raise ConfigError("", fault, str(path))
            recording = _of_vehicle(records, vehicle, decoder)
            if recording.poses:
                beside = Counter(
                    f"poses of {record.sender}"
                    for record in records
                    if record.sender != vehicle
                    and record.sender in vehicles
                    and record.message.get_type() in decoder.messages
                )
                dropped = Counter(recording.dropped) + leaps + reader.dropped + beside
                return recording._replace(dropped=dict(dropped))
    raise ConfigError("", notice("tlog.no_poses", found=describe_senders(records)), str(path))


def _find_time_fault(records: Sequence[TlogRecord], dropped: Counter[str]) -> str:
    """Return why the log times tell no flight; empty where they do."""
    if not records:
        return notice("tlog.no_message").text
    leaps = dropped["log_time"]
    if leaps > len(records):
        return notice("tlog.times", leaps=leaps, records=leaps + len(records), limit_s=LEAP_S).text
    if len(records) > 1 and records[-1].time_s == records[0].time_s:
        return notice("tlog.one_time", records=len(records)).text
    return ""


MOST_PACE = 200.0
"""An autopilot's clock that runs this much faster or slower than the log's is that of a log in another unit [-]:
simulators fly up to 100 times as fast as life, and the next unit is 1000 times as long."""


def _find_pace_fault(own: Sequence[TlogRecord]) -> str:
    """Return why the log times do not fit the stamps of one autopilot's messages; empty where they do."""
    messages = [(one.time_s, one.message) for one in own]
    stamped = [
        (time_s, 1e-3 * message.time_boot_ms) for time_s, message in messages if hasattr(message, "time_boot_ms")
    ]
    if not stamped:
        stamped = [(time_s, 1e-6 * message.time_usec) for time_s, message in messages if hasattr(message, "time_usec")]
    if not stamped:
        return ""
    (begun_s, first_s), (ended_s, last_s) = stamped[0], stamped[-1]
    by_log_s, by_stamps_s = ended_s - begun_s, last_s - first_s
    if by_stamps_s <= 0.0 or 1.0 / MOST_PACE < by_log_s / by_stamps_s < MOST_PACE:
        return ""
    return notice("tlog.pace", by_log_s=by_log_s, by_stamps_s=by_stamps_s, limit=MOST_PACE).text


def in_order(records: Iterable[TlogRecord], dropped: Counter[str]) -> Iterator[TlogRecord]:
    """``records`` with time counted from the first and never running back, those with a damaged time left out.

    A log time has no checksum. One far from its neighbours is dropped and counted as ``log_time``; where the
    next agrees with it, the log's clock was set, and time goes on without the leap.
    """
    origin_s: float | None = None
    last_s = 0.0
    odd_s: float | None = None
    for record in records:
        if origin_s is None:
            origin_s = record.time_s
        step_s = record.time_s - origin_s - last_s
        if not -JITTER_S <= step_s <= LEAP_S:
            if odd_s is None or not -JITTER_S <= record.time_s - odd_s <= LEAP_S:
                odd_s = record.time_s
                dropped["log_time"] += 1
                continue
            origin_s += step_s
            step_s = 0.0
        odd_s = None
        last_s += max(step_s, 0.0)
        yield TlogRecord(last_s, record.message)


def _of_vehicle(records: list[TlogRecord], vehicle: Sender, decoder: PoseDecoder) -> RecordedVehicle:
    poses: list[RecordedPose] = []
    sent: list[SentSetPoint] = []
    others: Counter[str] = Counter()
    autopilot = "unknown autopilot"
    asked = armed = told = on_ground = False
    for record in records:
        time_s, message = record
        name = message.get_type()
        if record.sender != vehicle:
            if not vehicle.is_addressed(message):
                continue
            if name == "COMMAND_LONG" and message.command == MavCommand.ARM_DISARM:
                asked = message.param1 == 1.0
            elif name == "SET_ATTITUDE_TARGET":
                if _is_rates_and_thrust(message):
                    rates = (message.body_roll_rate, message.body_pitch_rate, message.body_yaw_rate)
                    sent.append(SentSetPoint(time_s, message.thrust, rates))
                else:
                    others["other_set_point"] += 1
        elif name == "HEARTBEAT" and is_autopilot(message):
            autopilot = AUTOPILOTS.get(message.autopilot, f"autopilot of type {message.autopilot}")
            armed, told = bool(message.base_mode & ARMED), True
        elif name == "COMMAND_ACK" and message.command == MavCommand.ARM_DISARM and message.result == 0:
            armed, told = asked, True
        elif name == "EXTENDED_SYS_STATE":
            on_ground = message.landed_state == ON_GROUND
        elif name in decoder.messages and (pose := decoder.decode(message, time_s)) is not None:
            poses.append(RecordedPose(pose, (armed or not told) and not on_ground))
    return RecordedVehicle(
        autopilot, " and ".join(decoder.messages), poses, sent, dict(others + decoder.intake.dropped)
    )


def _is_rates_and_thrust(message: Message) -> bool:
    numbers = (message.thrust, message.body_roll_rate, message.body_pitch_rate, message.body_yaw_rate)
    # Where the attitude is not left out, it wins over the rates.
    parts = message.type_mask & AttitudeTargetMask.IGNORE_EVERYTHING
    return parts == AttitudeTargetMask.IGNORE_ATTITUDE and all(
        abs(number) <= FASTEST_RAD_S for number in numbers
    )  # no NaN either


NOMINAL_KG = 1.0
"""Mass of a vehicle that nobody described [kg]. Motion only shows thrust over mass, so any will do."""
NOMINAL_LAG_S = 0.05
"""Its lags of thrust and of rates [s]: with these PX4's and ArduPilot's simulated vehicles were flown well."""
NOMINAL_HOVER = 0.5
"""Its hover thrust, where the recording does not show it either."""
NOMINAL_PERIOD_S = 0.01
"""Time between its set-points, where there are none [s]."""
NOMINAL_LATENCY_S = 0.01
"""Assumed latency of poses in the log [s], where the configuration is of another source."""


def complete_config(
    config: Config, path: Path | None, overrides: Sequence[str], recording: RecordedVehicle, hover: float | None
) -> Config:
    """``config`` with what the recording shows of its vehicle; a configuration file is taken as it is.

    ``hover`` is the share of full thrust that carries the vehicle: full thrust is then m g / hover. What
    ``overrides`` say comes last, as always.
    """
    if path is not None:
        return config
    times_s = np.array([sent.time_s for sent in recording.sent])
    period_s = float(np.median(np.diff(times_s))) if len(times_s) > 1 else 0.0
    vehicle: dict[str, Any] = {
        "name": "recorded",
        "mass_kg": config.vehicle.mass_kg,
        "thrust_max_n": config.vehicle.mass_kg * config.controller.gravity / (hover or NOMINAL_HOVER),
        "thrust_lag_s": NOMINAL_LAG_S,
        "rate_lag_s": NOMINAL_LAG_S,
        "frame_period_s": period_s or NOMINAL_PERIOD_S,
    }
    return from_dict({"vehicle": vehicle}, Config, overrides)


Array = npt.NDArray[np.float64]

HALF_WIDTH_S = 0.4
"""Poses this near take part in the fit [s]; weights fall to zero there, so that nothing jumps."""
ORDER = 4
"""Degree of the polynomial over positions: one above the jerk. Over velocities one less gives the same motion."""
FEWEST = 2 * (ORDER + 1)
"""Without this many poses around it an instant has no reference; without as many velocities it takes positions."""
UNKNOWN: Vec3 = (math.nan, math.nan, math.nan)


class FlownPath:
    """Position, velocity and heading of one vehicle over time."""

    def __init__(self, poses: list[Pose], longest_gap_s: float) -> None:
        """Take poses in order of time; the path breaks at a gap longer than ``longest_gap_s`` [s] and at a reset."""
        self._time: Array = np.array([pose.time_s for pose in poses], np.float64)
        yaw = np.unwrap([so3.euler_zyx(pose.attitude)[2] for pose in poses])
        self._places: Array = np.column_stack([np.array([pose.position_ned for pose in poses], np.float64), yaw])
        self._velocities: Array = np.array([pose.velocity_ned or UNKNOWN for pose in poses], np.float64)
        resets = np.array([pose.reset_count for pose in poses])
        starts = np.flatnonzero((np.diff(self._time) > longest_gap_s) | (np.diff(resets) != 0)) + 1
        self._starts = [0, *starts.tolist(), len(poses)]

    def at(self, time_s: float) -> Reference | None:
        """The path at ``time_s`` [s], with derivatives to the jerk; None where too few poses are around it."""
        around = self._around(time_s)
        if around is None:
            return None
        time, velocities = self._time[around] - time_s, self._velocities[around]
        place, rate, *rest = _fit_polynomial(time, self._places[around], ORDER)
        motion = [rate[:3], *(derivative[:3] for derivative in rest)]
        known = np.isfinite(velocities[:, 0])
        # At the first pose with a velocity half of the window has one: from there on they do.
        if FEWEST <= np.count_nonzero(known) >= 0.5 * len(known):
            motion = _fit_polynomial(time[known], velocities[known], ORDER - 1)
        (x0, y0, z0, yaw), yaw_rate = place, rate[3]
        (x1, y1, z1), (x2, y2, z2), (x3, y3, z3) = motion[:3]
        return Reference((x0, y0, z0), (x1, y1, z1), (x2, y2, z2), (x3, y3, z3), yaw, yaw_rate)

    def velocity_of_positions(self, time_s: float) -> Vec3 | None:
        """Velocity of the recorded positions at ``time_s`` [m/s], by the positions alone; None as in ``at``."""
        around = self._around(time_s)
        if around is None:
            return None
        x, y, z, _ = _fit_polynomial(self._time[around] - time_s, self._places[around], ORDER)[1]
        return (x, y, z)

    def _around(self, time_s: float) -> slice | None:
        """The poses within the half width of ``time_s``, of the same piece; None where they are too few."""
        after = int(np.searchsorted(self._time, time_s, "right"))
        piece = int(np.searchsorted(self._starts, after - 1, "right"))
        if not 0 < piece < len(self._starts):
            return None
        first, end = self._starts[piece - 1], self._starts[piece]
        low = max(first, int(np.searchsorted(self._time, time_s - HALF_WIDTH_S, "right")))
        high = min(end, int(np.searchsorted(self._time, time_s + HALF_WIDTH_S, "left")))
        return None if high - low < FEWEST or time_s > self._time[end - 1] else slice(low, high)


def _fit_polynomial(time_s: Array, values: Array, order: int) -> list[list[float]]:
    """Value and derivatives at time 0 of the polynomial of degree ``order`` through ``values`` (N, K)."""
    x = time_s / HALF_WIDTH_S
    root_weight = (1.0 - np.abs(x) ** 3) ** 1.5
    design = np.vander(x, order + 1, increasing=True) * root_weight[:, None]
    origin = values[0]  # small numbers, whatever the lab's origin
    fit = np.linalg.lstsq(design, (values - origin) * root_weight[:, None], rcond=None)[0]
    fit[0] += origin
    return [(math.factorial(k) / HALF_WIDTH_S**k * fit[k]).tolist() for k in range(order + 1)]


CARRIES = 0.85
"""A vehicle in the air carries its weight: over one second the mean thrust is at least this share of hover.

At less it would gain 1.5 m/s downwards in that second; one that stands on the ground is at far less. The autopilot's
own landed_state does not do alone: PX4 calls a vehicle flying until seconds after it stands.
"""
MEAN_S = 1.0
"""That second [s]."""
STEADY_M_S = 0.5
"""Largest vertical speed at which hover thrust is read [m/s]."""
STEADY_M_S2 = 1.0
"""Largest vertical acceleration at which hover thrust is read [m/s²]."""
STEADY_COS_TILT = 0.99
"""Least cosine of the tilt at which hover thrust is read [-], 8 deg: some autopilots add thrust of their own when
tilted."""
LEAST_SHARE = 0.05
"""Below this share of full thrust no vehicle flies."""
FEWEST_SET_POINTS = 25
"""Least number of set-points for the hover thrust [-]."""

Flags = npt.NDArray[np.bool_]


def thrust_shares(sent: list[SentSetPoint], curve: float) -> list[float]:
    """Thrust as a share 0..1 of full thrust, for each set-point; ``curve``: see links/core/deadman.py."""
    return [thrust(min(max(each.signal, 0.0), 1.0), curve) for each in sent]


def flying(recording: RecordedVehicle, shares: list[float], hover: float | None) -> Flags:
    """For each pose (N,), whether the vehicle was in the air on set-points.

    ``hover`` is the share of full thrust that carries it; without it, what the autopilot says must do.
    """
    may_fly: Flags = np.array([seen.may_fly for seen in recording.poses])
    if hover is None:
        return may_fly
    sent_at, arrival = _times(recording)
    first = np.searchsorted(sent_at, arrival - 0.5 * MEAN_S)
    end = np.searchsorted(sent_at, arrival + 0.5 * MEAN_S)
    total = np.concatenate(([0.0], np.cumsum(shares)))
    mean = (total[end] - total[first]) / np.maximum(end - first, 1)
    carried: Flags = may_fly & (mean >= CARRIES * hover)
    return carried


def hover_share(recording: RecordedVehicle, shares: list[float], path: FlownPath, gravity: float) -> float | None:
    """Share 0..1 of full thrust that carries the weight: the median over steady flight; None without any.

    At each set-point, T/T_max cos(tilt) g = hover (g - z¨). The lag is left out: in steady flight thrust hardly
    changes. The first value tells what was on the ground, the second leaves that out.
    """
    sent_at, arrival = _times(recording)
    newest = np.searchsorted(arrival, sent_at, "right") - 1
    value = np.full(len(shares), np.nan)
    for i, share in enumerate(shares):
        if newest[i] >= 0 and share > LEAST_SHARE and recording.poses[newest[i]].may_fly:
            value[i] = _hover_at(recording, newest[i], share, path, gravity)
    estimate: float | None = None
    for _ in range(2):
        used = value[flying(recording, shares, estimate)[newest] & np.isfinite(value)]
        if len(used) < FEWEST_SET_POINTS:
            return None
        estimate = float(np.median(used))
    return estimate


def _times(recording: RecordedVehicle) -> tuple[Array, Array]:
    """When set-points were sent (M,) and when poses arrived (N,) [s]."""
    sent_at = np.array([each.time_s for each in recording.sent], np.float64)
    return sent_at, np.array([seen.pose.arrival_s for seen in recording.poses], np.float64)


def _hover_at(recording: RecordedVehicle, index: int, share: float, path: FlownPath, gravity: float) -> float:
    pose = recording.poses[index].pose
    reference = path.at(pose.time_s)
    if reference is None:
        return np.nan
    speed, acceleration = reference.velocity_ned[2], reference.acceleration_ned[2]
    cos_tilt = third_column(pose.attitude)[2]
    if abs(speed) > STEADY_M_S or abs(acceleration) > STEADY_M_S2 or cos_tilt < STEADY_COS_TILT:
        return np.nan
    return share * cos_tilt * gravity / (gravity - acceleration)


class ShadowedPose(NamedTuple):
    """Estimate of the shadow at one pose."""

    pose: Pose
    velocity_ned: Vec3
    """Estimated velocity at the pose's instant, after its correction [m/s]."""
    innovation_m: float
    """Distance from where the model expected the pose."""
    flying: bool


class ShadowedCommand(NamedTuple):
    """One set-point that was sent, and what the shadow would have sent."""

    sent: ActuatorCommand
    shadow: ActuatorCommand
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
        self._estimator.update(pose)
        return self._estimate(pose.time_s).motion.velocity, innovation

    def compare_command(self, time_s: float, drive: ActuatorCommand, *, flying: bool) -> ShadowedCommand | None:
        """``drive`` was sent at ``time_s`` [s]; in flight, what the shadow would have sent, where there is a path."""
        acting = time_s + self._vehicle.acting_delay_s
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
        self._estimator.add_command(time_s + self._vehicle.command_delay_s, drive)
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
    """Run the shadow over ``recording``; ``hover``: see :func:`hover_share`."""
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
            drive = ActuatorCommand(full_thrust_n * shares[index], recording.sent[index].rates)
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
"""An interval this many times the usual one is a gap [-]: no speed is taken across it."""


class PoseGaps(msgspec.Struct, frozen=True):
    """Intervals between the arrivals of two poses, in flight (in the whole recording where nothing flies)."""

    count: int
    """Number of gaps longer than three times the usual one [-]."""
    longest_s: float
    """[s]"""
    limit_s: float
    """Largest age of a pose for commands (flight.coast_s) [s]."""


class PoseReset(msgspec.Struct, frozen=True):
    """The source moved its origin or its attitude in flight."""

    time_s: float
    """Since the recording began [s]."""
    moved_m: float
    """Distance of the next pose from the prediction [m]."""
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
    """Everything measured: what ``--json`` prints but for the verdict. None: the recording does not tell."""

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
    """Hover thrust by the configuration: m g / thrust_max [-]."""
    velocity_rms_m_s: float | None
    """Estimated velocity against the autopilot's own, in flight: length of the difference [m/s]."""
    velocity_max_m_s: float | None
    velocity_path_rms_m_s: float | None
    """Estimated velocity against how fast the recorded positions move, in flight: as above [m/s]."""
    own_velocity_path_rms_m_s: float | None
    """The autopilot's own velocity against the same: how far its velocity and its positions disagree [m/s]."""
    innovation_rms_m: float | None
    """RMS of the innovation in flight [m]."""
    commands: ComparedCommands | None


def measure_facts(
    file: str,
    recording: RecordedVehicle,
    replayed: ShadowedFlight,
    path: FlownPath,
    config: Config,
    hover: float | None,
) -> ShadowFacts:
    """The numbers of one replay with ``config``; ``hover``: see :func:`hover_share`."""
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
            PoseReset(b.pose.time_s, b.innovation_m, math.hypot(*so3.turn_between(a.pose.attitude, b.pose.attitude)))
            for a, b in resets
            if b.flying
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
        commands=compare_commands(replayed.compared),
    )


def _lengths(vectors: Array) -> Array:
    """Lengths (M,) of those of the vectors (N, 3) that are known."""
    lengths: Array = np.linalg.norm(vectors, axis=1)
    return lengths[np.isfinite(lengths)]


def _rms(values: Array) -> float | None:
    return float(np.sqrt(np.mean(values * values))) if len(values) else None


def compare_commands(compared: Sequence[ShadowedCommand]) -> ComparedCommands | None:
    """The shadow's commands beside those that were sent; None where there are none."""
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


RATE_HZ = 30.0
"""Fewer poses a second than this are not enough for the observer and its prediction."""
VELOCITY_M_S = (0.1, 0.3)
"""Velocity error up to which all is fine, and up to which care does. A standing error e moves the vehicle by e / 3
(the law's slope r is 3 1/s): 3 cm and 10 cm."""
WANDER_M_S = (0.1, 0.3)
"""Limits of warning and failure for the disagreement of positions and velocity [m/s]. No filter can tell which of
the two is wrong. If it is the positions, the vehicle follows them: at 0.3 m/s a metre in 3 s, while the screen
shows it in place."""
INNOVATION_M = (0.01, 0.05)
"""Limits of warning and failure for the innovation [m]: one pose may move the vehicle's reference by this much."""
RESET_M = 0.1
"""Shift of a reset in flight beyond which the vehicle jumps [m]."""
RESET_RAD = 0.1
"""Turn of a reset in flight beyond which the vehicle jumps [rad]."""
BAD_STAMPS = 0.01
"""Share of poses with a stamp that is not newer, above which the source is at fault [-]."""
SATURATED = (0.01, 0.1)
"""Share of commands at a limit: a take-off may touch it. A flown path hardly needs it, so more is the fault of the
configuration or of the estimate, and beyond its limits the law proves nothing."""
HOVER = 0.1
"""The configuration's hover thrust may differ from the flown one by this share."""

Level = Literal["fine", "care", "bad"]
VERDICTS: dict[Level, str] = {"fine": "fit", "care": "fit with care", "bad": "not fit"}


class ShadowCheck(msgspec.Struct, frozen=True):
    """One thing that was looked at."""

    about: str
    """Subject: rate, gaps, stamps, resets, velocity, wander, innovation, commands, hover or flight."""
    level: Level
    text: str
    """Finding with numbers, and its meaning."""


def checks(facts: ShadowFacts) -> list[ShadowCheck]:
    """Everything that can be said about a replay."""
    return [*_stream(facts), *_flight(facts)]


def verdict(checks_: list[ShadowCheck]) -> str:
    """``fit``, ``fit with care`` or ``not fit``: as the worst of the checks."""
    levels = {check.level for check in checks_}
    worst: Level = "bad" if "bad" in levels else "care" if "care" in levels else "fine"
    return VERDICTS[worst]


def _stream(facts: ShadowFacts) -> Iterator[ShadowCheck]:
    rate, gaps = facts.rate_hz or 0.0, facts.gaps
    yield ShadowCheck(
        "rate",
        "fine" if rate >= RATE_HZ else "bad",
        f"{rate:.1f} poses a second; at least {RATE_HZ:.0f} are needed",
    )
    yield ShadowCheck(
        "gaps",
        "bad" if gaps.longest_s >= gaps.limit_s else "care" if gaps.longest_s >= 0.5 * gaps.limit_s else "fine",
        f"the longest time without a pose is {gaps.longest_s:.3f} s; "
        f"after {gaps.limit_s:.2f} s commands stop (flight.coast_s)",
    )
    old = sum(facts.dropped.get(reason, 0) for reason in ("duplicate", "same_stamp", "out_of_order", "not_newer"))
    yield ShadowCheck(
        "stamps",
        "bad" if old > BAD_STAMPS * facts.poses else "care" if old else "fine",
        f"{old} of {facts.poses + old} poses carry a stamp that is not newer than the one before",
    )
    for reset in facts.resets_in_flight:
        yield ShadowCheck(
            "resets",
            "bad" if reset.moved_m > RESET_M or reset.turned_rad > RESET_RAD else "care",
            f"at {reset.time_s:.1f} s, in flight, the source reset its estimate, "
            f"by {1e3 * reset.moved_m:.0f} mm and {57.3 * reset.turned_rad:.1f} deg",
        )


def _flight(facts: ShadowFacts) -> Iterator[ShadowCheck]:
    if not facts.flights:
        yield ShadowCheck(
            "flight", "care", "the recording holds no flight on set-points: only the stream could be judged"
        )
        return
    if facts.hover_thrust is None:
        yield ShadowCheck(
            "hover",
            "care",
            "no steady flight on SET_ATTITUDE_TARGET (thrust and rates): the estimator could not know the thrust",
        )
    else:
        off = abs(facts.hover_configured / facts.hover_thrust - 1.0)
        yield ShadowCheck(
            "hover",
            "fine" if off <= HOVER else "care",
            f"{facts.hover_thrust:.3f} of full thrust carries the vehicle"
            + (f"; its configuration says {facts.hover_configured:.3f}" if off > 1e-3 else ""),
        )
    yield from _velocity(facts)
    innovation = facts.innovation_rms_m or 0.0
    yield ShadowCheck(
        "innovation",
        _level(innovation, INNOVATION_M),
        f"poses are {1e3 * innovation:.1f} mm RMS from where the model expects them",
    )
    if facts.commands is not None:
        share = facts.commands.saturated_fraction
        yield ShadowCheck(
            "commands",
            _level(share, SATURATED),
            f"{100.0 * share:.1f} % of the commands along the flown path would be at a limit",
        )


def _velocity(facts: ShadowFacts) -> Iterator[ShadowCheck]:
    own, path, source = facts.velocity_rms_m_s, facts.velocity_path_rms_m_s, facts.own_velocity_path_rms_m_s
    if own is not None:
        text = f"the estimated velocity is {own:.3f} m/s RMS from the autopilot's own"
        yield ShadowCheck("velocity", _level(own, VELOCITY_M_S), text)
    elif path is not None:
        text = (
            f"the estimated velocity is {path:.3f} m/s RMS from that of the recorded positions; the source sends none"
        )
        yield ShadowCheck("velocity", _level(path, VELOCITY_M_S), text)
    if source is not None:
        level = _level(source, WANDER_M_S)
        text = f"positions and velocity of the autopilot disagree by {source:.3f} m/s RMS between themselves"
        if level != "fine":
            text += ": the vehicle may wander in the room that fast, although it looks good on screen; keep clear of it"
        yield ShadowCheck("wander", level, text)


def _level(value: float, limits: tuple[float, float]) -> Level:
    return "fine" if value <= limits[0] else "care" if value <= limits[1] else "bad"


class ShadowReport(ShadowFacts, frozen=True, kw_only=True):
    """A replay in numbers, and what to make of them: the object that ``--json`` prints."""

    verdict: str
    """``fit``, ``fit with care`` or ``not fit`` to fly on."""
    reasons: list[str]
    """The sentences that the verdict rests on: every one that is not fine, or all where all are."""
    checks: list[ShadowCheck]
    """Everything that was looked at."""


class OpenedRecording(NamedTuple):
    """A recording, and what is needed to fly its poses."""

    config: Config
    """With what the recording shows of its vehicle."""
    recording: RecordedVehicle
    path: FlownPath
    shares: list[float]
    """Thrust of each set-point as a share of the full one."""
    hover: float | None
    """Share of full thrust that carries the vehicle."""


def open_recording(file: Path, config_path: Path | None, overrides: Sequence[str]) -> OpenedRecording:
    """Read ``file``, and complete its configuration.

    Raises:
        ConfigError: the configuration is bad, or the file can't be read or holds no poses.
    """
    nobodys = {"vehicle": {"mass_kg": NOMINAL_KG}}
    config = from_dict(nobodys, Config, overrides) if config_path is None else load(config_path, Config, overrides)
    if not isinstance(config.link, MavlinkLinkConfig):
        raise ConfigError("link.kind", "a recording holds MAVLink: expected 'mavlink'")
    pose = config.pose
    late_s = pose.latency_s if isinstance(pose, MavlinkPoseConfig) else NOMINAL_LATENCY_S
    recording = read_recording(file, late_s, config.link.target_system)
    path = FlownPath([seen.pose for seen in recording.poses], config.flight.coast_s)
    shares = thrust_shares(recording.sent, config.thrust_curve)
    hover = hover_share(recording, shares, path, config.controller.gravity)
    config = complete_config(config, config_path, overrides, recording, hover)
    return OpenedRecording(config, recording, path, shares, hover)


def report(file: Path, config_path: Path | None = None, overrides: Sequence[str] = ()) -> ShadowReport:
    """Replay ``file``. The same file and configuration give the same report, to the last bit.

    Raises:
        ConfigError: the configuration is bad, or the file can't be read or holds no poses.
    """
    config, recording, path, _, hover = open_recording(file, config_path, overrides)
    facts = measure_facts(str(file), recording, replay(recording, config, path, hover), path, config, hover)
    looked_at = checks(facts)
    result = verdict(looked_at)
    return ShadowReport(
        **{name: getattr(facts, name) for name in ShadowFacts.__struct_fields__},
        verdict=result,
        reasons=[check.text for check in looked_at if result == "fit" or check.level != "fine"],
        checks=looked_at,
    )


def text_of(result: ShadowReport) -> str:
    """The report as lines of at most 120 characters, but for long sentences."""
    return "\n".join(_lines(result))


def _lines(result: ShadowReport) -> Iterator[str]:
    gaps = result.gaps
    dropped = ", ".join(f"{count} {reason}" for reason, count in sorted(result.dropped.items()))
    yield f"{result.file}: {result.autopilot}, poses from {result.pose_source}"
    yield ""
    yield _row("poses", f"{result.poses}" + (f" (not used: {dropped})" if dropped else ""))
    yield _row("flights", f"{result.flights}, {result.flight_s:.1f} s in the air on set-points")
    yield _row("pose rate", f"{_number(result.rate_hz, 1)} Hz{' in flight' if result.flights else ''}")
    yield _row("gaps", f"{gaps.count}, longest time without a pose {1e3 * gaps.longest_s:.0f} ms")
    yield _row("resets", f"{result.resets}, {len(result.resets_in_flight)} of them in flight")
    yield _row("hover thrust", f"{_number(result.hover_thrust, 3)} of full thrust")
    yield _row(
        "estimated velocity",
        f"{_number(result.velocity_rms_m_s, 3)} m/s RMS, {_number(result.velocity_max_m_s, 3)} at most, "
        "from the autopilot's own",
    )
    yield _row(
        "against positions",
        f"{_number(result.velocity_path_rms_m_s, 3)} m/s RMS ours, "
        f"{_number(result.own_velocity_path_rms_m_s, 3)} the autopilot's own",
    )
    yield _row("innovation", f"{_number(result.innovation_rms_m, 4)} m RMS")
    yield ""
    if result.commands is not None:
        yield from _commands(result.commands)
        yield ""
    yield f"{result.verdict.upper()} TO FLY ON"
    for check in result.checks:
        yield f"  {check.level:5} {check.text}"


def _commands(commands: ComparedCommands) -> Iterator[str]:
    yield f"commands along the flown path, {commands.compared} compared"
    yield f"{'':14}{'mean':>18}{'deviation':>20}{'difference':>14}{'correlation':>13}"
    yield f"{'':14}{'sent':>9}{'shadow':>9}{'sent':>11}{'shadow':>9}{'RMS':>14}"
    for name, pair in (
        ("thrust N", commands.thrust_n),
        ("roll rad/s", commands.roll_rate_rad_s),
        ("pitch rad/s", commands.pitch_rate_rad_s),
        ("yaw rad/s", commands.yaw_rate_rad_s),
    ):
        yield (
            f"  {name:12}{pair.sent_mean:>9.3f}{pair.shadow_mean:>9.3f}{pair.sent_std:>11.3f}{pair.shadow_std:>9.3f}"
            f"{pair.difference_rms:>14.3f}{_number(pair.correlation, 2):>13}"
        )


def _row(label: str, text: str) -> str:
    return f"{label:24}{text}"


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def shadow_command(file: Path, config: Path | None, overrides: list[str], *, as_json: bool) -> Exit:
    """Replay ``file`` (a .tlog), print a report (or one JSON object), and return 0 whatever the verdict.

    Without ``config`` the vehicle is as the recording shows it.

    Raises:
        ConfigError: the configuration is bad, or the file can't be read or holds no poses.
    """
    result = report(file, config, overrides)
    print(msgspec.json.encode(result).decode() if as_json else text_of(result))
    return Exit.DONE
