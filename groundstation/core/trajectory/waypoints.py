"""Waypoints: smooth ways through given points, sparse or dense, from a configuration or a CSV file.

From rest at the first, through all of them, to rest at the last. Between them fly polynomials of
degree 7 with the least snap (C⁶ at every waypoint), or of degree 5 with the least jerk (C⁴; jerk
steps at both ends). Times are given, or found from limits of speed and acceleration: first those of
least ∫|p^(r)|² for a given duration, by the sign of the gradient (Rprop, in the logarithm of each
leg's time). With the derivatives at the knots in d, a leg of h seconds costs E = dᵀ S H S d
h^(1-2r), S = diag(h^k), so dE/dh with d held is all of the gradient. Then each leg is moved towards
what its own speed and acceleration ask for. A course flown k times slower has a k-th of the speed
and a k²-th of the acceleration everywhere, so every round is brought within both limits exactly;
the shortest is kept.

A CSV file has one waypoint a line, in columns of any order that the first line names; # begins a
comment:

    t_s, north_m, east_m, up_m [, yaw_deg] [, v_north_m_s, v_east_m_s, v_up_m_s]

``down_m`` may replace ``up_m``; ``t``, ``x``, ``y``, ``z``, ``vx``, ``vy``, ``vz`` are in world
NED: z counts down.

The unknowns are the derivatives 1 to r-1 at the knots. A span has the polynomial p(x h) = Σ cᵢ xⁱ,
c = A⁻¹ S d, and H = A⁻ᵀ Q A⁻¹, Q = ∫₀¹ of the products of the r-th derivatives of xⁱ. Setting the
gradient to zero where a derivative is free is a block-tridiagonal system, symmetric and positive
definite, solved in one sweep forth and back. Prescribing derivatives costs smoothness there alone;
at a free end the conditions are the natural ones. Minimum snap: D. Mellinger, V. Kumar, ICRA 2011;
in the derivatives at the knots: C. Richter, A. Bry, N. Roy, ISRR 2013.
"""

import csv
import math
from bisect import bisect_right
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

import msgspec
import numpy as np

from groundstation.config import FromFile, config_notice, parse_number
from groundstation.core.geometry import FARTHEST_M, Vec3
from groundstation.core.trajectory.paced import Paced, check_ramp
from groundstation.core.trajectory.reference import (
    FASTEST_M_S,
    LATEST_S,
    SLOWEST_M_S,
    Acceleration,
    Degrees,
    Moment,
    Point,
    Ramp,
    Reference,
    Speed,
    Trajectory,
    Velocity,
    rest_there,
)
from groundstation.core.trajectory.transitions import Coefficients, differentiate, evaluate

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]

DEGREE = 7
"""Degree of all polynomials here [-]; quintics end in two zeros."""


def smoothest(times_s: "Array", known: "Array", order: int) -> "Array":
    """Coefficients of the smoothest piecewise polynomial.

    Args:
        times_s: the knots (N,), rising [s]; N >= 2.
        known: derivatives 0 to ``order`` - 1 at each knot, for several axes: (N, order, axes); nan
            where free, which must be the same for all axes. The points themselves must be given.
        order: r of this file's heading, 3 or 4.

    Returns:
        (N - 1, DEGREE + 1, axes), ascending, by the share x in 0..1 of each span.
    """
    spans = np.diff(times_s)
    unit = float(np.mean(spans))  # in units of the mean span the numbers stay near 1
    powers = (spans / unit)[:, None] ** np.arange(order)
    scale = np.concatenate([powers, powers], axis=1)
    inverse = np.linalg.inv(ends(order))
    cost = inverse.T @ roughness(order) @ inverse
    blocks = (
        scale[:, :, None]
        * cost
        * scale[:, None, :]
        * ((spans / unit) ** (1 - 2 * order))[:, None, None]
    )
    own = np.zeros((len(times_s), order, order))
    own[:-1] += blocks[:, :order, :order]
    own[1:] += blocks[:, order:, order:]
    next_ = blocks[:, :order, order:]
    units = (unit ** np.arange(order))[:, None]
    given = np.nan_to_num(known) * units
    origin = given[0, 0].copy()
    given[:, 0] -= origin  # what stays where it is stays there to the last digit
    free = np.isnan(known[:, :, 0])
    found = given + _solve(own, next_, given, free)
    both = np.concatenate([found[:-1], found[1:]], axis=1) * scale[:, :, None]
    coefficients = np.zeros((len(spans), DEGREE + 1, known.shape[2]))
    coefficients[:, : 2 * order] = inverse @ both
    coefficients[:, 0] += origin
    return coefficients


