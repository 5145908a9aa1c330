"""Drawing by characters: plots in braille dots, bars, large letters, a snapshot's numbers as styled
text. Sans-IO.
"""

import math
from collections.abc import Iterable, Mapping, Sequence

import msgspec

from groundstation.core.geometry import Vec3, euler_zyx
from groundstation.core.messages import Check, DisturbanceReading, Snapshot, Verdict
from groundstation.interfaces.tui.model import OLD_POSE_S
from links.core import LinkStatus
from links.text import printable

LABEL, NORMAL, WARNING = "$label", "", "bold $warn"
FLOWN, WANTED, ERROR, WIND = "$flown", "$wanted", "$mark", "$wind"
AXES = ("$axis-1", "$axis-2", "$axis-3")
"""Styles of three numbers that are drawn together."""

Point = tuple[float, float]
Spans = list[tuple[str, str]]
"""Pieces of one row of text, each with its style."""

# Bit of each of the 2 x 4 dots of a braille character, by [row][column].
_DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
"""Bits of Braille's dots, by row and column."""


class PlotTrack(msgspec.Struct, frozen=True):
    """One line of a top view."""

    points: Sequence[Point]
    """(north, east) [m], oldest first; a point that is not a number, or a thousand kilometres away,
    breaks the line."""
    style: str
    head: str
    """The character that marks the newest point; empty: none."""


def top_view(tracks: Sequence[PlotTrack], width: int, height: int) -> tuple[list[Spans], float]:
    """North up, east to the right, the same scale on both axes; later tracks cover earlier ones.

    Returns:
        ``height`` rows of ``width`` characters, and the size of one character's width [m].
    """
    drawable = [point for track in tracks for point in track.points if _drawable(point)]
    north, east, dot_m = _frame(drawable, 2 * width, 4 * height)

    def dot(point: Point) -> tuple[int, int]:
        return round(width + (point[1] - east) / dot_m), round(
            2 * height - (point[0] - north) / dot_m
        )

    canvas = Canvas(width, height)
    for track in tracks:
        last: tuple[int, int] | None = None
        for point in track.points:
            here = dot(point) if _drawable(point) else None
            if here is not None and here != last:  # most points of a slow flight share a dot
                canvas.line(here if last is None else last, here, track.style)
            last = here
    for track in tracks:
        if track.head and track.points and _drawable(track.points[-1]):
            canvas.mark(dot(track.points[-1]), track.head, f"bold {track.style}")
    return canvas.rows(), 2.0 * dot_m


