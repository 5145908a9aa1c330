"""Mapping: how the columns of a file that others recorded become poses, commands, reference and truth.

A mapping is TOML, one that comes along (``groundstation/mappings``) or a file: columns, units, axes, order of
quaternions and time base are named in it, nothing is guessed. Tables are what the form of the file has: of CSV the file
itself, of a ULog its topics, of an ArduPilot .bin its message types, of a recording of ours its channels.
"""

import csv
import gzip
import io
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from fnmatch import fnmatch
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import msgspec
import numpy as np
from numpy.typing import NDArray

from groundstation.config import ConfigError, from_dict, parse_toml
from groundstation.core.geometry import Body, World

Column: TypeAlias = NDArray[np.float64]
Table: TypeAlias = Mapping[str, Column]
Tables: TypeAlias = Mapping[str, Table]
Three = tuple[str, str, str]
Positive = Annotated[float, msgspec.Meta(gt=0.0)]

UNITS = {
    "s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "m": 1.0, "cm": 1e-2, "mm": 1e-3, "m/s": 1.0,
    "rad": 1.0, "deg": math.pi / 180.0, "rad/s": 1.0, "deg/s": math.pi / 180.0,
}  # fmt: skip
TimeUnit: TypeAlias = Literal["s", "ms", "us", "ns"]


class MappedTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the columns stand; those of every part are named as in the file."""

    table: str = "*"
    """Which table, by a pattern (``*`` and ``?``); of several the first that holds the columns."""
    time: str | None = None
    """Column of the time; without it that of the mapping."""
    where: dict[str, float] = {}
    """Only rows in which these columns have these values."""


class MappedMotion(MappedTable, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Poses, reference or truth."""

    position: Three
    position_unit: Literal["m", "cm", "mm"] = "m"
    velocity: Three | None = None
    """[m/s] in the world's axes."""
    attitude: tuple[str, ...] = ()
    """Four columns of a quaternion, or roll, pitch and yaw (turned yaw first)."""
    attitude_table: str = ""
    """Where the attitude stands in another table: it is then interpolated at the positions' times."""
    order: Literal["wxyz", "xyzw"] = "wxyz"
    """Of the quaternion's columns."""
    angle_unit: Literal["rad", "deg"] = "rad"
    resets: str = ""
    """Column that counts when the source has moved its own origin."""