def _solve(own: "Array", next_: "Array", given: "Array", free: "npt.NDArray[np.bool_]") -> "Array":
    """Solve for the free derivatives, (N, order, axes); 0 elsewhere."""
    count, order = free.shape
    side = -(own @ given)
    side[:-1] -= next_ @ given[1:]
    side[1:] -= np.swapaxes(next_, 1, 2) @ given[:-1]
    side *= free[:, :, None]
    matrix = own * (free[:, :, None] & free[:, None, :]) + np.eye(order) * ~free[:, :, None]
    link = next_ * (free[:-1, :, None] & free[1:, None, :])
    for k in range(1, count):
        step = np.linalg.solve(matrix[k - 1], np.concatenate([link[k - 1], side[k - 1]], axis=1))
        matrix[k] -= link[k - 1].T @ step[:, :order]
        side[k] -= link[k - 1].T @ step[:, order:]
    found = np.zeros_like(given)
    found[-1] = np.linalg.solve(matrix[-1], side[-1])
    for k in range(count - 2, -1, -1):
        found[k] = np.linalg.solve(matrix[k], side[k] - link[k] @ found[k + 1])
    return found


def ends(order: int) -> "Array":
    """A: from the coefficients to the derivatives at x = 0, then at x = 1."""
    rows = np.zeros((2 * order, 2 * order))
    for k in range(order):
        rows[k, k] = math.factorial(k)
        rows[order + k, k:] = [math.perm(i, k) for i in range(k, 2 * order)]
    return rows


def roughness(order: int) -> "Array":
    """Q of this file's heading."""
    products = np.zeros((2 * order, 2 * order))
    for i in range(order, 2 * order):
        for j in range(order, 2 * order):
            products[i, j] = math.perm(i, order) * math.perm(j, order) / (i + j - 2 * order + 1)
    return products


class _Span(NamedTuple):
    start_s: float
    rate: float
    """One over its length [1/s]."""
    north: Coefficients
    east: Coefficients
    down: Coefficients
    yaw: Coefficients


class Spline:
    """Position and heading as polynomials in time, evaluated in plain floats.

    See :class:`Trajectory` for its methods.

    Before its start and after its end it is at rest at its first and its last point.
    """

    duration_s: float
    """When it ends [s]."""
    joints_s: list[float]
    """Where one polynomial meets the next [s], from 0 on."""

    def __init__(self, times_s: "Array", coefficients: "Array") -> None:
        """Take the knots (N,) [s], and coefficients (N - 1, DEGREE + 1, 4): north, east, down [m],
        heading [rad].
        """
        self.joints_s = [float(t - times_s[0]) for t in times_s]
        self.duration_s = self.joints_s[-1]
        self._spans = [
            _Span(start, 1.0 / (end - start), *(tuple(axis) for axis in span.T.tolist()))
            for start, end, span in zip(
                self.joints_s, self.joints_s[1:], coefficients, strict=False
            )
        ]
        self._start = rest_there(self._moving(0.0))
        self._end = rest_there(self._moving(self.duration_s))

    def position_at(self, time_s: float) -> Vec3:
        """Position [m], world NED."""
        if time_s < 0.0:
            return self._start.position_ned
        if time_s >= self.duration_s:
            return self._end.position_ned
        span, x = self._place(time_s)
        return (evaluate(span.north, x), evaluate(span.east, x), evaluate(span.down, x))

    def at(self, time_s: float) -> Reference:
        """The reference ``time_s`` after the start [s]."""
        if time_s < 0.0:
            return self._start
        if time_s >= self.duration_s:
            return self._end
        return self._moving(time_s)

    def _place(self, time_s: float) -> tuple[_Span, float]:
        span = self._spans[max(0, min(bisect_right(self.joints_s, time_s), len(self._spans)) - 1)]
        return span, (time_s - span.start_s) * span.rate

    def _moving(self, time_s: float) -> Reference:
        span, x = self._place(time_s)
        r1 = span.rate
        r2 = r1 * r1
        r3 = r1 * r2
        (n1, n2, n3), (e1, e2, e3), (d1, d2, d3) = (
            differentiate(axis, x) for axis in (span.north, span.east, span.down)
        )
        turning, _, _ = differentiate(span.yaw, x)
        return Reference(
            (evaluate(span.north, x), evaluate(span.east, x), evaluate(span.down, x)),
            (r1 * n1, r1 * e1, r1 * d1),
            (r2 * n2, r2 * e2, r2 * d2),
            (r3 * n3, r3 * e3, r3 * d3),
            evaluate(span.yaw, x),
            r1 * turning,
        )


