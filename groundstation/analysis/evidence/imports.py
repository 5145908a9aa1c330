"""Import, ``groundstation logs import FILE… --map MAP --out FLIGHT.mcap``: a recording made of a
flight of others.

Poses stand where those of our own flights do (``/measured``); commands have a channel of their own
(``/imported/…``), so that nobody takes them for ours. Such a recording has no configuration.

A mapping is TOML, one that comes along (``groundstation/mappings``) or a file: it names columns,
units, axes, order of quaternions and time base; nothing is guessed. Tables are what the form of the
file has: of CSV the file itself, of a ULog its topics, of an ArduPilot .bin its message types, of a
recording of ours its channels.
"""

import csv
import json
import math
import os
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from fnmatch import fnmatch
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import msgspec
import numpy as np
from numpy.typing import NDArray

from groundstation.analysis.evidence.flight import (
    FASTEST_RAD_S,
    IMPORTED,
    MEASURED,
    SETPOINT,
    STATE,
    Column,
    ImportedFlight,
    ImportedSetpoint,
    ImportedState,
    MappedVehicle,
    Positive,
)
from groundstation.analysis.evidence.text_tables import (
    CsvLayout,
    Table,
    list_few,
    read_csv_table,
    read_motive_tables,
    read_qtm_tables,
)
from groundstation.analysis.evidence.tlog import read_tlog
from groundstation.config import ConfigError, from_dict, parse_toml, refuse_io, shipped_texts
from groundstation.core.geometry import Body, Frames, Quat, World, axes, so3
from groundstation.core.messages import FAR_M, Pose, notice
from groundstation.core.trajectory import FASTEST_M_S, LATEST_S
from groundstation.machine import open_private
from groundstation.pose.sources import Gate, GateConfig
from groundstation.recording import Vector3, add_channel, begin_mcap, channel_form, quaternion
from groundstation.runtime import Exit, __version__, require_package

Tables: TypeAlias = Mapping[str, Table]
Three = tuple[str, str, str]

UNITS = {
    "s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "m": 1.0, "cm": 1e-2, "mm": 1e-3,
    "rad": 1.0, "deg": math.pi / 180.0, "rad/s": 1.0, "deg/s": math.pi / 180.0,
}  # fmt: skip
"""Size of each unit in SI units."""
TimeUnit: TypeAlias = Literal["s", "ms", "us", "ns"]


class MappedTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the columns stand; those of every part are named as in the file."""

    table: str = "*"
    """Which table, by a pattern (``*`` and ``?``); of several the first that holds the columns."""
    time: str | None = None
    """Column of the time; without it that of the mapping."""
    where: dict[str, float] = {}
    """Only rows in which these columns have this value."""


class MappedPose(MappedTable, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Poses."""

    position: Three
    position_unit: Literal["m", "cm", "mm"] = "m"
    velocity: Three | None = None
    """[m/s] in the world's axes."""
    attitude: tuple[str, ...] = ()
    """Four columns of a quaternion, or roll, pitch and yaw (turned yaw first)."""
    attitude_table: str = ""
    """Another table for the attitude, which is then interpolated at the positions' times."""
    order: Literal["wxyz", "xyzw"] = "wxyz"
    """Order of the quaternion's columns."""
    angle_unit: Literal["rad", "deg"] = "rad"
    resets: str = ""
    """Column that counts when the source has moved its own origin."""


