"""Tables in text files: CSV by its mapping, and exports of Motive and QTM, one table a body.

Motive, Export Tracking Data: a line of keys and values; rows Type, Name, ID and, since Motive 2.2,
Parent; a row of Rotation and Position; the head; a row for each frame, empty where the body is not
seen.

QTM, 6D TSV: lines of a key and its values; the head, ``NAME X``, ``Y``, ``Z``, three angles,
``Residual`` and ``Rot[0]`` to ``Rot[8]`` for each body; a row for each frame. The matrix is written
column by column, body to lab: in QTM's files a roll of -0.656° stands beside ``Rot[5]`` = -0.01145
= sin(roll).
"""

import csv
import gzip
import json
import math
from array import array
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import chain, islice
from pathlib import Path
from typing import Annotated, Any, TextIO, TypeAlias

import msgspec
import numpy as np
from numpy.typing import NDArray

from groundstation.analysis.evidence.flight import Column
from groundstation.config import ConfigError, parse_number
from groundstation.core.geometry import so3
from groundstation.core.messages import notice
from links.core import UNIT_TOLERANCE

Table: TypeAlias = Mapping[str, Column]

LOOK_ROWS = 100
"""The head is looked for in so many lines."""
SEPARATORS = ";\t, "
GZIP_BEGIN = b"\x1f\x8b"
"""First bytes of a file packed by gzip."""
MOTIVE_BEGIN = "Format Version"
"""First words of a file of Motive."""
QTM_BEGIN = "NO_OF_FRAMES"
"""First words of a file of QTM."""
LENGTHS_M = {"meters": 1.0, "centimeters": 1e-2, "millimeters": 1e-3}
"""Motive's units of length [m]."""


