"""Waypoints: from rest at the first, through all of them, to rest at the last, as smoothly as can be.

Between them fly polynomials of degree 7 with the least snap (C⁶ at every waypoint), or of degree 5 with the least jerk
(C⁴; jerk steps at both ends). Times are given, or found from limits of speed and acceleration (timing.py).
"""

import math
from functools import lru_cache
from typing import Annotated, Any, Literal

import msgspec

from groundstation.config.schema import FromFile
from groundstation.core.geometry.ops import Vec3
from groundstation.core.trajectory.course_csv import with_course
from groundstation.core.trajectory.fields import Acceleration, Degrees, Moment, Point, Speed
from groundstation.core.trajectory.spline import Spline, smoothest
from groundstation.core.trajectory.timing import allocated

MAX_POINTS = 2000
"""Waypoints of all laps together."""


class WaypointsConfig(
    FromFile, msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="waypoints"
):
    """A course through points, from rest to rest."""

    file: str | None = None
    """CSV of the waypoints, beside the configuration; they then stand here."""
    points_ned: Annotated[tuple[Point, ...], msgspec.Meta(min_length=2, max_length=MAX_POINTS)]
    """The points [m], world NED; 1 m up is -1 in the third place."""
    times_s: tuple[Moment, ...] | None = None
    """When to be at each [s], from the first on; without them the limits below say."""
    yaws_deg: tuple[Annotated[float, msgspec.Meta(ge=-36000.0, le=36000.0)], ...] | None = None
    """Heading at each [deg], from north towards east; it turns the shorter way."""
    yaw_deg: Degrees = 0.0
    """Heading where ``yaws_deg`` is not given [deg]; it stays."""
    method: Literal["minimum_snap", "quintic"] = "minimum_snap"
    """Polynomials of degree 7 and least snap, or of degree 5 and least jerk."""
    max_speed_m_s: Speed = 0.5
    """Never faster than this, where no times are given [m/s]."""
    max_acceleration_m_s2: Acceleration = 1.0
    """Never more acceleration than this, where no times are given [m/s²]."""
    laps: Annotated[int, msgspec.Meta(ge=1, le=MAX_POINTS)] = 1
    """How often the course is flown without a stop; for more than once it must end where it began."""

    def __post_init__(self) -> None:
        """Check what the types cannot.

        Raises:
            ValueError: the lists don't fit each other, times don't rise, or two points are the same.
        """
        if self.file is not None:
            raise ValueError(
                "file: only a configuration can name one: read it with groundstation.config.load.from_dict"
            )
        check_lists(self.points_ned, self.times_s, yaws_deg=self.yaws_deg)
        if self.times_s is None:
            for i, (a, b) in enumerate(zip(self.points_ned, self.points_ned[1:], strict=False), start=1):
                if math.dist(a, b) < 1e-6:
                    raise ValueError(f"points_ned[{i}]: the same as the one before; leave it out, or give times_s")
        if self.laps > 1 and math.dist(self.points_ned[0], self.points_ned[-1]) > 1e-9:
            raise ValueError("laps: the last point must be the first one again")
        if self.laps * len(self.points_ned) > MAX_POINTS:
            raise ValueError(f"laps: at most {MAX_POINTS} points in all")

    @classmethod
    def with_text(cls, table: dict[str, Any], text: str) -> dict[str, Any]:
        """The section with the waypoints of a CSV file."""
        return with_course(table, text, "points_ned", "times_s", "yaws_deg")

    def build(self) -> Spline:
        """The trajectory of this config."""
        return _planned(self)


def check_lists(points: tuple[Vec3, ...], times_s: tuple[float, ...] | None, **lists: tuple[Any, ...] | None) -> None:
    """Check that ``times_s`` rise and that there is one of everything for each point.

    Raises:
        ValueError: what is wrong, beginning with its key.
    """
    for key, values in {"times_s": times_s, **lists}.items():
        if values is not None and len(values) != len(points):
            raise ValueError(f"{key}: expected one for each of the {len(points)} points, got {len(values)}")
    for i, (before, here) in enumerate(zip(times_s or (), (times_s or ())[1:], strict=False), start=1):
        if here - before < 1e-3:
            raise ValueError(f"times_s[{i}]: expected at least 1 ms after {before:g}, the one before it, got {here:g}")


def headings(yaws_deg: tuple[float, ...] | None, yaw_deg: float, count: int) -> list[float]:
    """The heading at each of ``count`` points [rad], each the shorter way from the one before."""
    if yaws_deg is None:
        return [math.radians(yaw_deg)] * count
    turned = [math.radians(yaws_deg[0])]
    for yaw in yaws_deg[1:]:
        turned.append(turned[-1] + math.remainder(math.radians(yaw) - turned[-1], math.tau))
    return turned


@lru_cache(maxsize=4)
def _planned(config: WaypointsConfig) -> Spline:
    import numpy as np

    points = np.array(config.points_ned[:1] + config.points_ned[1:] * config.laps)
    single = config.yaws_deg
    yaws = headings(None if single is None else single[:1] + single[1:] * config.laps, config.yaw_deg, len(points))
    order = 4 if config.method == "minimum_snap" else 3
    known = np.full((len(points), order, 4), np.nan)
    known[:, 0, :3] = points
    known[:, 0, 3] = yaws
    known[0, 1:] = known[-1, 1:] = 0.0
    if config.times_s is None:
        times = allocated(known, order, config.max_speed_m_s, config.max_acceleration_m_s2)
    else:
        legs = np.tile(np.diff(np.array(config.times_s)), config.laps)
        times = np.concatenate([[0.0], np.cumsum(legs)])
    return Spline(times, smoothest(times, known, order))