_SHORT = {
    "t": "t_s",
    "x": "north_m",
    "y": "east_m",
    "z": "down_m",
    "vx": "v_north_m_s",
    "vy": "v_east_m_s",
    "vz": "v_down_m_s",
}
_PLACE = (("north_m",), ("east_m",), ("down_m", "up_m"))
_SPEED = (("v_north_m_s",), ("v_east_m_s",), ("v_down_m_s", "v_up_m_s"))
_BOUNDS = {
    "t_s": LATEST_S,
    "yaw_deg": 36000.0,
    **{name: FARTHEST_M for axis in _PLACE for name in axis},
    **{name: FASTEST_M_S for axis in _SPEED for name in axis},
}
"""Largest magnitude of each column."""
EXAMPLE = "t_s,north_m,east_m,up_m,yaw_deg"


def parse_course(text: str, least: int = 2) -> dict[str, Any]:
    """The course of at least ``least`` points in ``text`` as keys of a section; world NED.

    Always ``points_ned`` [m]; where their columns are there, ``times_s`` [s], ``yaws_deg`` [deg]
    and ``velocities_ned`` [m/s].

    Raises:
        ValueError: with the line and the column, what is wrong there.
    """
    names: list[str] = []
    rows: list[dict[str, float]] = []
    reader = csv.reader(text.removeprefix("\ufeff").splitlines(), skipinitialspace=True)
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
                raise ValueError(
                    config_notice("course.order", line=line, before_s=before, found_s=here)
                )
    except csv.Error as error:
        raise ValueError(config_notice("course.not_csv", line=reader.line_num, why=error)) from None
    if len(rows) < least:
        raise ValueError(config_notice("course.few_lines", example=EXAMPLE, least=least))
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
        ValueError: as :func:`parse_course`; or the course has what the section can't use, or has
            itself.
    """
    course = parse_course(text)
    for key in course:
        if key not in columns:
            raise ValueError(config_notice("course.unusable", key=key, kind=table.get("kind")))
        if table.get(key) is not None:
            raise ValueError(config_notice("course.both", key=key))
    return {**table, **course}


def _header(cells: list[str], line: int) -> list[str]:
    names = [_SHORT.get(cell.strip(), cell.strip()) for cell in cells]
    for cell, name in zip(cells, names, strict=True):
        if name not in _BOUNDS:
            found = cell.strip()[:40]
            raise ValueError(config_notice("course.names", line=line, example=EXAMPLE, found=found))
        if names.count(name) > 1:
            raise ValueError(config_notice("course.twice", line=line, name=name))
    moving = any(name.startswith("v_") for name in names)
    for axis in (*_PLACE, *(_SPEED if moving else ())):
        there = [name for name in axis if name in names]
        if len(there) != 1:
            id = "course.two_columns" if there else "course.no_column"
            raise ValueError(config_notice(id, line=line, names=" or ".join(axis)))
    return names


def _row(cells: list[str], names: list[str], line: int) -> dict[str, float]:
    if len(cells) != len(names):
        raise ValueError(
            config_notice("course.values", line=line, count=len(names), found=len(cells))
        )
    row: dict[str, float] = {}
    for cell, name in zip(cells, names, strict=True):
        bound = _BOUNDS[name]
        try:
            value = parse_number(cell)
        except ValueError:
            value = math.nan
        if not abs(value) <= bound:
            found = cell.strip()[:40]
            raise ValueError(
                config_notice("course.number", line=line, name=name, bound=bound, found=found)
            )
        row[name] = value
    return row


def _vector(row: dict[str, float], axes: tuple[tuple[str, ...], ...]) -> list[float]:
    """The vector in NED, whichever way the column counts."""
    north, east = row[axes[0][0]], row[axes[1][0]]
    down, up = axes[2]
    return [north, east, row[down] if down in row else 0.0 - row[up]]


SMOOTH_ROUNDS = 30
"""Iterations that make the durations smooth [-]: their steps halve where the gradient turns, 0.2 to
below 1e-4."""
LIMIT_ROUNDS = 12
"""Iterations after these that bring each leg to its own limits [-]: a step halves the distance."""
INTERVALS = 48
"""Intervals between the samples of a leg at which its peaks are searched [-]."""
MARGIN = 1.001
"""Factor on the durations for true peaks between the samples [-]: they are less than a thousandth
higher."""


def allocate_times(
    known: "Array", order: int, max_speed: float, max_acceleration: float
) -> "Array":
    """Times (N,) [s] of a short and smooth course that keeps both limits.

    Args:
        known: as :func:`smoothest` takes it; the first three axes are a place [m],
            no two in a row the same.
        order: r, 3 or 4.
        max_speed: largest speed [m/s].
        max_acceleration: largest acceleration [m/s²].
    """
    lengths = np.linalg.norm(np.diff(known[:, 0, :3], axis=0), axis=1)
    legs = lengths / max_speed + np.sqrt(lengths / max_acceleration)
    best = np.full(len(legs), np.inf)
    step, last = np.full(len(legs), 0.2), np.zeros(len(legs))
    for number in range(SMOOTH_ROUNDS + LIMIT_ROUNDS):
        coefficients = smoothest(_times(legs), known, order)[:, :, :3]
        demand = _find_demand(coefficients, legs, max_speed, max_acceleration)
        slower = legs * (MARGIN * demand.max())
        if slower.sum() < best.sum():
            best = slower
        if number < SMOOTH_ROUNDS:
            slope = _slope(coefficients, legs, order)
            again = slope * last
            step = np.clip(step * np.select([again > 0.0, again < 0.0], [1.2, 0.5], 1.0), 1e-4, 0.7)
            last = np.where(again < 0.0, 0.0, slope)
            legs = legs * np.exp(-np.sign(last) * step)
        else:
            legs = slower * (demand / demand.max()).clip(0.2) ** 0.5
    return _times(best)


def _times(legs: "Array") -> "Array":
    return np.concatenate([[0.0], np.cumsum(legs)])


def _slope(coefficients: "Array", legs: "Array", order: int) -> "Array":
    """The gradient of log(∫|p^(r)|² · duration^(2r-1)), which no pace changes, by the logarithm of
    each leg's time.
    """
    matrix = ends(order)
    inverse = np.linalg.inv(matrix)
    cost = inverse.T @ roughness(order) @ inverse
    derivatives = matrix @ coefficients[:, : 2 * order]  # S d
    powers = np.tile(np.arange(order), 2)[:, None]
    scale = legs ** (1 - 2 * order)
    energy = np.einsum("mia,ij,mja->m", derivatives, cost, derivatives) * scale
    moved = 2.0 * np.einsum("mia,ij,mja->m", powers * derivatives, cost, derivatives) * scale
    slope: Array = (moved + (1 - 2 * order) * energy) / energy.sum() + (
        2 * order - 1
    ) * legs / legs.sum()
    return slope


def _find_demand(
    coefficients: "Array", legs: "Array", max_speed: float, max_acceleration: float
) -> "Array":
    """Return the factor by which each leg must be slowed to keep both limits, (M,)."""
    x = np.linspace(0.0, 1.0, INTERVALS + 1)[:, None]
    powers = np.arange(coefficients.shape[1])
    first = powers * x ** np.maximum(powers - 1, 0)
    second = powers * (powers - 1) * x ** np.maximum(powers - 2, 0)
    speed = np.linalg.norm(first @ coefficients, axis=2).max(axis=1) / legs
    acceleration = np.linalg.norm(second @ coefficients, axis=2).max(axis=1) / (legs * legs)
    demand: Array = np.maximum(speed / max_speed, np.sqrt(acceleration / max_acceleration))
    return demand


MAX_POINTS = 2000
"""Largest number of waypoints of all laps [-]: their times are found within seconds."""


class CourseConfig(FromFile, msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Keys of every course: where its points come from, and its headings."""

    file: Annotated[
        str | None,
        msgspec.Meta(
            description="CSV of the points, beside the configuration; they are then here."
        ),
    ] = None
    yaws_deg: Annotated[
        tuple[Annotated[float, msgspec.Meta(ge=-36000.0, le=36000.0)], ...] | None,
        msgspec.Meta(
            description="Heading at each point [deg], from north towards east; it turns the "
            "shorter way."
        ),
    ] = None
    yaw_deg: Annotated[
        Degrees, msgspec.Meta(description="Heading where `yaws_deg` is not given [deg]; it stays.")
    ] = 0.0

    def __post_init__(self) -> None:
        if self.file is not None:
            raise ValueError(config_notice("file.in_python", key="file"))


