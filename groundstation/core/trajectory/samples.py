"""Samples: a motion given densely in time, such as one computed or recorded elsewhere.

Between the samples fly polynomials of degree 7 with the least snap: C⁶, or C⁵ where velocities are given too. They go
through every sample exactly: what is noise in the file is flown as well. At both ends it moves as the file does, unless
``ramp_s`` brings it up from rest and back to rest; the way is then the same, only its time is stretched at the ends.
"""

from functools import lru_cache
from typing import Annotated, Any

import msgspec

from groundstation.config import FromFile
from groundstation.core.trajectory.paced import Paced
from groundstation.core.trajectory.port import Degrees, Moment, Point, Ramp, Trajectory
from groundstation.core.trajectory.spline import Spline, smoothest
from groundstation.core.trajectory.waypoints import check_lists, headings, with_course

MAX_SAMPLES = 50_000


class SamplesConfig(
    FromFile, msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="samples"
):
    """A motion given densely in time."""

    file: str | None = None
    """CSV of the samples, beside the configuration; they then stand here."""
    times_s: Annotated[tuple[Moment, ...], msgspec.Meta(min_length=2, max_length=MAX_SAMPLES)]
    """When each was [s], from the first on."""
    points_ned: tuple[Point, ...]
    """The positions [m], world NED; 1 m up is -1 in the third place."""
    velocities_ned: tuple[Point, ...] | None = None
    """The velocities [m/s], world NED, where they are known."""
    yaws_deg: tuple[Annotated[float, msgspec.Meta(ge=-36000.0, le=36000.0)], ...] | None = None
    """The headings [deg], from north towards east; it turns the shorter way."""
    yaw_deg: Degrees = 0.0
    """Heading where ``yaws_deg`` is not given [deg]; it stays."""
    ramp_s: Ramp = 0.0
    """From rest to the samples' own speed in this time, and back at the end [s]; 0: as they begin and end."""

    def __post_init__(self) -> None:
        """Check what the types cannot.

        Raises:
            ValueError: the lists don't fit each other, times don't rise, or the ramps are longer than all of it.
        """
        if self.file is not None:
            raise ValueError(
                "file: only a configuration can name one: read it with groundstation.config.loader.from_dict"
            )
        check_lists(self.points_ned, self.times_s, velocities_ned=self.velocities_ned, yaws_deg=self.yaws_deg)
        length = self.times_s[-1] - self.times_s[0]
        if self.ramp_s > length:
            raise ValueError(f"ramp_s: expected at most {length:.3g} s, the time of all samples, got {self.ramp_s:g}")

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
    import numpy as np

    times = np.array(config.times_s)
    known = np.full((len(times), 4, 4), np.nan)
    known[:, 0, :3] = config.points_ned
    known[:, 0, 3] = headings(config.yaws_deg, config.yaw_deg, len(times))
    if config.velocities_ned is not None:
        known[:, 1, :3] = config.velocities_ned
    places = smoothest(times, known[:, :, :3], 4)
    yaws = smoothest(times, known[:, :, 3:], 4)
    return Spline(times, np.concatenate([places, yaws], axis=2))