class CsvLayout(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Layout of a CSV file's text."""

    head_rows: Annotated[int, msgspec.Meta(ge=0, le=10)] = 1
    """The head consists of so many lines: a column is named by its cells in them, joined by blanks,
    or by the last of them alone where that is unique. 0: there is no head; columns are "1", "2",
    …"""


@contextmanager
def open_text(path: Path) -> Iterator[TextIO]:
    """Open a text file in UTF-8, packed by gzip or not."""
    with path.open("rb") as raw:
        begin = raw.read(2)
    with (gzip.open if begin == GZIP_BEGIN else open)(
        path, "rt", encoding="utf-8-sig", newline=""
    ) as text:
        assert not isinstance(text, gzip.GzipFile)
        yield text


def read_csv_table(
    path: Path, layout: CsvLayout, times: Sequence[str], notes: Counter[str]
) -> Iterator[tuple[str, Table]]:
    """Read one table, by the file's name.

    A cell that is a list ("[1, 2]") becomes columns NAME.0, NAME.1.

    The head is the first line that holds one of ``times``, the columns of the time; lines before it
    are no part of the table. It may be a comment (#) above the numbers. The separator of cells is a
    comma, unless the head has more semicolons or tabs (numbers then may have decimal commas), or
    nothing but blanks.

    Raises:
        ConfigError: no head is found, or several columns have the same name.
        ValueError: the file is empty.
    """
    with open_text(path) as text:
        lines = [line for line in islice(text, LOOK_ROWS) if line.strip()]
        if not lines:
            raise ValueError(notice("file.empty"))
        separator, head, body = _find_head(lines, layout, times, path)
        names = [name for name in head if name]
        values: dict[str, array[float]] = {}
        for row in _split(chain(body, text), separator):
            if any(cell.strip() for cell in row[len(head) :]) or len(row) < len(head):
                notes["rows with another number of cells than the head"] += bool(row)
                continue  # among them a last row that was cut off
            for name, cell in zip(head, row, strict=False):
                if not name:
                    continue
                said = cell.strip()
                if separator in ";\t" and "[" not in said:
                    said = said.replace(",", ".")
                for key, value in _cells(name, said):
                    if key not in values:
                        values[key] = array("d")  # a flight may have a million rows
                    values[key].append(value)
    longest = max(map(len, values.values()), default=0)
    yield (
        path.name,
        {name: np.array(column) for name, column in values.items() if len(column) == longest}
        or {name: np.array([]) for name in names},
    )


def _find_head(
    lines: Sequence[str], layout: CsvLayout, times: Sequence[str], path: Path
) -> tuple[str, list[str], Sequence[str]]:
    """Find the separator, the names of the columns, and the lines below the head.

    Raises:
        ConfigError: no line is a head, or several columns have the same name.
    """
    if layout.head_rows == 0:
        first = next((k for k, line in enumerate(lines) if not line.startswith("#")), len(lines))
        # A program may write a warning among the rows: most of them say how the table is laid out.
        separator = next(
            (one for one in SEPARATORS if 2 * sum(one in row for row in lines) > len(lines)), ","
        )
        counts = Counter(len(row) for row in _split(lines, separator))
        return separator, [str(k + 1) for k in range(counts.most_common(1)[0][0])], lines[first:]
    for k, line in enumerate(lines):
        found = {one: _names(line, one) for one in SEPARATORS}
        holds = [one for one in SEPARATORS if any(name in times for name in found[one])]
        if not holds:
            continue
        separator = max(holds, key=lambda one: (one != " ", len(found[one])))
        above = lines[max(0, k - layout.head_rows + 1) : k]
        names = _join_heads([*above, line], separator)
        if twice := [name for name in names if name and names.count(name) > 1]:
            raise ConfigError(
                "FILE", notice("import.same_names", name=twice[0], hint=_hint(lines)), str(path)
            )
        return separator, names, lines[k + 1 :]
    problem = notice("import.no_head", rows=len(lines), names=", ".join(times), hint=_hint(lines))
    raise ConfigError("FILE", problem, str(path))


def _join_heads(lines: Sequence[str], separator: str) -> list[str]:
    """Name the columns by the last of the head's ``lines``, or by all where that is not unique."""
    rows = [_names(line, separator) for line in lines]
    last = rows[-1]
    names = []
    for k, name in enumerate(last):
        if last.count(name) == 1 or not name:
            names.append(name)
            continue
        parts = [row[k] for row in rows if k < len(row) and row[k]]
        names.append(" ".join(parts))
    return names


def _hint(lines: Sequence[str]) -> str:
    """Name the mapping that comes along for such a file; empty where there is none."""
    for begin, name in ((MOTIVE_BEGIN, "motive"), (QTM_BEGIN, "qtm")):
        if lines and lines[0].startswith(begin):
            return f"; for this file there is --map {name}"
    return ""


def _names(line: str, separator: str) -> list[str]:
    return [cell.strip() for cell in next(_split([line.lstrip("#")], separator), [])]


def _split(lines: Iterable[str], separator: str) -> Iterator[list[str]]:
    if separator == " ":
        return (line.split() for line in lines)
    return csv.reader(lines, delimiter=separator, skipinitialspace=True)


def _number(cell: str) -> float:
    try:
        return parse_number(cell)
    except ValueError:
        return math.nan


def _read_numbers(rows: Iterable[list[str]], width: int) -> Column:
    """The cells of ``rows`` as numbers, (N, ``width``); NaN where there is none."""
    return np.array(
        [[_number(cell) for cell in (row + [""] * width)[:width]] for row in rows]
    ).reshape(-1, width)


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
    yield name, _number(cell)


MOTIVE_COLUMNS = ("x", "y", "z", "qw", "qx", "qy", "qz")
"""Columns that a rigid body needs."""


def _find_motive_bodies(
    labels: Mapping[str, Sequence[str]], kinds: Sequence[str], axes: Sequence[str]
) -> dict[str, dict[str, int]]:
    """Where the columns of each rigid body stand, of those that have all.

    Raises:
        ValueError: two bodies have one name.
    """
    bodies: dict[str, dict[str, int]] = {}
    types, ids = labels.get("Type", []), labels.get("ID", [])
    for k, name in enumerate(labels["Name"]):
        if k < 2 or k >= min(len(axes), len(kinds)) or (types and types[k] != "Rigid Body"):
            continue
        known = {"Rotation": "q", "Position": ""}.get(kinds[k])
        if known is not None and axes[k] in "XYZW":
            body = bodies.setdefault(name, {})
            column = known + axes[k].lower()
            if column in body:
                where = f"{name} (ID {ids[k]})" if k < len(ids) else name
                raise ValueError(notice("import.two_bodies", name=where))
            body[column] = k
    return {name: at for name, at in bodies.items() if set(MOTIVE_COLUMNS) <= set(at)}


def read_motive_tables(path: Path) -> Iterator[tuple[str, Table]]:
    """Read the rigid bodies of a file that Motive exported: t [s], x, y, z [m], qw, qx, qy, qz.

    Raises:
        ConfigError: it holds no rigid body, or states what is not read here.
        ValueError: it is no such file.
    """
    with open_text(path) as text:
        rows = csv.reader(text)
        first = next(rows, [])
        if not first or first[0].strip() != MOTIVE_BEGIN:
            raise ValueError(notice("import.no_version"))
        stated = dict(zip(first[0::2], first[1::2], strict=False))
        labels, kinds, axes = _read_motive_head(rows)
        unit = stated.get("Length Units", "").lower()
        _expect(
            path, "Length Units", stated, unit in LENGTHS_M, "Meters, Centimeters or Millimeters"
        )
        turns = stated.get("Rotation Type") == "Quaternion"
        _expect(path, "Rotation Type", stated, turns, "Quaternion")
        is_global = stated.get("Coordinate Space", "Global") == "Global"
        _expect(path, "Coordinate Space", stated, is_global, "Global")
        whole = _find_motive_bodies(labels, kinds, axes)
        if not whole:
            raise ConfigError(
                "FILE",
                notice("import.no_body", found=list_few(labels.get("Type", [])[2:])),
                str(path),
            )
        cells = _read_numbers((row for row in rows if len(row) > 1), len(axes))
    scales = dict.fromkeys("xyz", LENGTHS_M[unit])
    for name, at in whole.items():
        yield (
            name,
            {
                "t": cells[:, 1],
                **{key: cells[:, at[key]] * scales.get(key, 1.0) for key in MOTIVE_COLUMNS},
            },
        )


def _read_motive_head(
    rows: Iterator[list[str]],
) -> tuple[dict[str, list[str]], list[str], list[str]]:
    """Read the rows by their labels, the row of kinds (Rotation, Position), and that of the axes.

    Raises:
        ValueError: there is no such head.
    """
    labels: dict[str, list[str]] = {}
    kinds: list[str] = []
    for row in islice(rows, LOOK_ROWS):
        cells = [cell.strip() for cell in row]
        if cells[:1] == ["Frame"]:
            if "Name" not in labels:
                break
            return labels, kinds, cells
        label = cells[1] if len(cells) > 1 else ""
        if label:
            labels[label] = cells
        elif any(cells):
            kinds = cells
    raise ValueError(notice("import.no_motive_head"))


def _expect(path: Path, key: str, stated: Mapping[str, str], good: bool, wanted: str) -> None:
    if not good:
        found = stated.get(key, "") or "nothing"
        raise ConfigError(
            "FILE", notice("import.stated", key=key, found=found, wanted=wanted), str(path)
        )


def read_qtm_tables(path: Path) -> Iterator[tuple[str, Table]]:
    """Read the bodies of a 6D file that QTM exported: t [s], x, y, z [m], qw, qx, qy, qz.

    Raises:
        ConfigError: it holds no body, or states what is not read here.
        ValueError: it is no such file.
    """
    with open_text(path) as text:
        stated, head = _read_qtm_head(text)
        included = stated.get("DATA_INCLUDED", "6D") == "6D"
        _expect(path, "DATA_INCLUDED", stated, included, "6D")
        bodies: dict[str, dict[str, int]] = {}
        at: dict[str, int] = {}
        for k, name in enumerate(head):
            if name.endswith(" X"):
                at = bodies.setdefault(name[:-2], {})
                at["X"] = k
            elif at:
                at.setdefault(name, k)
        wanted = ("X", "Y", "Z", *(f"Rot[{k}]" for k in range(9)))
        whole = {name: at for name, at in bodies.items() if set(wanted) <= set(at)}
        if not whole:
            raise ConfigError("FILE", notice("import.no_body", found=list_few(head)), str(path))
        frequency = _number(stated.get("FREQUENCY", "").replace(",", "."))
        if "Time" not in head and not frequency > 0.0:
            _expect(path, "FREQUENCY", stated, False, "the frames per second, or a column Time")
        rows = _read_numbers(
            (line.replace(",", ".").split("\t") for line in text if line.strip()), len(head)
        )
    if "Time" in head:
        time = rows[:, head.index("Time")]
    else:  # one row a frame, none left out
        time = (
            rows[:, head.index("Frame")] if "Frame" in head else np.arange(len(rows))
        ) / frequency
    for name, at in whole.items():
        place = 1e-3 * rows[:, [at[key] for key in "XYZ"]]
        turn = rows[:, [at[f"Rot[{k}]"] for k in range(9)]].reshape(-1, 3, 3).transpose(0, 2, 1)
        turned = np.array([_quaternion(matrix) for matrix in turn]).reshape(-1, 4)
        place[np.isnan(turned[:, 0])] = math.nan
        columns = dict(zip(("qw", "qx", "qy", "qz"), turned.T, strict=True))
        yield name, {"t": time, "x": place[:, 0], "y": place[:, 1], "z": place[:, 2], **columns}


def _read_qtm_head(text: TextIO) -> tuple[dict[str, str], list[str]]:
    """Read the lines of keys, and the head of the columns.

    Raises:
        ValueError: there is no head.
    """
    stated: dict[str, str] = {}
    for line in islice(text, LOOK_ROWS):
        cells = [cell.strip() for cell in line.rstrip("\r\n").split("\t")]
        if any(cell.endswith(" X") for cell in cells) and "Y" in cells:
            return stated, cells
        if len(cells) > 1:
            stated[cells[0]] = cells[1]
        if stated.get("DATA_INCLUDED", "6D") != "6D":
            return stated, []
    raise ValueError(notice("import.no_qtm_head"))


def _quaternion(matrix: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """Quaternion of a rotation.

    NaN where it is none: QTM writes zeros for a body that it does not see.
    """
    off = float(np.abs(matrix @ matrix.T - np.eye(3)).max())
    if not (off < UNIT_TOLERANCE and np.linalg.det(matrix) > 0.0):
        return (math.nan, math.nan, math.nan, math.nan)
    (a, b, c), (d, e, f), (g, h, i) = matrix.tolist()
    return so3.normalize(so3.from_matrix(((a, b, c), (d, e, f), (g, h, i))))


def list_few(names: Iterable[str]) -> str:
    """The first ``names``, in their order, for the operator."""
    some = list(dict.fromkeys(filter(None, names)))
    return (", ".join(some[:8]) or "nothing") + (", …" if len(some) > 8 else "")
