"""Import, ``groundstation import FILE… --map MAP --out FLIGHT.mcap``: a flight that others recorded, as a recording.

Poses stand where those of our own flights do (``/measured``); what the vehicle was commanded, the reference and the
truth have channels of their own (``/imported/…``), so that nobody takes them for commands of this program. A recording
of that kind has no configuration. What the file does not hold is said, and stays out.
"""

import json
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from groundstation.analysis.evidence.mapping import (
    UNITS,
    Column,
    FlightMapping,
    MappedCommand,
    MappedMotion,
    MappedTable,
    Table,
    Tables,
    find_table,
    load_mapping,
    read_tables,
)
from groundstation.analysis.shadow import read_recording
from groundstation.config import ConfigError
from groundstation.core.geometry import Frames, Quat, axes, so3
from groundstation.core.messages import Pose
from groundstation.recording import (
    CHANNELS,
    McapWriter,
    MeasuredMessage,
    Quaternion,
    Vector3,
    quaternion,
    schema,
    vector,
)
from groundstation.runtime import __version__, open_private


class ImportedSetpoint(msgspec.Struct, frozen=True, gc=False):
    """What the vehicle was commanded by whoever flew it."""

    time_s: float
    thrust: float
    """Signal of the collective thrust, as a share of the full one [0..1]."""
    rates_rad_s: Vector3 | msgspec.UnsetType = msgspec.UNSET
    """Body rates, FRD."""
    attitude: Quaternion | msgspec.UnsetType = msgspec.UNSET
    """Body FRD to world NED."""


class ImportedMotion(msgspec.Struct, frozen=True, gc=False):
    """Where the vehicle should have been, or truly was."""

    time_s: float
    position_ned: Vector3
    velocity_ned: Vector3 | msgspec.UnsetType = msgspec.UNSET


class ImportedState(msgspec.Struct, frozen=True, gc=False):
    """Whether the autopilot said that it may be flying: armed, and not on the ground."""

    time_s: float
    may_fly: bool


MEASURED, SETPOINT, REFERENCE, TRUTH, STATE = (
    "/measured",
    *(f"/imported/{name}" for name in ("setpoint", "reference", "truth", "state")),
)
IMPORTED: dict[str, tuple[str, type[msgspec.Struct]]] = {
    MEASURED: CHANNELS[MEASURED],
    SETPOINT: ("groundstation.ImportedSetpoint", ImportedSetpoint),
    REFERENCE: ("groundstation.ImportedMotion", ImportedMotion),
    TRUTH: ("groundstation.ImportedMotion", ImportedMotion),
    STATE: ("groundstation.ImportedState", ImportedState),
}
"""Topic → name of its schema, and type of its messages."""
Message = tuple[float, str, msgspec.Struct]


@dataclass
class ImportedFlight:
    """A flight as it will be written."""

    begun_s: float
    """The first pose on the clock of the file [s]: times count from here."""
    messages: list[Message] = field(default_factory=list)
    hover: float | None = None
    """Thrust signal that hovers, where the source tells."""
    missing: list[str] = field(default_factory=list)
    notes: Counter[str] = field(default_factory=Counter)
    """What was not used as it stands, by reason."""

    def count(self, topic: str) -> int:
        """Of messages."""
        return sum(name == topic for _, name, _ in self.messages)


def import_command(paths: Sequence[Path], map_name: str, out: Path) -> int:
    """Do it, say what was found and what is missing, and return 0.

    Raises:
        ConfigError: the mapping or a file can't be read, holds no poses, or ``out`` is there already.
    """
    if out.exists():
        raise ConfigError("--out", f"{out} is there already")
    mapping = load_mapping(map_name)
    flight = read_flight(mapping, paths)
    try:
        write_flight(flight, mapping, map_name, paths, out)
    except OSError as error:
        raise ConfigError("--out", f"cannot write {out}: {error.strerror}") from None
    counts = ", ".join(
        f"{flight.count(topic)} {what}"
        for topic, what in (
            (MEASURED, "poses"),
            (SETPOINT, "commands"),
            (REFERENCE, "of the reference"),
            (TRUTH, "true"),
        )
    )
    print(f"{out}: {counts}")
    for line in flight.missing:
        print(f"missing: {line}")
    for reason, count in sorted(flight.notes.items()):
        print(f"{reason}: {count}")
    return 0


