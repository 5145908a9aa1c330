"""A course as CSV: one point a line, the first line names the columns.

    t_s, north_m, east_m, up_m [, yaw_deg] [, v_north_m_s, v_east_m_s, v_up_m_s]

Columns may stand in any order. ``down_m`` may stand for ``up_m``, as may the short names ``t``, ``x``, ``y``, ``z`` and
``vx``, ``vy``, ``vz`` for world NED: z counts down. Empty lines and lines that begin with # are left out.
"""

import csv
import math
from typing import Any

_SHORT = {
    "t": "t_s",
    "x": "north_m",
    "y": "east_m",
    "z": "down_m",
    "vx": "v_north_m_s",
    "vy": "v_east_m_s",
    "vz": "v_down_m_s",
}
_BOUNDS = {"t_s": 1e9, "yaw_deg": 36000.0}
"""Largest magnitude of a column; every other one keeps to 1000 (m, or m/s)."""
_PLACE = (("north_m",), ("east_m",), ("down_m", "up_m"))
_SPEED = (("v_north_m_s",), ("v_east_m_s",), ("v_down_m_s", "v_up_m_s"))
_KNOWN = ("t_s", *(name for axis in _PLACE for name in axis), "yaw_deg", *(name for axis in _SPEED for name in axis))
EXAMPLE = "t_s,north_m,east_m,up_m,yaw_deg"


def parsed(text: str) -> dict[str, Any]:
    """The course in ``text`` as keys of a section; world NED.

    Always ``points_ned`` [m]; where their columns are there, ``times_s`` [s], ``yaws_deg`` [deg] and
    ``velocities_ned`` [m/s].

    Raises:
        ValueError: with the line and the column, what is wrong there.
    """
    names: list[str] = []
    rows: list[dict[str, float]] = []
    reader = csv.reader(text.splitlines(), skipinitialspace=True)
    try:
        for cells in reader:
            line = reader.line_num
            if not "".join(cells).strip() or cells[0].lstrip().startswith("#"):
                continue
            if not names:
                names = _header(cells, line)
                continue
            rows.append(_row(cells, names, line))
            if "t_s" in names and len(rows) > 1 and rows[-1]["t_s"] <= rows[-2]["t_s"]:
                before, here = rows[-2]["t_s"], rows[-1]["t_s"]
                raise ValueError(f"line {line}, column t_s: expected more than {before:g}, as before it, got {here:g}")
    except csv.Error as error:
        raise ValueError(f"line {reader.line_num}: {error}") from None
    if len(rows) < 2:
        raise ValueError(f"expected a line of names, such as {EXAMPLE}, and at least two lines of numbers")
    course: dict[str, Any] = {"points_ned": [_vector(row, _PLACE) for row in rows]}
    if "t_s" in names:
        course["times_s"] = [row["t_s"] for row in rows]
    if "yaw_deg" in names:
        course["yaws_deg"] = [row["yaw_deg"] for row in rows]
    if "v_north_m_s" in names:
        course["velocities_ned"] = [_vector(row, _SPEED) for row in rows]
    return course


def with_course(table: dict[str, Any], text: str, *columns: str) -> dict[str, Any]:
    """The section ``table`` with the course in ``text``, of which it takes the keys ``columns``.

    Raises:
        ValueError: as :func:`parsed`; or the course has what the section can't use, or has itself.
    """
    course = parsed(text)
    for key in course:
        if key not in columns:
            raise ValueError(f"has {key}, which trajectory.kind = {table.get('kind')!r} can't use")
        if table.get(key) is not None:
            raise ValueError(f"has {key} too: leave out trajectory.{key}, or the file")
    return {**table, **course}


def _header(cells: list[str], line: int) -> list[str]:
    names = [_SHORT.get(cell.strip(), cell.strip()) for cell in cells]
    for cell, name in zip(cells, names, strict=True):
        if name not in _KNOWN:
            raise ValueError(f"line {line}: expected names of columns, such as {EXAMPLE}, got {cell.strip()[:40]!r}")
        if names.count(name) > 1:
            raise ValueError(f"line {line}: the column {name} stands there twice")
    moving = any(name.startswith("v_") for name in names)
    for axis in (*_PLACE, *(_SPEED if moving else ())):
        there = [name for name in axis if name in names]
        if len(there) != 1:
            problem = "only one of them" if there else "none of them is there"
            raise ValueError(f"line {line}: expected a column {' or '.join(axis)}: {problem}")
    return names


def _row(cells: list[str], names: list[str], line: int) -> dict[str, float]:
    if len(cells) != len(names):
        raise ValueError(f"line {line}: expected {len(names)} values, got {len(cells)}")
    row: dict[str, float] = {}
    for cell, name in zip(cells, names, strict=True):
        bound = _BOUNDS.get(name, 1000.0)
        try:
            value = float(cell)
        except ValueError:
            value = math.nan
        if not abs(value) <= bound:
            got = cell.strip()[:40]
            raise ValueError(f"line {line}, column {name}: expected a number from -{bound:g} to {bound:g}, got {got!r}")
        row[name] = value
    return row


def _vector(row: dict[str, float], axes: tuple[tuple[str, ...], ...]) -> list[float]:
    """The vector in NED, whichever way the column counts."""
    north, east = row[axes[0][0]], row[axes[1][0]]
    down, up = axes[2]
    return [north, east, row[down] if down in row else 0.0 - row[up]]