class WaypointsConfig(
    CourseConfig,
    frozen=True,
    kw_only=True,
    forbid_unknown_fields=True,
    tag_field="kind",
    tag="waypoints",
):
    """A course through points, from rest to rest."""

    points_ned: Annotated[
        tuple[Point, ...],
        msgspec.Meta(
            min_length=2,
            max_length=MAX_POINTS,
            description="The points [m], world NED; 1 m up is -1 in the third place.",
        ),
    ]
    times_s: Annotated[
        tuple[Moment, ...] | None,
        msgspec.Meta(
            description="When to be at each [s], from the first on; without them the limits below "
            "say."
        ),
    ] = None
    method: Annotated[
        Literal["minimum_snap", "quintic"],
        msgspec.Meta(
            description="Polynomials of degree 7 and least snap, or of degree 5 and least jerk."
        ),
    ] = "minimum_snap"
    max_speed_m_s: Annotated[
        Speed, msgspec.Meta(description="Never faster than this, where no times are given [m/s].")
    ] = 0.5
    max_acceleration_m_s2: Annotated[
        Acceleration,
        msgspec.Meta(
            description="Never more acceleration than this, where no times are given [m/s²]."
        ),
    ] = 1.0
    laps: Annotated[
        int,
        msgspec.Meta(
            ge=1,
            le=MAX_POINTS,
            description="How often the course is flown without a stop; for more than once it must "
            "end where it began.",
        ),
    ] = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        check_lists(self.points_ned, self.times_s, yaws_deg=self.yaws_deg)
        if self.times_s is None:
            for i, (a, b) in enumerate(
                zip(self.points_ned, self.points_ned[1:], strict=False), start=1
            ):
                if math.dist(a, b) < 1e-6:
                    raise ValueError(config_notice("trajectory.same_point", index=i))
        if self.laps > 1 and math.dist(self.points_ned[0], self.points_ned[-1]) > 1e-9:
            raise ValueError(config_notice("trajectory.open"))
        if self.laps * len(self.points_ned) > MAX_POINTS:
            raise ValueError(config_notice("trajectory.points", most=MAX_POINTS))

    @classmethod
    def with_text(cls, table: dict[str, Any], text: str) -> dict[str, Any]:
        """The section with the waypoints of a CSV file."""
        return with_course(table, text, "points_ned", "times_s", "yaws_deg")

    def build(self) -> Spline:
        """The trajectory of this config."""
        return _plan(self)