def read_flight(mapping: FlightMapping, paths: Sequence[Path]) -> ImportedFlight:
    """The flight in the files ``paths``.

    Raises:
        ConfigError: a file can't be read, or there are no poses.
    """
    if mapping.format == "tlog":
        return _read_tlog(mapping, paths)
    tables = read_tables(mapping.format, paths)
    reader = _MappingReader(mapping, tables)
    poses = reader.first(mapping.pose, reader.motion)
    if poses is None:
        held = ", ".join(sorted(tables)[:12]) or "nothing"
        raise ConfigError("FILE", f"holds no poses as the mapping has them (found: {held})", str(paths[0]))
    time, place, attitude, velocity, resets = poses
    flight = ImportedFlight(float(time[0]))
    newest = -np.inf
    for k, at in enumerate((time - time[0]).tolist()):
        if at <= newest:
            flight.notes["poses not newer than the one before"] += 1
            continue
        newest = at
        moved = None if velocity is None else _three(velocity[k])
        pose = Pose(0, at, at, _three(place[k]), _four(attitude[k]), moved, int(resets[k]))
        flight.messages.append((at, MEASURED, _measured(pose, k)))
    flight.notes.update(reader.notes)
    _add_commands(flight, reader, mapping)
    for topic, parts, what in ((REFERENCE, mapping.reference, "reference"), (TRUTH, mapping.truth, "truth")):
        found = reader.first(parts, reader.motion)
        if found is None:
            flight.missing.append(f"no {what} in it")
            continue
        time, place, _, velocity, _ = found
        for k, at in enumerate((time - flight.begun_s).tolist()):
            moving = msgspec.UNSET if velocity is None else vector(_three(velocity[k]))
            flight.messages.append((at, topic, ImportedMotion(at, vector(_three(place[k])), moving)))
    return flight


def _add_commands(flight: ImportedFlight, reader: "_MappingReader", mapping: FlightMapping) -> None:
    commands = reader.first(mapping.command, reader.command)
    if commands is None:
        flight.missing.append("no commands in it: nothing is identified, prediction knows no thrust")
        return
    time, signal, rates, attitude, flight.hover = commands
    beyond = int(np.count_nonzero((signal < 0.0) | (signal > 1.0)))
    if beyond:
        flight.notes["thrust beyond 0 or full, cut off there"] += beyond
    if rates is None and attitude is None:
        flight.missing.append("neither body rates nor an attitude were commanded in it: only thrust is known")
    for k, at in enumerate((time - flight.begun_s).tolist()):
        turn = msgspec.UNSET if rates is None else vector(_three(rates[k]))
        lean = msgspec.UNSET if attitude is None else quaternion(_four(attitude[k]))
        thrust = float(np.clip(signal[k], 0.0, 1.0))
        flight.messages.append((at, SETPOINT, ImportedSetpoint(at, thrust, turn, lean)))


def _read_tlog(mapping: FlightMapping, paths: Sequence[Path]) -> ImportedFlight:
    if len(paths) != 1:
        raise ConfigError("FILE", f"expected one .tlog, got {len(paths)} files")
    recorded = read_recording(paths[0], mapping.latency_s, 1)
    flight, may_fly = ImportedFlight(0.0), None
    newest = -np.inf
    for seen in recorded.poses:
        pose = seen.pose
        if seen.may_fly is not may_fly:
            may_fly = seen.may_fly
            flight.messages.append((pose.arrival_s, STATE, ImportedState(pose.arrival_s, may_fly)))
        if pose.time_s <= newest:
            flight.notes["poses not newer than the one before"] += 1
            continue
        newest = pose.time_s
        flight.messages.append((pose.arrival_s, MEASURED, _measured(pose, pose.id)))
    for sent in recorded.sent:
        thrust = float(np.clip(sent.signal, 0.0, 1.0))
        flight.messages.append((sent.time_s, SETPOINT, ImportedSetpoint(sent.time_s, thrust, vector(sent.rates))))
    flight.notes.update(recorded.dropped)
    if not recorded.sent:
        flight.missing.append("no SET_ATTITUDE_TARGET with body rates in it: nothing is identified")
    flight.missing.append("no reference and no truth in it: a .tlog has none")
    return flight


