"""Recorded vehicle: what a .tlog says of its poses, its set-points and when it may have been flying.

And the configuration with which that is replayed.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from groundstation.config import ConfigError, from_dict, load
from groundstation.core.geometry import Vec3
from groundstation.core.messages import Pose
from groundstation.pose import TlogConfig, TlogReader, TlogRecord, pose_decoder
from groundstation.pose.sources import MavlinkPoseConfig, PoseDecoder
from groundstation.settings import Config
from links.mavlink import MavlinkLinkConfig
from links.mavlink.protocol import ARDUPILOT, ARM_DISARM, ARMED, GROUND_STATION, PX4, Message

AUTOPILOTS = {PX4: "PX4", ARDUPILOT: "ArduPilot"}
"""What to call them, by HEARTBEAT.autopilot."""
ON_GROUND = 1
"""EXTENDED_SYS_STATE.landed_state (MAV_LANDED_STATE_ON_GROUND)."""
IGNORED_PARTS = 1 | 2 | 4 | 64
"""Bits of SET_ATTITUDE_TARGET.type_mask that leave out a body rate or the thrust."""
IGNORED_ATTITUDE = 128
"""The bit that leaves out the attitude; without it the attitude wins over the rates."""
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
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ConfigError("", f"cannot read the recording: {error.strerror}", str(path)) from None
    if not data:
        raise ConfigError("", "the recording is empty", str(path))
    reader, leaps = TlogReader(data), Counter[str]()
    records = list(in_order(reader, leaps))
    if not records:
        raise ConfigError("", "no MAVLink message in it: is it a .tlog?", str(path))
    for vehicle in (system, *sorted({record.message.get_srcSystem() for record in records})):
        own = [record for record in records if record.message.get_srcSystem() == vehicle]
        decoder = pose_decoder(own, latency_s)
        if decoder is not None:
            recording = _of_vehicle(records, vehicle, decoder)
            if recording.poses:
                dropped = Counter(recording.dropped) + leaps + reader.dropped
                return recording._replace(dropped=dict(dropped))
    raise ConfigError("", "no poses in it: record ODOMETRY, or LOCAL_POSITION_NED and ATTITUDE_QUATERNION", str(path))


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


def _of_vehicle(records: list[TlogRecord], system: int, decoder: PoseDecoder) -> RecordedVehicle:
    poses: list[RecordedPose] = []
    sent: list[SentSetPoint] = []
    others: Counter[str] = Counter()
    autopilot = "unknown autopilot"
    asked = armed = told = on_ground = False
    for time_s, message in records:
        name = message.get_type()
        if message.get_srcSystem() != system:
            if getattr(message, "target_system", None) not in (system, 0):
                continue
            if name == "COMMAND_LONG" and message.command == ARM_DISARM:
                asked = message.param1 == 1.0
            elif name == "SET_ATTITUDE_TARGET":
                if _is_rates_and_thrust(message):
                    rates = (message.body_roll_rate, message.body_pitch_rate, message.body_yaw_rate)
                    sent.append(SentSetPoint(time_s, message.thrust, rates))
                else:
                    others["other_set_point"] += 1
        elif name == "HEARTBEAT" and message.type != GROUND_STATION:
            autopilot = AUTOPILOTS.get(message.autopilot, f"autopilot of type {message.autopilot}")
            armed, told = bool(message.base_mode & ARMED), True
        elif name == "COMMAND_ACK" and message.command == ARM_DISARM and message.result == 0:
            armed, told = asked, True
        elif name == "EXTENDED_SYS_STATE":
            on_ground = message.landed_state == ON_GROUND
        elif name in decoder.messages and (pose := decoder.decode(message, time_s)) is not None:
            poses.append(RecordedPose(pose, (armed or not told) and not on_ground))
    return RecordedVehicle(autopilot, " and ".join(decoder.messages), poses, sent, dict(others + decoder.dropped))


def _is_rates_and_thrust(message: Message) -> bool:
    numbers = (message.thrust, message.body_roll_rate, message.body_pitch_rate, message.body_yaw_rate)
    parts = message.type_mask & (IGNORED_PARTS | IGNORED_ATTITUDE)
    return parts == IGNORED_ATTITUDE and all(abs(number) <= FASTEST_RAD_S for number in numbers)  # no NaN either


NOMINAL_KG = 1.0
"""Mass of a vehicle that nobody described [kg]. Motion only shows thrust over mass, so any will do."""
NOMINAL_LAG_S = 0.05
"""Its lags of thrust and of rates [s]: with these PX4's and ArduPilot's simulated vehicles were flown well."""
NOMINAL_HOVER = 0.5
"""Its hover thrust, where the recording does not show it either."""
NOMINAL_PERIOD_S = 0.01
"""Time between its set-points, where there are none [s]."""
NOMINAL_LATENCY_S = 0.01
"""From the instant of a pose to its earliest arrival in the log [s], where the configuration is of another source."""


def load_described(path: Path | None, overrides: Sequence[str]) -> Config:
    """The configuration as the operator gave it, before the recording is read.

    Raises:
        ConfigError: see :func:`groundstation.config.loader.load`.
    """
    if path is not None:
        return load(path, Config, overrides)
    return from_dict({"vehicle": {"mass_kg": NOMINAL_KG}}, Config, overrides)


def latency_s(config: Config) -> float:
    """Time from the instant of a pose to its earliest arrival [s]."""
    pose = config.pose
    return pose.latency_s if isinstance(pose, MavlinkPoseConfig | TlogConfig) else NOMINAL_LATENCY_S


def mavlink(config: Config) -> MavlinkLinkConfig:
    """The link of the recording.

    Raises:
        ConfigError: the configuration has another one.
    """
    if not isinstance(config.link, MavlinkLinkConfig):
        raise ConfigError("link.kind", "a recording holds MAVLink: expected 'mavlink'")
    return config.link


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