STILL_M = 0.05
"""Length up to which a course stays at one place [m], so that its speed does not tell the unit of
its times."""


def check_lists(
    points: tuple[Vec3, ...], times_s: tuple[float, ...] | None, **lists: tuple[Any, ...] | None
) -> None:
    """Check that ``times_s`` rise and that there is one of everything for each point.

    Also that the course is no slower than ``SLOWEST_M_S``: then its times are in another unit.

    Raises:
        ValueError: what is wrong, beginning with its key.
    """
    for key, values in {"times_s": times_s, **lists}.items():
        if values is not None and len(values) != len(points):
            raise ValueError(
                config_notice("trajectory.lists", key=key, points=len(points), count=len(values))
            )
    for i, (before, here) in enumerate(
        zip(times_s or (), (times_s or ())[1:], strict=False), start=1
    ):
        if here - before < 1e-3:
            raise ValueError(
                config_notice("trajectory.times", index=i, before_s=before, found_s=here)
            )
    if times_s is not None:
        length_m, lasts_s = sum(map(math.dist, points, points[1:])), times_s[-1] - times_s[0]
        if length_m > STILL_M and length_m < SLOWEST_M_S * lasts_s:
            raise ValueError(
                config_notice(
                    "trajectory.unit",
                    length_m=length_m,
                    lasts_s=lasts_s,
                    slowest_mm_s=1e3 * SLOWEST_M_S,
                )
            )