def write_flight(
    flight: ImportedFlight, mapping: FlightMapping, map_name: str, paths: Sequence[Path], out: Path
) -> None:
    """Write it to ``out``.

    Raises:
        OSError: it can't be written.
    """
    about = {
        "version": __version__,
        "imported": map_name,
        "title": mapping.title,
        "source": mapping.source,
        "files": ", ".join(path.name for path in paths),
        "begun_s": repr(flight.begun_s),
        "hover": "" if flight.hover is None else repr(flight.hover),
        "vehicle_told": msgspec.json.encode(mapping.vehicle).decode(),
        "missing": "; ".join(flight.missing),
        "notes": json.dumps(flight.notes),
    }
    stamp_ns = max(0, round(flight.begun_s * 1e9))
    with open(out, "wb", opener=open_private) as file:  # Path.open has no opener
        writer = McapWriter(file, "groundstation import")
        writer.add_metadata("about", about)
        ids = {topic: writer.add_channel(topic, name, schema(name, kind)) for topic, (name, kind) in IMPORTED.items()}
        for at, topic, message in sorted(flight.messages, key=lambda one: one[0]):
            writer.add_message(ids[topic], max(0, stamp_ns + round(at * 1e9)), msgspec.json.encode(message))
        writer.finish()


def _measured(pose: Pose, number: int) -> MeasuredMessage:
    velocity = msgspec.UNSET if pose.velocity_ned is None else vector(pose.velocity_ned)
    at, attitude = vector(pose.position_ned), quaternion(pose.attitude)
    return MeasuredMessage(pose.time_s, pose.arrival_s, number, at, attitude, pose.reset_count, velocity)


def _three(row: Column) -> tuple[float, float, float]:
    x, y, z = row.tolist()
    return x, y, z


def _four(row: Column) -> Quat:
    w, x, y, z = row.tolist()
    return w, x, y, z


Motion = tuple[Column, Column, Column, Column | None, Column]
"""Times (N,) [s], positions (N, 3), attitudes (N, 4), velocities (N, 3) or None, resets (N,)."""
Commands = tuple[Column, Column, Column | None, Column | None, float | None]
"""Times (M,) [s], thrust (M,), rates (M, 3), attitudes (M, 4), hovering thrust."""