class Canvas:
    """Braille dots: two across and four down in each character; (0, 0) is at the top left."""

    def __init__(self, width: int, height: int) -> None:
        self._width, self._height = width, height
        self._bits = [[0] * width for _ in range(height)]
        self._cells = [[("", "")] * width for _ in range(height)]

    def line(self, start: tuple[int, int], end: tuple[int, int], style: str) -> None:
        """A line of dots; what lies outside is not drawn."""
        for x, y in _line(start, end):
            if 0 <= x < 2 * self._width and 0 <= y < 4 * self._height:
                self._bits[y // 4][x // 2] |= _DOTS[y % 4][x % 2]
                self._cells[y // 4][x // 2] = ("", style)

    def mark(self, dot: tuple[int, int], letter: str, style: str) -> None:
        """One character in the place of the dots around ``dot``."""
        x, y = dot
        if 0 <= x < 2 * self._width and 0 <= y < 4 * self._height:
            self._cells[y // 4][x // 2] = (letter, style)

    def rows(self) -> list[Spans]:
        """Return the drawn rows."""
        return [
            _join_spans(
                [
                    (mark or chr(0x2800 + bit), style)
                    for (mark, style), bit in zip(marks, bits, strict=True)
                ]
            )
            for marks, bits in zip(self._cells, self._bits, strict=True)
        ]


class PlotLine(msgspec.Struct, frozen=True):
    """One line of a plot in time."""

    values: Sequence[float]
    """One for each instant, oldest first; one that is not finite breaks the line."""
    style: str


def in_time(
    lines: Sequence[PlotLine], width: int, height: int, least: float
) -> tuple[list[Spans], float, float]:
    """Lines that share their axes: the newest value at the right, one column of dots for each.

    Returns:
        ``height`` rows of ``width`` characters, and the values at bottom and top; at least
        ``least`` lies between them.
    """
    shown = [line.values[-2 * width :] for line in lines]
    known = [value for values in shown for value in values if abs(value) < 1e9]
    low, high = (min(known), max(known)) if known else (0.0, 0.0)
    step = nice_top(((high - low) / 6.0,), least / 6.0)
    low, high = step * math.floor(low / step + 1e-6), step * math.ceil(high / step - 1e-6)
    if high <= low:
        high = low + 2.0 * step
    canvas = Canvas(width, height)
    for line, values in zip(lines, shown, strict=True):
        last: tuple[int, int] | None = None
        for i, value in enumerate(values):
            here = None
            if abs(value) < 1e9:
                share = (value - low) / (high - low)
                here = (2 * width - len(values) + i, round((4 * height - 1) * (1.0 - share)))
                canvas.line(here if last is None else last, here, line.style)
            last = here
    return canvas.rows(), low, high


def _frame(points: Sequence[Point], width: int, height: int) -> tuple[float, float, float]:
    """Centre (north, east) [m] and size of a dot [m] for all ``points`` to fit.

    In steps, so that it seldom moves.
    """
    if not points or width < 8 or height < 8:
        return 0.0, 0.0, 0.1
    (south, north), (west, east) = (
        (min(axis), max(axis))
        for axis in ([point[0] for point in points], [point[1] for point in points])
    )
    least = max((north - south) / (height - 6), (east - west) / (width - 6), 0.005)
    decade = 10.0 ** math.floor(math.log10(least))
    size = next(
        step * decade
        for step in (1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0)
        if step * decade >= least * 0.999
    )
    grid = 4.0 * size
    return (
        grid * round((north + south) / 2.0 / grid),
        grid * round((east + west) / 2.0 / grid),
        size,
    )


def _line(start: tuple[int, int], end: tuple[int, int]) -> Iterable[tuple[int, int]]:
    (x0, y0), (x1, y1) = start, end
    steps = min(max(abs(x1 - x0), abs(y1 - y0)), 1000)
    for i in range(steps + 1):
        part = i / steps if steps else 0.0
        yield round(x0 + part * (x1 - x0)), round(y0 + part * (y1 - y0))


def nice_top(values: Iterable[float], least: float) -> float:
    """The smallest of 1, 2, 5 times a power of ten above all finite values, at least ``least``."""
    largest = max((value for value in values if math.isfinite(value)), default=0.0)
    largest = max(largest, least)
    decade = 10.0 ** math.floor(math.log10(largest))
    return next(step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= largest * 0.999)


def bar(value: float, limit: float, width: int) -> str:
    """``value`` from 0 to ``limit`` as a bar of ``width`` characters."""
    cells = _cells(value, limit, width)
    return "█" * cells + "░" * (width - cells)


def two_sided_bar(value: float, limit: float, half: int) -> str:
    """``value`` within ±``limit`` as a bar of ``half`` characters either side of zero."""
    cells = _cells(abs(value), limit, half)
    left, right = (cells, 0) if value < 0.0 else (0, cells)
    return "░" * (half - left) + "█" * left + "│" + "█" * right + "░" * (half - right)


def _cells(value: float, limit: float, width: int) -> int:
    share = value / limit if limit > 0.0 else 0.0
    return round(width * max(0.0, min(1.0, share))) if math.isfinite(share) else 0


def _drawable(point: Point) -> bool:
    return abs(point[0]) < 1e6 and abs(point[1]) < 1e6  # false for NaN


def _join_spans(cells: Sequence[tuple[str, str]]) -> Spans:
    """Neighbours of one style as one piece."""
    spans: Spans = []
    for text, style in cells:
        if spans and spans[-1][1] == style:
            spans[-1] = (spans[-1][0] + text, style)
        else:
            spans.append((text, style))
    return spans


# Five rows of pixels each; two pixels make one half-block character.
_GLYPHS = {
    "A": ".#. #.# ### #.# #.#",
    "B": "##. #.# ##. #.# ##.",
    "C": ".## #.. #.. #.. .##",
    "D": "##. #.# #.# #.# ##.",
    "E": "### #.. ##. #.. ###",
    "F": "### #.. ##. #.. #..",
    "G": ".### #... #.## #..# .###",
    "H": "#.# #.# ### #.# #.#",
    "I": "# # # # #",
    "J": "..# ..# ..# #.# .#.",
    "K": "#.# #.# ##. #.# #.#",
    "L": "#.. #.. #.. #.. ###",
    "M": "#...# ##.## #.#.# #...# #...#",
    "N": "#..# ##.# #.## #..# #..#",
    "O": ".#. #.# #.# #.# .#.",
    "P": "##. #.# ##. #.. #..",
    "Q": ".##. #..# #..# #.## .###",
    "R": "##. #.# ##. #.# #.#",
    "S": ".## #.. .#. ..# ##.",
    "T": "### .#. .#. .#. .#.",
    "U": "#.# #.# #.# #.# ###",
    "V": "#.# #.# #.# #.# .#.",
    "W": "#...# #...# #.#.# ##.## #...#",
    "X": "#.# #.# .#. #.# #.#",
    "Y": "#.# #.# .#. .#. .#.",
    "Z": "### ..# .#. #.. ###",
    "0": ".#. #.# #.# #.# .#.",
    "1": ".# ## .# .# .#",
    "2": "##. ..# .#. #.. ###",
    "3": "##. ..# .#. ..# ##.",
    "4": "#.# #.# ### ..# ..#",
    "5": "### #.. ##. ..# ##.",
    "6": ".## #.. ##. #.# .#.",
    "7": "### ..# .#. .#. .#.",
    "8": ".#. #.# .#. #.# .#.",
    "9": ".#. #.# .## ..# ##.",
    " ": ".. .. .. .. ..",
    "-": "... ... ### ... ...",
    "?": "##. ..# .#. ... .#.",
}
_HALF = {("#", "#"): "█", ("#", "."): "▀", (".", "#"): "▄", (".", "."): " "}


def big(text: str) -> tuple[str, str, str]:
    """``text`` as three rows of half blocks.

    A character without a glyph becomes a question mark.
    """
    pixels = [*_pixels(text), "." * len(_pixels(text)[0])]
    top, middle, bottom = (
        "".join(_HALF[pair] for pair in zip(*pixels[i : i + 2], strict=True)) for i in (0, 2, 4)
    )
    return top, middle, bottom


def huge(text: str) -> tuple[str, ...]:
    """``text`` as five rows, twice as wide."""
    return tuple(row.replace("#", "██").replace(".", "  ") for row in _pixels(text))


def _pixels(text: str) -> list[str]:
    glyphs = [_GLYPHS.get(letter, _GLYPHS["?"]).split() for letter in text.upper()]
    return [".".join(glyph[row] for glyph in glyphs) for row in range(5)]


SMALL = 0.02
"""A smaller part of a vector has no arrow [m/s²]."""


def number_rows(snapshot: Snapshot) -> list[Spans]:
    """Position, attitude, thrust, certificate, pose, link, battery, disturbance and rates, the most
    important first.
    """
    roll, pitch, yaw = (math.degrees(angle) for angle in euler_zyx(snapshot.attitude))
    seen = snapshot.pose_id >= 0  # before the first pose place and attitude are zeros
    return [
        [("            north     east   height", LABEL)],
        row("position", f"{_place(snapshot.position_ned, snapshot.floor_z_m)} m" if seen else "-"),
        row(
            "reference", f"{_place(snapshot.reference_ned, snapshot.floor_z_m)} m" if seen else "-"
        ),
        row(
            "error",
            f"{_centimetres(snapshot.error_m)}   rms {_centimetres(snapshot.rms_m or math.nan)}",
        ),
        row("attitude", f"roll {roll:+.1f} pitch {pitch:+.1f} yaw {yaw:+.1f}°" if seen else "-"),
        _thrust(snapshot),
        _certificate(snapshot),
        _pose(snapshot),
        *_link(snapshot),
        *_disturbance(snapshot),
        *_rates(snapshot),
    ]


def _thrust(snapshot: Snapshot) -> Spans:
    full = not snapshot.thrust_n < 0.98 * snapshot.thrust_max_n
    return [
        ("thrust    ", LABEL),
        (bar(snapshot.thrust_n, snapshot.thrust_max_n, 17), WARNING if full else FLOWN),
        (f" {snapshot.thrust_n:5.2f} /{snapshot.thrust_max_n:.2f} N", NORMAL),
        ("!" if full else " ", WARNING),
    ]


def _rates(snapshot: Snapshot) -> list[Spans]:
    rows = []
    names, limits = ("rate roll", "pitch", "yaw"), snapshot.rate_limits_rad_s or (math.inf,) * 3
    for name, *radians in zip(names, snapshot.rates_rad_s, limits, strict=True):
        rate, limit = map(math.degrees, radians)
        full = not abs(rate) < 0.98 * limit
        told = f" /{limit:.0f} °/s" if limit < math.inf else " °/s"
        rows.append(
            [
                (f"{name:>9}", LABEL),
                (" " + two_sided_bar(rate, limit, 8), WARNING if full else FLOWN),
                (f" {rate:+5.0f}{told}", NORMAL),
                ("!" if full else " ", WARNING),
            ]
        )
    return rows


def _disturbance(snapshot: Snapshot) -> list[Spans]:
    found = snapshot.disturbance
    if found is None:
        return [row("disturbed", "not known before the first hold")]
    return [
        row("disturbed", f"{three(found.ned_m_s2)} m/s² {arrow(found.ned_m_s2)}", WIND),
        row("wind down", _split(found)),
    ]


def _split(found: DisturbanceReading) -> str:
    """Wind and thrust scale with their 95 % intervals, as short as the column."""
    if found.wind_down_error_m_s2 is None or found.thrust_scale_error is None:
        return "intervals not recorded"
    wind = f"{found.wind_down_m_s2:+z.2f} ±{found.wind_down_error_m_s2:.2f}"
    return (
        f"{wind}  thrust {100.0 * found.thrust_scale:.0f} ±{100.0 * found.thrust_scale_error:.0f} %"
    )


def arrow(vector_ned: Vec3) -> str:
    """Where a vector points: across as seen from above, north up, and then up or down.

    A dot where it is small.
    """
    north, east, down = vector_ned
    across = math.hypot(north, east)
    if not across < math.inf or not abs(down) < math.inf:
        return "?"
    flat = (
        "·" if across < SMALL else "↑↗→↘↓↙←↖"[round(math.atan2(east, north) / (math.pi / 4.0)) % 8]
    )
    return flat + ("" if abs(down) < SMALL else "▼" if down > 0.0 else "▲")


def _certificate(snapshot: Snapshot) -> Spans:
    seen = snapshot.certificate
    if seen is None:
        return row("V", "-")
    bad = seen.state == "violated"
    text = f"{seen.v:.3g}  {printable(seen.state)}{'!' if bad else ''}"
    if bad and seen.excess > 0.0:  # for a moment it may be above its bound where it holds
        text += f" by {seen.excess:.2g}"
    if seen.b_hat_fraction is not None:
        text += f"  b̂ {100.0 * seen.b_hat_fraction:.0f} %"
    return row("V", text, WARNING if bad else NORMAL)


def _pose(snapshot: Snapshot) -> Spans:
    if snapshot.pose_id < 0:
        return row("pose", fit(["none yet", *_drops(snapshot.poses_dropped)]), WARNING)
    old = not snapshot.pose_age_s < OLD_POSE_S
    age = (
        f"{snapshot.pose_age_s:.1f} s"
        if snapshot.pose_age_s >= 1.0
        else f"{1e3 * snapshot.pose_age_s:.0f} ms"
    )
    told = [
        f"age {age}{'!' if old else ''}",
        f"{snapshot.pose_rate_hz:.0f} Hz",
        *_drops(snapshot.poses_dropped),
    ]
    return row("pose", fit(told), WARNING if old else NORMAL)


def _link(snapshot: Snapshot) -> list[Spans]:
    link = snapshot.link
    lost = link.state == "lost"
    drops, *reason = _drops(link.dropped)
    told = [f"{printable(link.state)}{'!' if lost else ''}", drops]
    told += [f"expired {link.expired}"] if link.expired else []
    return [
        row("link", fit([*told, f"sent {link.sent}", *reason]), WARNING if lost else NORMAL),
        row("battery", battery(link)),
        row("", printable(link.text) or "-", LABEL),
    ]


def battery(link: LinkStatus) -> str:
    """Voltage and charge of the vehicle's battery, and how long a round trip to it takes."""
    told = [f"{link.battery_v:.2f} V"] if link.battery_v is not None else []
    told += [f"{100.0 * link.battery_share:.0f} %"] if link.battery_share is not None else []
    told = told or ["not told"]
    return fit(told if link.rtt_s is None else [*told, f"round trip {1e3 * link.rtt_s:.1f} ms"])


def _drops(dropped: Mapping[str, int]) -> list[str]:
    """The total, and the commonest reason."""
    if not any(dropped.values()):
        return ["drops 0"]
    reason = max(dropped, key=lambda name: dropped[name])
    return [f"drops {sum(dropped.values())}", printable(reason)]


ROOM = 35
"""Room behind a row's label beside the plots [columns]."""


def fit(told: Sequence[str]) -> str:
    """Join the pieces that fit, the most important first: one that would be cut off is left out."""
    text = ""
    for piece in told:
        longer = f"{text}  {piece}" if text else piece
        text = longer if len(longer) <= ROOM else text
    return text


def row(label: str, text: str, style: str = NORMAL) -> Spans:
    """A name, and what is told of it."""
    return [(f"{label}{' ' * (10 - _width(label))}", LABEL), (text, style)]


def _width(label: str) -> int:
    return sum(1 for letter in label if letter != "\u0302")  # the hat of b̂ stands above its letter


def _place(position_ned: Vec3, floor_z_m: float) -> str:
    """North, east, and the height above the floor."""
    north, east, down = position_ned
    return f"{north:+7.3f}  {east:+7.3f}  {floor_z_m - down:+7.3f}"


def three(vector: Vec3) -> str:
    """Three numbers in columns."""
    return "  ".join(f"{component:+7.3f}" for component in vector)


def _centimetres(metres: float) -> str:
    return f"{100.0 * metres:.1f} cm" if math.isfinite(metres) else "-"


def flight_time(time_s: float) -> str:
    """Write the time on the trajectory [s], or until it begins."""
    return f"{time_s:.1f} s" if time_s >= 0.0 else f"trajectory in {-time_s:.1f} s"


def check_rows(made: Sequence[Check]) -> list[Spans]:
    """The pre-flight list, what stands in the way first."""
    if not made:
        return [
            [
                (
                    "no pre-flight checks yet: they need link and poses; a start in the air has "
                    "none",
                    LABEL,
                )
            ]
        ]
    order = (Verdict.FAIL, Verdict.WARN, Verdict.PASS, Verdict.OFF)
    rows: list[Spans] = [[("─ before take-off ", LABEL)]]
    for check in sorted(made, key=lambda one: order.index(one.verdict)):
        bad = check.verdict in (Verdict.FAIL, Verdict.WARN)
        mark = {Verdict.FAIL: "✗", Verdict.WARN: "!", Verdict.PASS: "✓", Verdict.OFF: "-"}[
            check.verdict
        ]
        style = "bold $bad reverse" if check.verdict is Verdict.FAIL else WARNING if bad else NORMAL
        rows.append(
            [
                (f"{mark} {check.verdict:4} ", style),
                (f"{printable(check.name)}: ", style if bad else NORMAL),
            ]
        )
        rows[-1].append((printable(check.says), style if bad else LABEL))
    return rows
