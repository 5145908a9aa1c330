"""MAVLink .tlog as an imported flight: the poses of one autopilot, and the set-points that were
sent to it.

A sender is a system and a component: a companion or a bridge may have the vehicle's system id.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from groundstation.analysis.evidence.flight import (
    FASTEST_RAD_S,
    SETPOINT,
    STATE,
    ImportedFlight,
    ImportedSetpoint,
    ImportedState,
)
from groundstation.config import ConfigError, refuse_io
from groundstation.core.messages import notice
from groundstation.pose import (
    Sender,
    TlogReader,
    TlogRecord,
    describe_senders,
    find_autopilots,
    pose_decoder,
)
from groundstation.pose.sources import PoseDecoder
from groundstation.recording import Vector3
from links.mavlink.protocol import (
    ARMED,
    AttitudeTargetMask,
    MavCommand,
    Message,
    is_autopilot,
    load_dialect,
)

LEAP_S = 60.0
"""A log time further than this from the one before is damaged, or its clock was set: that time did
not pass [s]. Time stands still for a message that is logged a little before the one ahead of it."""


def read_tlog(path: Path, latency_s: float) -> ImportedFlight:
    """The flight of the first autopilot that sends poses.

    ``latency_s`` is the time from the instant of a pose to its earliest arrival in the log [s].

    Raises:
        ConfigError: the file can't be read, or holds no poses; the text says what to do.
    """
    with refuse_io("", "file.unread", path):
        data = path.read_bytes()
    if not data:
        raise ConfigError("", notice("file.empty"), str(path))
    reader, leaps = TlogReader(data), Counter[str]()
    records = list(in_order(reader, leaps))
    if fault := reader.find_fault() or _find_time_fault(records, leaps):
        raise ConfigError("", fault, str(path))
    vehicles = sorted(find_autopilots(records))
    for vehicle in vehicles:
        own = [record for record in records if record.sender == vehicle]
        decoder = pose_decoder(own, latency_s)
        if decoder is None:
            continue
        flight = _read_vehicle(records, vehicle, decoder)
        beside = Counter(
            f"poses of {record.sender}"
            for record in records
            if record.sender != vehicle
            and record.sender in vehicles
            and record.message.get_type() in decoder.messages
        )
        flight.notes += decoder.intake.dropped + leaps + reader.dropped + beside
        return flight
    raise ConfigError("", notice("tlog.no_poses", found=describe_senders(records)), str(path))


def _find_time_fault(records: Sequence[TlogRecord], dropped: Counter[str]) -> str:
    """Return why the log times tell no flight; empty where they do."""
    if not records:
        return notice("tlog.no_message").text
    leaps = dropped["log_time"]
    if leaps > 0.5 * len(records):
        return notice("tlog.times", leaps=leaps, records=len(records), limit_s=LEAP_S).text
    if len(records) > 1 and records[-1].time_s == records[0].time_s:
        return notice("tlog.one_time", records=len(records)).text
    return ""


def in_order(records: Iterable[TlogRecord], dropped: Counter[str]) -> Iterator[TlogRecord]:
    """``records`` with time counted from the first and never running back.

    A log time has no checksum: each is the median of it and its neighbours, so that a damaged one
    does not hold up those behind it. A log's clock may be set: time goes on without a leap, which
    is counted as ``log_time``.
    """
    records = list(records)
    times_s = np.array([record.time_s for record in records])
    if len(times_s) >= 3:
        times_s[1:-1] = np.median([times_s[:-2], times_s[1:-1], times_s[2:]], axis=0)
        times_s[0] = min(times_s[0], times_s[1])
    origin_s: float | None = None
    last_s = 0.0
    for record, time_s in zip(records, times_s.tolist(), strict=True):
        if origin_s is None:
            origin_s = time_s
        step_s = time_s - origin_s - last_s
        if abs(step_s) > LEAP_S:
            dropped["log_time"] += 1
            origin_s += step_s
            step_s = 0.0
        last_s += max(step_s, 0.0)
        yield TlogRecord(last_s, record.message)


def _read_vehicle(
    records: Sequence[TlogRecord], vehicle: Sender, decoder: PoseDecoder
) -> ImportedFlight:
    flight, dialect = ImportedFlight(0.0), load_dialect()
    asked = armed = told = on_ground = False
    may_fly: bool | None = None
    newest_s = -np.inf
    for record in records:
        time_s, message = record
        name = message.get_type()
        if record.sender != vehicle:
            if not vehicle.is_addressed(message):
                continue
            if name == "COMMAND_LONG" and message.command == MavCommand.ARM_DISARM:
                asked = message.param1 == 1.0
            elif name == "SET_ATTITUDE_TARGET" and _is_rates_and_thrust(message):
                rates = Vector3(
                    message.body_roll_rate, message.body_pitch_rate, message.body_yaw_rate
                )
                thrust = min(max(message.thrust, 0.0), 1.0)
                flight.messages.append((time_s, SETPOINT, ImportedSetpoint(time_s, thrust, rates)))
            elif name == "SET_ATTITUDE_TARGET":
                flight.notes["other_set_point"] += 1
        elif name == "HEARTBEAT" and is_autopilot(message):
            armed, told = bool(message.base_mode & ARMED), True
        elif (
            name == "COMMAND_ACK"
            and message.command == MavCommand.ARM_DISARM
            and message.result == 0
        ):
            armed, told = asked, True
        elif name == "EXTENDED_SYS_STATE":
            on_ground = message.landed_state == dialect.MAV_LANDED_STATE_ON_GROUND
        elif name in decoder.messages and (pose := decoder.decode(message, time_s)) is not None:
            flies = (armed or not told) and not on_ground
            if flies is not may_fly:
                may_fly = flies
                flight.messages.append((time_s, STATE, ImportedState(time_s, flies)))
            if pose.time_s <= newest_s:
                flight.notes["poses not newer than the one before"] += 1
                continue
            newest_s = pose.time_s
            flight.add_pose(pose, pose.id)
    if not flight.of(SETPOINT):
        flight.missing.append("no SET_ATTITUDE_TARGET with body rates in it: nothing is identified")
    return flight


def _is_rates_and_thrust(message: Message) -> bool:
    numbers = (
        message.thrust,
        message.body_roll_rate,
        message.body_pitch_rate,
        message.body_yaw_rate,
    )
    # Where the attitude is not left out, it wins over the rates.
    parts = message.type_mask & AttitudeTargetMask.IGNORE_EVERYTHING
    # No NaN either.
    return parts == AttitudeTargetMask.IGNORE_ATTITUDE and all(
        abs(number) <= FASTEST_RAD_S for number in numbers
    )