class _MappingReader:
    """Takes parts of a mapping out of tables."""

    def __init__(self, mapping: FlightMapping, tables: Tables) -> None:
        self._mapping = mapping
        self._tables = tables
        self._frames = Frames(mapping.world, mapping.body)
        self.notes: Counter[str] = Counter()

    def first(self, parts: Sequence[Any], read: Callable[[Any], Any]) -> Any:
        """What the first of ``parts`` gives that the tables hold; None where they hold none."""
        return next((found for part in parts if (found := read(part)) is not None), None)

    def motion(self, part: MappedMotion) -> Motion | None:
        """Of the rows in which all is finite; None where nothing of it is there."""
        lean = "" if part.attitude_table else "attitude"
        names = [*part.position, *(part.velocity or ()), *(part.attitude if lean else ()), *filter(None, [part.resets])]
        table, rows = self._rows(part, names)
        if table is None:
            return None
        time = self._time(part, table)[rows]
        place = np.stack([table[name][rows] for name in part.position], axis=1) * UNITS[part.position_unit]
        place = np.stack(self._frames.place(tuple(place.T)), axis=1)
        velocity = None
        if part.velocity is not None:
            velocity = np.stack(self._frames.place(tuple(table[name][rows] for name in part.velocity)), axis=1)
        resets = table[part.resets][rows] if part.resets else np.zeros(len(time))
        attitude = np.tile([1.0, 0.0, 0.0, 0.0], (len(time), 1))
        if part.attitude and lean:
            attitude = self._attitudes(part, table, rows)
        elif part.attitude:
            other = find_table(self._tables, part.attitude_table, part.attitude)
            if other is None:
                return None
            attitude = self._between(self._time(part, other), self._attitudes(part, other, slice(None)), time)
        good = np.isfinite(place).all(axis=1) & np.isfinite(attitude).all(axis=1) & np.isfinite(time)
        if not good.any():
            return None
        if not good.all():
            self.notes["rows without a number"] += int(np.count_nonzero(~good))
        return time[good], place[good], attitude[good], None if velocity is None else velocity[good], resets[good]

    def command(self, part: MappedCommand) -> Commands | None:
        """None where it is not there, or its thrust never changes."""
        names = [*part.thrust, *filter(None, [part.hover]), *(part.rates or ()), *part.attitude]
        table, rows = self._rows(part, names)
        if table is None:
            return None
        time = self._time(part, table)[rows]
        signal = np.mean([table[name][rows] for name in part.thrust], axis=0) / part.thrust_full
        hover = None
        if part.hover:
            level = table[part.hover][rows]
            hover = float(np.nanmedian(level)) / part.thrust_full
            signal = signal * (hover * part.thrust_full / level)
        rates = attitude = None
        if part.rates is not None:
            turn = [
                sign * table[name][rows] * UNITS[part.rate_unit]
                for sign, name in zip(part.signs, part.rates, strict=True)
            ]
            rates = np.stack(turn, axis=1) @ np.array(axes(self._mapping.body))
        if part.attitude:
            attitude = self._attitudes(part, table, rows)
        good = np.isfinite(signal) & np.isfinite(time)
        for more in (rates, attitude):
            if more is not None:
                good &= np.isfinite(more).all(axis=1)
        asked = signal[good] if attitude is None else np.ptp(attitude[good], axis=0)
        if not good.any() or float(np.ptp(signal[good])) < 1e-6 or float(np.ptp(asked)) < 1e-6:
            return None
        parts = (None if more is None else more[good] for more in (rates, attitude))
        return time[good], signal[good], *parts, hover

    def _rows(self, part: MappedTable, names: Sequence[str]) -> tuple[Table | None, Any]:
        time = part.time or self._mapping.time
        table = find_table(self._tables, part.table, [time, *names, *part.where])
        if table is None:
            return None, None
        rows = np.ones(len(table[time]), dtype=bool)
        for name, value in part.where.items():
            rows &= table[name] == value
        return (table, rows) if rows.any() else (None, None)

    def _time(self, part: MappedTable, table: Table) -> Column:
        name = part.time or self._mapping.time
        time: Column = table[name if name in table else self._mapping.time] * UNITS[self._mapping.time_unit]
        return time

    def _attitudes(self, part: MappedMotion | MappedCommand, table: Table, rows: Any) -> Column:
        """Body FRD to world NED, (N, 4); NaN where there is none."""
        given = np.stack([table[name][rows] for name in part.attitude], axis=1)
        if given.shape[1] == 3:
            signs = np.array(part.signs if isinstance(part, MappedCommand) else (1.0, 1.0, 1.0))
            angles = (given * signs * UNITS[part.angle_unit]).tolist()
            given = np.array([so3.from_euler_zyx(roll, pitch, yaw) for roll, pitch, yaw in angles])
        elif part.order == "xyzw":
            given = given[:, [3, 0, 1, 2]]
        length = np.linalg.norm(given, axis=1, keepdims=True)
        given = np.divide(given, length, out=np.full_like(given, np.nan), where=length > 0.5)
        w, x, y, z = given.T
        _, ours = self._frames.ours((0.0, 0.0, 0.0), (w, x, y, z))
        return np.stack(ours, axis=1)

    def _between(self, known_s: Column, known: Column, time_s: Column) -> Column:
        """Attitudes (N, 4) ``known`` at ``known_s``, interpolated; NaN outside."""
        signs = np.cumprod(np.where((known[1:] * known[:-1]).sum(axis=1) < 0.0, -1.0, 1.0))
        smooth = known * np.concatenate([[1.0], signs])[:, None]
        parts = [np.interp(time_s, known_s, column, left=np.nan, right=np.nan) for column in smooth.T]
        between = np.stack(parts, axis=1)
        unit: Column = between / np.linalg.norm(between, axis=1, keepdims=True)
        return unit
