"""What a .tlog says about one vehicle: its poses, the set-points it was sent, and when it may have been flying."""

from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from groundstation.config import ConfigError
from groundstation.core.geometry import Vec3
from groundstation.core.messages import Pose
from groundstation.pose import TlogReader, TlogRecord, pose_decoder
from groundstation.pose.sources import PoseDecoder
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


class Sent(NamedTuple):
    """One set-point of a ground station: SET_ATTITUDE_TARGET with thrust and body rates alone."""

    time_s: float
    """When it was logged, since the recording began [s]."""
    signal: float
    """Thrust as it was on the wire [0..1]."""
    rates: Vec3
    """Body rates [rad/s, FRD]."""


class Seen(NamedTuple):
    """One pose, and whether the autopilot then said that it may be flying: armed, and not on the ground."""

    pose: Pose
    """``arrival_s`` and ``time_s`` count from the beginning of the recording [s]."""
    may_fly: bool


class Recording(NamedTuple):
    """One vehicle's part of a .tlog."""

    autopilot: str
    """PX4, ArduPilot, or what else its HEARTBEAT says."""
    pose_source: str
    """Names of the messages that the poses come from."""
    poses: list[Seen]
    """In order of arrival."""
    sent: list[Sent]
    """In order of time."""
    dropped: dict[str, int]
    """Bytes, frames, log times, poses and set-points that were not used, by reason."""


def read_recording(path: Path, latency_s: float, system: int) -> Recording:
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


def _of_vehicle(records: list[TlogRecord], system: int, decoder: PoseDecoder) -> Recording:
    poses: list[Seen] = []
    sent: list[Sent] = []
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
                    sent.append(Sent(time_s, message.thrust, rates))
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
            poses.append(Seen(pose, (armed or not told) and not on_ground))
    return Recording(autopilot, " and ".join(decoder.messages), poses, sent, dict(others + decoder.dropped))


def _is_rates_and_thrust(message: Message) -> bool:
    numbers = (message.thrust, message.body_roll_rate, message.body_pitch_rate, message.body_yaw_rate)
    parts = message.type_mask & (IGNORED_PARTS | IGNORED_ATTITUDE)
    return parts == IGNORED_ATTITUDE and all(abs(number) <= FASTEST_RAD_S for number in numbers)  # no NaN either