class MappedCommand(MappedTable, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Commands to the vehicle: thrust, and rates or an attitude if present."""

    thrust: tuple[str, ...]
    """Column of the collective thrust's signal, or those of the motors, whose mean it is."""
    thrust_full: float = 1.0
    """Value of the column at full thrust; below 0 where thrust points along -z."""
    hover: str = ""
    """Column of the signal that hovers, where the source tells it as the battery empties."""
    rates: Three | None = None
    """Body rates."""
    rate_unit: Literal["rad/s", "deg/s"] = "rad/s"
    attitude: tuple[str, ...] = ()
    """Set-point of the attitude, as in :class:`MappedPose`."""
    order: Literal["wxyz", "xyzw"] = "wxyz"
    angle_unit: Literal["rad", "deg"] = "rad"
    signs: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Signs of roll, pitch and yaw (or their rates), where the autopilot counts one the other way
    than the axes say."""


class MappedState(MappedTable, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Whether it flies, where the source tells."""

    column: str
    flies: float
    """Value of the column in flight."""


class FlightMapping(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All of it."""

    title: str
    """Title of the mapping: kind of file, and its origin."""
    format: Literal["csv", "motive", "qtm", "ulog", "bin", "tlog"]
    source: Literal["motion capture", "autopilot"]
    """Origin of the poses."""
    time: str = "t"
    time_unit: TimeUnit = "s"
    time_ns: str = ""
    """Column of nanoseconds that count beside ``time``, as in a stamp of ROS."""
    frames_hz: Positive | None = None
    """Frames per second, where ``time`` counts frames, as in a file of Vicon; ``time_unit`` is then
    not used."""
    csv: CsvLayout = CsvLayout()
    """Layout of the text, for CSV."""
    world: World = "ned"
    """Axes of positions, as in ``pose.world``."""
    body: Body = "frd"
    """Axes of the body, as in ``pose.body``."""
    latency_s: Annotated[float, msgspec.Meta(ge=0.0)] = 0.0
    """Least latency between a pose's instant and its arrival in the log, where stamps are of the
    arrival [s]."""
    pose: tuple[MappedPose, ...] = ()
    """The first that the file holds is taken; so with all parts."""
    command: tuple[MappedCommand, ...] = ()
    state: tuple[MappedState, ...] = ()
    vehicle: MappedVehicle = MappedVehicle()


def load_mapping(name: str) -> FlightMapping:
    """The mapping that comes along as ``name``, or that in the file ``name``.

    Raises:
        ConfigError: there is none, or a key is wrong.
    """
    known = shipped_texts("mappings")
    text = known.get(name)
    if text is None:
        try:
            text = Path(name).read_text("utf-8-sig")
        except UnicodeDecodeError as error:
            raise ConfigError("--map", notice("file.not_utf8", at=error.start), name) from None
        except (OSError, ValueError):
            raise ConfigError(
                "--map", notice("import.no_mapping", known=list(known), found=name)
            ) from None
    try:
        return from_dict(parse_toml(text), FlightMapping)
    except ValueError as error:
        raise ConfigError("--map", notice("value.refused", value=name, why=error)) from None
    except ConfigError as error:
        raise ConfigError(f"--map: {error.key}", error.problem, name) from None


def read_tables(mapping: FlightMapping, paths: Sequence[Path], notes: Counter[str]) -> Tables:
    """All tables of ``paths``, which are of one form (:attr:`FlightMapping.format`, but tlog).

    What was not used of them is counted in ``notes``.

    Raises:
        ConfigError: a file can't be read or is of another form.
    """
    form = mapping.format
    parts = (*mapping.pose, *mapping.command, *mapping.state)
    times = list(dict.fromkeys([mapping.time, *filter(None, (part.time for part in parts))]))
    read: dict[str, Callable[[Path], Iterator[tuple[str, Table]]]] = {
        "csv": lambda path: read_csv_table(path, mapping.csv, times, notes),
        "motive": read_motive_tables,
        "qtm": read_qtm_tables,
        "ulog": _ulog_tables,
        "bin": _bin_tables,
    }
    tables: dict[str, Table] = {}
    for path in paths:
        try:
            tables.update(read[form](path))
        except EOFError:
            raise ConfigError("FILE", notice("import.cut_off"), str(path)) from None
        except OSError as error:
            why = error.strerror or error
            raise ConfigError("FILE", notice("file.unread", path=path, why=why)) from None
        except UnicodeDecodeError as error:
            raise ConfigError("FILE", notice("file.not_utf8", at=error.start), str(path)) from None
        except (ValueError, TypeError, KeyError, IndexError, csv.Error, zlib.error) as error:
            why = " ".join(str(error).split())
            raise ConfigError(
                "FILE", notice("import.damaged", form=form, why=why), str(path)
            ) from None
    return tables


@contextmanager
def _silence() -> Iterator[None]:
    """Discard the output of libraries, in Python or in C."""
    with (
        Path(os.devnull).open("w", encoding="utf-8") as nowhere,
        redirect_stdout(nowhere),
        redirect_stderr(nowhere),
    ):
        kept = os.dup(2)
        os.dup2(nowhere.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)


def _ulog_tables(path: Path) -> Iterator[tuple[str, Table]]:
    require_package("pyulog", "FILE", "ulog")
    from pyulog import ULog
    from pyulog.exceptions import ULogException

    try:
        with path.open("rb") as file, _silence():  # it prints what it finds damaged
            if file.read(4) != b"ULog":
                raise ValueError(notice("import.no_ulog"))
            file.seek(0)
            topics = ULog(file).data_list
    except (ULogException, AttributeError, struct.error) as error:
        raise ValueError(error) from None
    for topic in topics:
        if topic.multi_id == 0:
            yield (
                topic.name,
                {name: np.asarray(column, np.float64) for name, column in topic.data.items()},
            )


def _bin_tables(path: Path) -> Iterator[tuple[str, Table]]:
    from pymavlink.DFReader import DFReader_binary

    rows: dict[str, list[list[float]]] = {}
    names: dict[str, list[str]] = {}
    with _silence():  # it prints each byte that it can't use
        with path.open("rb") as file:  # which is no folder
            if not file.read(1):
                raise ValueError(notice("file.empty"))
        try:
            log = DFReader_binary(str(path))
        except Exception as error:  # noqa: BLE001  # as such it is raised where a format is damaged
            raise ValueError(error) from None
        while (message := log.recv_msg()) is not None:
            fields = [
                (name, value)
                for name, value in message.to_dict().items()
                if isinstance(value, int | float)
            ]
            kind = message.get_type()
            known = names.setdefault(kind, [name for name, _ in fields])
            if known == [name for name, _ in fields]:
                rows.setdefault(kind, []).append([float(value) for _, value in fields])
        log.data_map.close()
        log.filehandle.close()
    for kind, some in rows.items():
        yield kind, dict(zip(names[kind], np.array(some).T, strict=True))


def find_table(tables: Tables, pattern: str, columns: Sequence[str]) -> Table | None:
    """The first table that fits the ``pattern`` and holds ``columns``."""
    for name, table in tables.items():
        if fnmatch(name, pattern) and all(column in table for column in columns):
            return table
    return None


def import_command(paths: Sequence[Path], map_name: str, out: Path, body: str = "") -> Exit:
    """Do it, say what was found and what is missing, and return 0.

    ``body`` names the vehicle, where the file of a tracker holds several bodies.

    Raises:
        ConfigError: the mapping or a file can't be read, holds no poses, or ``out`` is there
            already.
    """
    if out.exists():
        raise ConfigError("--out", notice("file.exists", path=out))
    mapping = load_mapping(map_name)
    for path in paths:
        if path.is_char_device():  # /dev/zero never ends
            raise ConfigError("FILE", notice("import.device"), str(path))
    flight = read_flight(mapping, paths, body)
    with refuse_io("--out", "file.unwritten", out):
        try:
            write_flight(flight, mapping, map_name, paths, out)
        except BaseException:
            out.unlink(missing_ok=True)  # what was begun of it
            raise
    print(f"{out}: {len(flight.of(MEASURED))} poses, {len(flight.of(SETPOINT))} commands")
    for line in flight.missing:
        print(f"missing: {line}")
    for reason, count in sorted(flight.notes.items()):
        print(f"{reason}: {count}")
    return Exit.DONE


PLAUSIBLE_S = (3e-4, 0.5)
"""Poses are no closer, and no further apart [s]; in milliseconds those of a tracker of 1000 Hz are
1 apart."""
MOST_BACKS = 0.3
"""Share of poses that may be older than the one before [-]; without order every second one is."""


def find_usual(time: Column) -> float:
    """The usual interval of rows at ``time`` (N,) [s], of those whose stamps differ.

    0 where none do.
    """
    steps = np.abs(np.diff(time))
    return float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0


def find_rising(time: Column) -> NDArray[np.bool_]:
    """Which rows at ``time`` (N,) [s] are newer than all before: not those after their clock was
    set back.
    """
    newest = np.maximum.accumulate(np.concatenate([[-np.inf], time[:-1]]))
    return np.asarray(time > newest)


def find_repeats(place: Column) -> NDArray[np.bool_]:
    """Which positions (N, 3) [m] repeat the one before: the log is faster than its source."""
    return np.asarray(np.all(np.diff(place, axis=0, prepend=place[:1] - 1.0) == 0.0, axis=1))


def choose_body(tables: Tables, body: str, path: Path) -> Tables:
    """The table of the ``body``; empty: of the only one.

    Raises:
        ConfigError: there are several, or none of that name.
    """
    names = ", ".join(tables)
    if body and body not in tables:
        raise ConfigError(
            "--body", notice("value.choice", choices=list(tables), found=body), str(path)
        )
    if not body and len(tables) > 1:
        raise ConfigError(
            "FILE", notice("import.bodies", count=len(tables), names=names), str(path)
        )
    return {name: table for name, table in tables.items() if body in ("", name)}


def read_flight(mapping: FlightMapping, paths: Sequence[Path], body: str = "") -> ImportedFlight:
    """The flight in the files ``paths``, of the ``body`` where a tracker's file holds several.

    Raises:
        ConfigError: a file can't be read, or there are no poses.
    """
    is_tracker = mapping.format in ("motive", "qtm")
    if body and not is_tracker:
        raise ConfigError("--body", notice("import.one_body", format=mapping.format))
    if mapping.format == "tlog":
        if len(paths) != 1:
            raise ConfigError("FILE", notice("import.one_tlog", count=len(paths)))
        return read_tlog(paths[0], mapping.latency_s)
    notes = Counter[str]()
    tables = read_tables(mapping, paths, notes)
    if is_tracker:
        tables = choose_body(tables, body, paths[0])
    reader = _MappingReader(mapping, tables, notes)
    poses = _read_poses(reader, mapping, paths[0])
    flight = ImportedFlight(float(poses[0][0]))
    _add_poses(flight, poses)
    _add_commands(flight, reader, mapping)
    flight.notes.update(reader.notes)
    flight.notes = +flight.notes
    _add_states(flight, reader, mapping)
    return flight


def _read_poses(reader: "_MappingReader", mapping: FlightMapping, file: Path) -> "PoseColumns":
    """The poses, in the order of the file.

    Raises:
        ConfigError: there are none, or by their stamps they come at a rate, or move at a speed,
            that no tracker sees.
    """
    poses: PoseColumns | None = reader.first(mapping.pose, reader.poses)
    if poses is None:
        raise ConfigError(
            "FILE", notice("import.no_poses", why=reader.lacks(mapping.pose)), str(file)
        )
    time = poses[0]
    backs = int(np.count_nonzero(np.diff(time) < 0.0))
    if backs > MOST_BACKS * len(time):
        raise ConfigError(
            "FILE",
            notice("import.no_order", backs=backs, poses=len(time), limit=MOST_BACKS * len(time)),
            str(file),
        )
    apart_s = find_usual(time) if len(time) > 1 else PLAUSIBLE_S[1]
    if not PLAUSIBLE_S[0] <= apart_s <= PLAUSIBLE_S[1]:
        id = "import.time_unit" if apart_s else "import.one_stamp"
        says = notice(id, unit=mapping.time_unit, apart_s=apart_s)
        raise ConfigError("--map: time_unit", says, str(file))
    moves = np.diff(time) > 0.0
    speeds = np.linalg.norm(np.diff(poses[1], axis=0)[moves], axis=1) / np.diff(time)[moves]
    if mapping.source == "motion capture" and moves.any() and np.median(speeds) > FASTEST_M_S:
        says = notice("import.lengths", speed_m_s=float(np.median(speeds)), fastest_m_s=FASTEST_M_S)
        raise ConfigError("FILE", says, str(file))
    return poses


GATE = GateConfig(
    acceleration_m_s2=150.0, speed_m_s=100.0, tilt_deg=180.0, drop_frozen=False, settle_s=1.0
)
"""Gate of recorded poses: it drops what another body or none was taken for, and believes all that a
vehicle can fly."""


def _add_poses(flight: ImportedFlight, poses: "PoseColumns") -> None:
    """Add the poses that are new and pass the gate."""
    time, place, attitude, velocity, resets = poses
    late = ~find_rising(time)
    repeats = find_repeats(place)
    flight.notes["poses not newer than the one before"] += int(np.count_nonzero(late))
    flight.notes["poses that repeat the one before"] += int(np.count_nonzero(repeats & ~late))
    gate = Gate(GATE)
    for k in np.flatnonzero(~(late | repeats)).tolist():
        at = float(time[k] - time[0])
        velocity_ned = None if velocity is None else _three(velocity[k])
        pose, _ = gate.filter_pose(
            Pose(0, at, at, _three(place[k]), _four(attitude[k]), velocity_ned, int(resets[k]))
        )
        if pose is not None:
            flight.add_pose(pose, k)
    flight.notes.update(
        {f"poses dropped by the gate, {why}": count for why, count in gate.dropped.items()}
    )


def _add_states(flight: ImportedFlight, reader: "_MappingReader", mapping: FlightMapping) -> None:
    """Add when it may fly and when not."""
    times, flies = reader.first(mapping.state, reader.state) or ((), ())
    since = [max(0.0, float(at) - flight.begun_s) for at in times]
    since[:1] = [0.0] * len(since[:1])  # the first tells of what was before, too
    states = [
        (at, STATE, ImportedState(at, bool(may))) for at, may in zip(since, flies, strict=True)
    ]
    flight.messages[:0] = states  # before the poses of the same instant


def _add_commands(flight: ImportedFlight, reader: "_MappingReader", mapping: FlightMapping) -> None:
    commands = reader.first(mapping.command, reader.command)
    if commands is None:
        no_thrust = "nothing is identified, prediction knows no thrust"
        flight.missing.append(f"no commands in it, or none whose thrust changes: {no_thrust}")
        return
    time, signal, rates, attitude, flight.hover = commands
    beyond = int(np.count_nonzero((signal < 0.0) | (signal > 1.0)))
    if beyond:
        flight.notes["thrust beyond 0 or full, cut off there"] += beyond
    if rates is None and attitude is None:
        flight.missing.append(
            "neither body rates nor an attitude were commanded in it: only thrust is known"
        )
    for k in np.flatnonzero(find_rising(time)).tolist():
        at = float(time[k]) - flight.begun_s
        turn = msgspec.UNSET if rates is None else Vector3(*_three(rates[k]))
        lean = msgspec.UNSET if attitude is None else quaternion(_four(attitude[k]))
        thrust = float(np.clip(signal[k], 0.0, 1.0))
        flight.messages.append((at, SETPOINT, ImportedSetpoint(at, thrust, turn, lean)))


def describe_import(
    flight: ImportedFlight, mapping: FlightMapping, map_name: str, paths: Sequence[Path]
) -> dict[str, str]:
    """First record of an imported flight, which describes it."""
    return {
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


def write_flight(
    flight: ImportedFlight, mapping: FlightMapping, map_name: str, paths: Sequence[Path], out: Path
) -> None:
    """Write it to ``out``.

    Raises:
        OSError: it can't be written.
    """
    about = describe_import(flight, mapping, map_name, paths)
    stamp_ns = max(0, round(flight.begun_s * 1e9))
    with open(out, "wb", opener=open_private) as file:  # Path.open has no opener
        writer = begin_mcap(file, "groundstation import", about)
        ids = {
            topic: add_channel(writer, channel_form(topic, *kind))
            for topic, kind in IMPORTED.items()
        }
        for at, topic, message in sorted(flight.messages, key=lambda one: one[0]):
            at_ns = max(0, stamp_ns + round(at * 1e9))
            writer.add_message(ids[topic], at_ns, msgspec.json.encode(message), at_ns)
        writer.finish()


def _three(row: Column) -> tuple[float, float, float]:
    x, y, z = row.tolist()
    return x, y, z


def _four(row: Column) -> Quat:
    w, x, y, z = row.tolist()
    return w, x, y, z


PoseColumns = tuple[Column, Column, Column, Column | None, Column]
"""Times (N,) [s], positions (N, 3), attitudes (N, 4), velocities (N, 3) or None, resets (N,)."""
Commands = tuple[Column, Column, Column | None, Column | None, float | None]
"""Times (M,) [s], thrust (M,), rates (M, 3), attitudes (M, 4), hovering thrust."""


class _MappingReader:
    """Takes parts of a mapping out of tables."""

    def __init__(self, mapping: FlightMapping, tables: Tables, notes: Counter[str]) -> None:
        self._mapping = mapping
        self._tables = tables
        self._frames = Frames(mapping.world, mapping.body)
        self.notes = notes

    def first(self, parts: Sequence[Any], read: Callable[[Any], Any]) -> Any:
        """Read the first of ``parts`` that the tables hold; None where they hold none."""
        return next((found for part in parts if (found := read(part)) is not None), None)

    def lacks(self, parts: Sequence[MappedPose]) -> str:
        """Describe the missing columns of the part that lacks the fewest, as a sentence."""
        missing = [
            (
                [
                    column
                    for column in [part.time or self._mapping.time, *self._columns(part)]
                    if column not in table
                ],
                name,
            )
            for part in parts
            for name, table in self._tables.items()
            if fnmatch(name, part.table)
        ]
        fewest, name = min(missing, key=lambda one: len(one[0]), default=(None, ""))
        if fewest is None:
            return notice("import.no_table", found=list_few(sorted(self._tables))).text
        table = self._tables[name]
        if fewest:
            return notice(
                "import.no_column", columns=", ".join(fewest), table=name, found=list_few(table)
            ).text
        named = {
            column
            for part in parts
            for column in [part.time or self._mapping.time, *self._columns(part)]
        }
        empty = [
            column for column in table if column in named and not np.isfinite(table[column]).any()
        ]
        if empty and len(table[empty[0]]):
            return notice("import.no_numbers", columns=", ".join(empty), table=name).text
        return notice("import.no_row", table=name).text

    @staticmethod
    def _columns(part: MappedPose) -> list[str]:
        lean = () if part.attitude_table else part.attitude
        return [*part.position, *(part.velocity or ()), *lean, *filter(None, [part.resets])]

    def poses(self, part: MappedPose) -> PoseColumns | None:
        """Read the poses of rows that are finite; None without any."""
        lean = not part.attitude_table
        table, rows = self._rows(part, self._columns(part))
        if table is None:
            return None
        time = self._time(part, table)[rows]
        place = np.stack([table[name][rows] for name in part.position], axis=1)
        place *= UNITS[part.position_unit]
        place[~np.isfinite(place)] = np.nan
        place = np.stack(self._frames.convert_point(tuple(place.T)), axis=1)
        velocity = None
        if part.velocity is not None:
            velocity = np.stack(
                self._frames.convert_point(tuple(table[name][rows] for name in part.velocity)),
                axis=1,
            )
        resets = table[part.resets][rows] if part.resets else np.zeros(len(time))
        attitude = np.tile([1.0, 0.0, 0.0, 0.0], (len(time), 1))
        if part.attitude and lean:
            attitude = self._attitudes(part, table, rows)
        elif part.attitude:
            other = find_table(self._tables, part.attitude_table, part.attitude)
            if other is None:
                return None
            attitude = self._between(
                self._time(part, other), self._attitudes(part, other, slice(None)), time
            )
        good = (
            (np.abs(place) < FAR_M).all(axis=1)
            & np.isfinite(attitude).all(axis=1)
            & np.isfinite(time)
        )
        if not good.any():
            return None
        if not good.all():
            self.notes["rows without a number"] += int(np.count_nonzero(~good))
        return (
            time[good],
            place[good],
            attitude[good],
            None if velocity is None else velocity[good],
            resets[good],
        )

    def state(self, part: MappedState) -> tuple[Column, Column] | None:
        """When it said so, and whether it flies; None where it is not there."""
        table, rows = self._rows(part, [part.column])
        if table is None:
            return None
        time = self._time(part, table)[rows]
        good = np.isfinite(time)
        return time[good], table[part.column][rows][good] == part.flies

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
            unit_rad_s = UNITS[part.rate_unit]
            turn = [
                sign * table[name][rows] * unit_rad_s
                for sign, name in zip(part.signs, part.rates, strict=True)
            ]
            rates = np.stack(turn, axis=1) @ np.array(axes(self._mapping.body))
        if part.attitude:
            attitude = self._attitudes(part, table, rows)
        good = np.isfinite(signal) & np.isfinite(time)
        for more in (rates, attitude):
            if more is not None:
                # No NaN either; of an attitude each is 1 at most.
                good &= (np.abs(more) <= FASTEST_RAD_S).all(axis=1)
        if not good.any():
            return None
        asked = signal[good] if attitude is None else np.ptp(attitude[good], axis=0)
        if float(np.ptp(np.clip(signal[good], 0.0, 1.0))) < 1e-6 or float(np.ptp(asked)) < 1e-6:
            return None
        if not good.all():
            self.notes["commands without a number"] += int(np.count_nonzero(~good))
        parts = (None if more is None else more[good] for more in (rates, attitude))
        return time[good], signal[good], *parts, hover

    def _rows(self, part: MappedTable, names: Sequence[str]) -> tuple[Table | None, Any]:
        time = part.time or self._mapping.time
        fraction = filter(None, [self._mapping.time_ns])
        table = find_table(self._tables, part.table, [time, *fraction, *names, *part.where])
        if table is None:
            return None, None
        rows = np.ones(len(table[time]), dtype=bool)
        for name, value in part.where.items():
            rows &= table[name] == value
        return (table, rows) if rows.any() else (None, None)

    def _time(self, part: MappedTable, table: Table) -> Column:
        name = part.time or self._mapping.time
        unit_s = (
            UNITS[self._mapping.time_unit]
            if self._mapping.frames_hz is None
            else 1.0 / self._mapping.frames_hz
        )
        time: Column = table[name if name in table else self._mapping.time] * unit_s
        if self._mapping.time_ns:
            time = time + 1e-9 * table[self._mapping.time_ns]
        far = np.abs(time) >= LATEST_S
        # All of them: of another unit.
        return time if far.mean() > 0.5 else np.where(far, np.nan, time)

    def _attitudes(self, part: MappedPose | MappedCommand, table: Table, rows: Any) -> Column:
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
        _, ours = self._frames.to_ours((0.0, 0.0, 0.0), (w, x, y, z))
        return np.stack(ours, axis=1)

    def _between(self, known_s: Column, known: Column, time_s: Column) -> Column:
        """Attitudes (N, 4) ``known`` at ``known_s``, interpolated; NaN outside."""
        signs = np.cumprod(np.where((known[1:] * known[:-1]).sum(axis=1) < 0.0, -1.0, 1.0))
        smooth = known * np.concatenate([[1.0], signs])[:, None]
        parts = [
            np.interp(time_s, known_s, column, left=np.nan, right=np.nan) for column in smooth.T
        ]
        between = np.stack(parts, axis=1)
        unit: Column = between / np.linalg.norm(between, axis=1, keepdims=True)
        return unit