def headings(yaws_deg: tuple[float, ...] | None, yaw_deg: float, count: int) -> list[float]:
    """The heading at each of ``count`` points [rad], each the shorter way from the one before."""
    if yaws_deg is None:
        return [math.radians(yaw_deg)] * count
    turned = [math.radians(yaws_deg[0])]
    for yaw in yaws_deg[1:]:
        turned.append(turned[-1] + math.remainder(math.radians(yaw) - turned[-1], math.tau))
    return turned


@lru_cache(maxsize=4)
def _plan(config: WaypointsConfig) -> Spline:
    points = np.array(config.points_ned[:1] + config.points_ned[1:] * config.laps)
    single = config.yaws_deg
    yaws = headings(
        None if single is None else single[:1] + single[1:] * config.laps,
        config.yaw_deg,
        len(points),
    )
    order = 4 if config.method == "minimum_snap" else 3
    known = np.full((len(points), order, 4), np.nan)
    known[:, 0, :3] = points
    known[:, 0, 3] = yaws
    known[0, 1:] = known[-1, 1:] = 0.0
    if config.times_s is None:
        times = allocate_times(known, order, config.max_speed_m_s, config.max_acceleration_m_s2)
    else:
        legs = np.tile(np.diff(np.array(config.times_s)), config.laps)
        times = _times(legs)
    return Spline(times, smoothest(times, known, order))


MAX_SAMPLES = 50_000
"""Largest number of samples in a file of a course [-]: 8 minutes at 100 Hz."""


class SamplesConfig(
    CourseConfig,
    frozen=True,
    kw_only=True,
    forbid_unknown_fields=True,
    tag_field="kind",
    tag="samples",
):
    """A motion given densely in time, such as one computed or recorded elsewhere.

    Between the samples fly polynomials of degree 7 with the least snap: C⁶, or C⁵ where velocities
    are given too. They go through every sample exactly: what is noise in the file is flown as well.
    At both ends it moves as the file does, unless ``ramp_s`` brings it up from rest and back to
    rest; the way is then the same, only its time is stretched at the ends.
    """

    times_s: Annotated[
        tuple[Moment, ...],
        msgspec.Meta(
            min_length=2,
            max_length=MAX_SAMPLES,
            description="When each was [s], from the first on.",
        ),
    ]
    points_ned: Annotated[
        tuple[Point, ...],
        msgspec.Meta(description="The positions [m], world NED; 1 m up is -1 in the third place."),
    ]
    velocities_ned: Annotated[
        tuple[Velocity, ...] | None,
        msgspec.Meta(description="The velocities [m/s], world NED, where they are known."),
    ] = None
    ramp_s: Annotated[
        Ramp,
        msgspec.Meta(
            description="From rest to the samples' own speed in this time, and back at the end "
            "[s]; 0: as they begin and end."
        ),
    ] = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_lists(
            self.points_ned,
            self.times_s,
            velocities_ned=self.velocities_ned,
            yaws_deg=self.yaws_deg,
        )
        check_ramp(self.ramp_s, self.times_s[-1] - self.times_s[0])

    @classmethod
    def with_text(cls, table: dict[str, Any], text: str) -> dict[str, Any]:
        """The section with the samples of a CSV file."""
        return with_course(table, text, "times_s", "points_ned", "velocities_ned", "yaws_deg")

    def build(self) -> Trajectory:
        """The trajectory of this config."""
        spline = _spline(self)
        if self.ramp_s == 0.0:
            return spline
        return Paced(spline, self.ramp_s, spline.duration_s, spline.duration_s)


@lru_cache(maxsize=4)
def _spline(config: SamplesConfig) -> Spline:
    times = np.array(config.times_s)
    known = np.full((len(times), 4, 4), np.nan)
    known[:, 0, :3] = config.points_ned
    known[:, 0, 3] = headings(config.yaws_deg, config.yaw_deg, len(times))
    if config.velocities_ned is not None:
        known[:, 1, :3] = config.velocities_ned
    places = smoothest(times, known[:, :, :3], 4)
    yaws = smoothest(times, known[:, :, 3:], 4)
    return Spline(times, np.concatenate([places, yaws], axis=2))
