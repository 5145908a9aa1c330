"""Plots as characters: a top view in braille dots, a history in blocks, bars with limits. Pure functions of numbers."""

import math
from collections.abc import Iterable, Sequence

import msgspec

Point = tuple[float, float]
Spans = list[tuple[str, str]]
"""Pieces of one row of text, each with its style."""

# Bit of each of the 2 x 4 dots of a braille character, by [row][column].
_DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
_EIGHTHS = " ▁▂▃▄▅▆▇█"


class Track(msgspec.Struct, frozen=True):
    """One line of a top view."""

    points: Sequence[Point]
    """(north, east) [m], oldest first; a point that is not a number, or a thousand kilometres away, breaks the line."""
    style: str
    head: str
    """The character that marks the newest point."""


def top_view(tracks: Sequence[Track], width: int, height: int) -> tuple[list[Spans], float]:
    """North up, east to the right, the same scale on both axes; later tracks cover earlier ones.

    Returns:
        ``height`` rows of ``width`` characters, and the size of one character's width [m].
    """
    drawable = [point for track in tracks for point in track.points if _drawable(point)]
    north, east, dot_m = _frame(drawable, 2 * width, 4 * height)

    def dot(point: Point) -> tuple[int, int]:
        return round(width + (point[1] - east) / dot_m), round(2 * height - (point[0] - north) / dot_m)

    bits = [[0] * width for _ in range(height)]
    cells = [[("", "")] * width for _ in range(height)]
    for track in tracks:
        last: Point | None = None
        for point in track.points:
            here = point if _drawable(point) else None
            if here is not None:
                for x, y in _line(dot(here if last is None else last), dot(here)):
                    if 0 <= x < 2 * width and 0 <= y < 4 * height:
                        bits[y // 4][x // 2] |= _DOTS[y % 4][x % 2]
                        cells[y // 4][x // 2] = ("", track.style)
            last = here
    for track in tracks:
        if track.points and _drawable(track.points[-1]):
            x, y = dot(track.points[-1])
            if 0 <= x < 2 * width and 0 <= y < 4 * height:
                cells[y // 4][x // 2] = (track.head, f"bold {track.style}")
    rows = []
    for marks, row_bits in zip(cells, bits, strict=True):
        row = [(mark or chr(0x2800 + bit), style) for (mark, style), bit in zip(marks, row_bits, strict=True)]
        rows.append(_joined(row))
    return rows, 2.0 * dot_m


def _frame(points: Sequence[Point], width: int, height: int) -> tuple[float, float, float]:
    """Centre (north, east) [m] and size of a dot [m] for all ``points`` to fit; in steps, so that it seldom moves."""
    if not points or width < 8 or height < 8:
        return 0.0, 0.0, 0.1
    (south, north), (west, east) = (
        (min(axis), max(axis)) for axis in ([point[0] for point in points], [point[1] for point in points])
    )
    least = max((north - south) / (height - 6), (east - west) / (width - 6), 0.005)
    decade = 10.0 ** math.floor(math.log10(least))
    size = next(step * decade for step in (1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0) if step * decade >= least * 0.999)
    grid = 4.0 * size
    return grid * round((north + south) / 2.0 / grid), grid * round((east + west) / 2.0 / grid), size


def _line(start: tuple[int, int], end: tuple[int, int]) -> Iterable[tuple[int, int]]:
    (x0, y0), (x1, y1) = start, end
    steps = min(max(abs(x1 - x0), abs(y1 - y0)), 1000)
    for i in range(steps + 1):
        part = i / steps if steps else 0.0
        yield round(x0 + part * (x1 - x0)), round(y0 + part * (y1 - y0))


def history(values: Sequence[float], top: float, width: int, height: int) -> list[str]:
    """The newest ``width`` values as columns of blocks, from 0 to ``top``; a value that is not finite leaves a gap."""
    full = 8 * height
    levels = []
    for value in values[-width:]:
        share = value / top if top > 0.0 else 0.0
        levels.append(max(1, min(full, round(full * share))) if math.isfinite(share) else 0)
    levels = [0] * (width - len(levels)) + levels
    return ["".join(_EIGHTHS[max(0, min(8, level - 8 * row))] for level in levels) for row in reversed(range(height))]


def nice_top(values: Iterable[float], least: float) -> float:
    """The smallest of 1, 2, 5 times a power of ten that no finite value exceeds, at least ``least``."""
    largest = max((value for value in values if math.isfinite(value)), default=0.0)
    largest = max(largest, least)
    decade = 10.0 ** math.floor(math.log10(largest))
    return next(step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= largest * 0.999)


def bar(value: float, limit: float, width: int) -> str:
    """``value`` from 0 to ``limit`` as a bar of ``width`` characters."""
    cells = _cells(value, limit, width)
    return "█" * cells + "░" * (width - cells)


def two_sided_bar(value: float, limit: float, half: int) -> str:
    """``value`` from -``limit`` to ``limit`` as a bar of ``half`` characters to either side of its zero."""
    cells = _cells(abs(value), limit, half)
    left, right = (cells, 0) if value < 0.0 else (0, cells)
    return "░" * (half - left) + "█" * left + "│" + "█" * right + "░" * (half - right)


def _cells(value: float, limit: float, width: int) -> int:
    share = value / limit if limit > 0.0 else 0.0
    return round(width * max(0.0, min(1.0, share))) if math.isfinite(share) else 0


def _drawable(point: Point) -> bool:
    return abs(point[0]) < 1e6 and abs(point[1]) < 1e6  # false for NaN


def _joined(cells: Sequence[tuple[str, str]]) -> Spans:
    """Neighbours of one style as one piece."""
    spans: Spans = []
    for text, style in cells:
        if spans and spans[-1][1] == style:
            spans[-1] = (spans[-1][0] + text, style)
        else:
            spans.append((text, style))
    return spans