class MappedCommand(MappedTable, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the vehicle was commanded: thrust, and rates or an attitude where they are there."""

    thrust: tuple[str, ...]
    """Column of the collective thrust's signal, or those of the motors, whose mean it is."""
    thrust_full: float = 1.0
    """What the column has at full thrust; below 0 where thrust points along -z."""
    hover: str = ""
    """Column of the signal that hovers, where the source tells it as the battery empties."""
    rates: Three | None = None
    """Body rates."""
    rate_unit: Literal["rad/s", "deg/s"] = "rad/s"
    attitude: tuple[str, ...] = ()
    """Set-point of the attitude, as in :class:`MappedMotion`."""
    order: Literal["wxyz", "xyzw"] = "wxyz"
    angle_unit: Literal["rad", "deg"] = "rad"
    signs: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Of roll, pitch and yaw (or their rates), where the autopilot counts one the other way than the axes say."""


class MappedVehicle(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What is known of the vehicle beforehand; what a flight tells by itself need not be here."""

    mass_kg: Positive = 1.0
    thrust_lag_s: Positive = 0.05
    rate_lag_s: Positive = 0.05
    thrust_curve: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.0
    """f of thrust = f u² + (1 - f) u, from signal to thrust [-]."""
    attitude_p: Positive = 6.5
    """Gain of the autopilot's attitude loop [1/s]: by it an attitude set-point becomes body rates."""


class FlightMapping(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All of it."""

    title: str
    """What is read with it, and where that comes from."""
    format: Literal["csv", "ulog", "bin", "tlog", "mcap"]
    source: Literal["motion capture", "autopilot"]
    """What the poses are of."""
    time: str = "t"
    time_unit: TimeUnit = "s"
    world: World = "ned"
    """Axes of positions, as in ``pose.world``."""
    body: Body = "frd"
    """Axes of the body, as in ``pose.body``."""
    latency_s: Annotated[float, msgspec.Meta(ge=0.0)] = 0.0
    """From a pose's instant to its earliest arrival in the log, where stamps are of the arrival [s]."""
    pose: tuple[MappedMotion, ...] = ()
    """The first that the file holds is taken; so with all parts."""
    command: tuple[MappedCommand, ...] = ()
    reference: tuple[MappedMotion, ...] = ()
    truth: tuple[MappedMotion, ...] = ()
    vehicle: MappedVehicle = MappedVehicle()


def shipped_mappings() -> dict[str, str]:
    """The text of each mapping that comes along, by name."""
    files = sorted((resources.files("groundstation") / "mappings").iterdir(), key=lambda file: file.name)
    return {file.name.removesuffix(".toml"): file.read_text("utf-8") for file in files if file.name.endswith(".toml")}


def load_mapping(name: str) -> FlightMapping:
    """The mapping that comes along as ``name``, or that in the file ``name``.

    Raises:
        ConfigError: there is none, or a key is wrong.
    """
    known = shipped_mappings()
    text = known.get(name)
    if text is None:
        try:
            text = Path(name).read_text("utf-8")
        except (OSError, ValueError):
            raise ConfigError("--map", f"expected a file or one of {list(known)}, got {name!r}") from None
    try:
        return from_dict(parse_toml(text), FlightMapping)
    except ValueError as error:
        raise ConfigError("--map", f"{name}: {error}") from None
    except ConfigError as error:
        raise ConfigError(f"--map: {error.key}", error.problem, name) from None


def read_tables(form: str, paths: Sequence[Path]) -> Tables:
    """All tables of ``paths``, which are of one ``form`` (:attr:`FlightMapping.format`, but tlog).

    Raises:
        ConfigError: a file can't be read or is of another form.
    """
    read: dict[str, Callable[[Path], Iterator[tuple[str, Table]]]] = {
        "csv": _csv_tables, "ulog": _ulog_tables, "bin": _bin_tables, "mcap": _mcap_tables,
    }  # fmt: skip
    tables: dict[str, Table] = {}
    for path in paths:
        try:
            tables.update(read[form](path))
        except (OSError, EOFError) as error:
            raise ConfigError(
                "FILE", f"cannot read it: {getattr(error, 'strerror', None) or error}", str(path)
            ) from None
        except (ValueError, TypeError, KeyError, IndexError) as error:
            raise ConfigError("FILE", f"is no {form} file, or damaged: {error}", str(path)) from None
    return tables


def _csv_tables(path: Path) -> Iterator[tuple[str, Table]]:
    """One table, by the file's name; a cell that is a list ("[1, 2]") becomes columns NAME.0, NAME.1."""
    raw = path.read_bytes()
    text = (gzip.decompress(raw) if raw[:2] == b"\x1f\x8b" else raw).decode("utf-8-sig")
    rows = csv.reader(io.StringIO(text))
    head = [name.strip() for name in next(rows, [])]
    values: dict[str, list[float]] = {}
    for row in rows:
        if len(row) != len(head):
            continue  # a last row that was cut off
        for name, cell in zip(head, row, strict=True):
            for key, value in _cells(name, cell.strip()):
                values.setdefault(key, []).append(value)
    longest = max(map(len, values.values()), default=0)
    yield path.name, {name: np.array(column) for name, column in values.items() if len(column) == longest}


def _cells(name: str, cell: str) -> Iterator[tuple[str, float]]:
    if cell.startswith("["):
        parts: list[tuple[str, Any]] = [(name, json.loads(cell))]
        for key, part in parts:
            if isinstance(part, list) and len(part) == 1:
                parts.append((key, part[0]))
            elif isinstance(part, list):
                parts += [(f"{key}.{index}", item) for index, item in enumerate(part)]
            else:
                yield key, math.nan if part is None else float(part)
        return
    try:
        yield name, float(cell)
    except ValueError:
        yield name, math.nan


def _ulog_tables(path: Path) -> Iterator[tuple[str, Table]]:
    try:
        from pyulog import ULog
    except ImportError:
        raise ConfigError(
            "FILE", "a ULog needs pyulog: pip install 'quadrotor-groundstation[ulog]'", str(path)
        ) from None
    with path.open("rb") as file:
        if file.read(4) != b"ULog":
            raise ValueError("it does not begin with ULog")
    for topic in ULog(str(path)).data_list:
        if topic.multi_id == 0:
            yield topic.name, {name: np.asarray(column, np.float64) for name, column in topic.data.items()}


def _bin_tables(path: Path) -> Iterator[tuple[str, Table]]:
    from pymavlink.DFReader import DFReader_binary

    rows: dict[str, list[list[float]]] = {}
    names: dict[str, list[str]] = {}
    log = DFReader_binary(str(path))
    while (message := log.recv_msg()) is not None:
        fields = [(name, value) for name, value in message.to_dict().items() if isinstance(value, int | float)]
        kind = message.get_type()
        known = names.setdefault(kind, [name for name, _ in fields])
        if known == [name for name, _ in fields]:
            rows.setdefault(kind, []).append([float(value) for _, value in fields])
    log.data_map.close()
    log.filehandle.close()
    for kind, some in rows.items():
        yield kind, dict(zip(names[kind], np.array(some).T, strict=True))


def _mcap_tables(path: Path) -> Iterator[tuple[str, Table]]:
    from groundstation.analysis.recordings import flatten
    from groundstation.recording import NoRecording, Recording

    values: dict[str, dict[str, list[float]]] = {}
    try:
        for entry in Recording(path).entries(("/measured", "/command", "/reference")):
            table = values.setdefault(entry.topic, {})
            for name, value in flatten(entry.value(), ""):
                if isinstance(value, int | float) and not name.startswith("bring_down"):
                    table.setdefault(name, []).append(float(value))
    except NoRecording as error:
        raise ValueError(error) from None
    for topic, table in values.items():
        longest = max(map(len, table.values()), default=0)
        yield topic, {name: np.array(column) for name, column in table.items() if len(column) == longest}


def find_table(tables: Tables, pattern: str, columns: Sequence[str]) -> Table | None:
    """The first table that fits the ``pattern`` and holds ``columns``."""
    for name, table in tables.items():
        if fnmatch(name, pattern) and all(column in table for column in columns):
            return table
    return None
