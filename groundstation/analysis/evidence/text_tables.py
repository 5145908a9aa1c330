"""Tables in text files: CSV of any layout, by its mapping."""

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

from groundstation.config import ConfigError
from groundstation.core.messages import notice

Column: TypeAlias = NDArray[np.float64]
Table: TypeAlias = Mapping[str, Column]

LOOK_ROWS = 100
"""The head is looked for in so many lines."""
SEPARATORS = ";\t, "
GZIP_BEGIN = b"\x1f\x8b"
"""First bytes of a file packed by gzip."""


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
        while head and not head[-1]:
            head.pop()  # a separator at the end
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
            raise ConfigError("FILE", notice("import.same_names", name=twice[0]), str(path))
        return separator, names, lines[k + 1 :]
    problem = notice("import.no_head", rows=len(lines), names=", ".join(times))
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


def _names(line: str, separator: str) -> list[str]:
    return [cell.strip() for cell in next(_split([line.lstrip("#")], separator), [])]


def _split(lines: Iterable[str], separator: str) -> Iterator[list[str]]:
    if separator == " ":
        return (line.split() for line in lines)
    return csv.reader(lines, delimiter=separator, skipinitialspace=True)


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return math.nan


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


def list_few(names: Iterable[str]) -> str:
    """The first ``names``, in their order, for the operator."""
    some = list(dict.fromkeys(filter(None, names)))
    return (", ".join(some[:8]) or "nothing") + (", …" if len(some) > 8 else "")
