"""Waypoints: smooth ways through given points, sparse or dense, from a configuration or a CSV file.

From rest at the first, through all of them, to rest at the last, by the polynomials of
:mod:`groundstation.core.trajectory.splines`.

A CSV file has one waypoint a line, in columns of any order that the first line names; # begins a
comment:

    t_s, north_m, east_m, up_m [, yaw_deg] [, v_north_m_s, v_east_m_s, v_up_m_s]

``down_m`` may replace ``up_m``; ``t``, ``x``, ``y``, ``z``, ``vx``, ``vy``, ``vz`` are in world
NED: z counts down.
"""

import csv
import itertools
import math
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any, Literal

import msgspec

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
    Speed,
    Trajectory,
    Velocity,
)

if TYPE_CHECKING:
    from groundstation.core.trajectory.splines import Spline

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

    def build(self) -> "Spline":
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
def _plan(config: WaypointsConfig) -> "Spline":
    from groundstation.core.trajectory.splines import fit_waypoints  # which loads numpy

    points = config.points_ned[:1] + config.points_ned[1:] * config.laps
    single = config.yaws_deg
    yaws = headings(
        None if single is None else single[:1] + single[1:] * config.laps,
        config.yaw_deg,
        len(points),
    )
    times_s = config.times_s
    if times_s is not None:
        legs = [end - start for start, end in itertools.pairwise(times_s)]
        times_s = tuple(itertools.accumulate(legs * config.laps, initial=0.0))
    return fit_waypoints(
        points,
        yaws,
        4 if config.method == "minimum_snap" else 3,
        times_s=times_s,
        max_speed=config.max_speed_m_s,
        max_acceleration=config.max_acceleration_m_s2,
    )


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
def _spline(config: SamplesConfig) -> "Spline":
    from groundstation.core.trajectory.splines import fit_samples  # which loads numpy

    yaws = headings(config.yaws_deg, config.yaw_deg, len(config.times_s))
    return fit_samples(config.times_s, config.points_ned, yaws, config.velocities_ned)
