"""``groundstation-sim campaign``: a scenario flown a thousand times in drawn worlds, as arrays, on all cores.

Every flight is drawn from its seed alone, and neither the size of the batches nor who flies them changes a figure
of it: this machine's processes (local.py) or a Dask cluster's workers (cluster.py).
"""

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol

import msgspec

from groundstation.config import ConfigError
from groundstation.settings import Config
from sim.batch import choose_stages, fly_batch, require_batchable
from sim.runs import STEADY_S
from sim.studies.campaign.draws import DRAWS, USUAL, absolute, draw_world
from sim.studies.campaign.folder import CampaignRow, Folder, program_sha256
from sim.world import World

BATCH = 500
"""Most flights to fly at once: more are hardly faster each, and what is interrupted is lost."""


class Campaign(msgspec.Struct, frozen=True, kw_only=True):
    """What all flights share."""

    scenario: str
    world: World
    """What the draws of :func:`sim.studies.campaign.draws.draw_world` start from."""
    config: Config
    duration_s: float
    """Of each flight, from the release [s]."""
    overrides: list[str]
    """``--set`` as given, to name the command that flies one flight again."""
    draws: tuple[str, ...] = USUAL
    """Names of what differs from flight to flight, keys of ``DRAWS``."""
    kernel: str = "auto"
    """How the flights are computed, see :func:`sim.batch.stages.choose_stages`; the rows are the same in any case."""

    def check(self) -> None:
        """Refuse what cannot be flown or would not be true.

        Raises:
            ConfigError: a controller that no batch flies, an unknown draw, a value that is drawn whatever is set,
                or too short flights.
        """
        require_batchable(self.world, self.config)
        if self.duration_s <= STEADY_S:
            raise ConfigError("--duration", f"flights are judged from {STEADY_S:g} s on, expected more than that")
        for name in self.draws:
            if name not in DRAWS:
                raise ConfigError("--draw", f"expected some of {list(DRAWS)}, got {name!r}")
        for field, draw in absolute(self.draws).items():
            if any(o.partition("=")[0].strip() == f"sim.{field}" for o in self.overrides):
                raise ConfigError(f"sim.{field}", f"a campaign draws it, from {draw.low:g} to {draw.high:g}", "--set")

    def settings(self) -> dict[str, Any]:
        """What makes two rows comparable, for ``settings.json``."""
        return {
            "scenario": self.scenario,
            "duration_s": self.duration_s,
            "drawn": {name: "; ".join(map(str, DRAWS[name])) or "directions" for name in self.draws},
            "sim": msgspec.to_builtins(self.world),
            "told": msgspec.to_builtins(self.config),
            "program_sha256": program_sha256(),
        }


class Crew(Protocol):
    """Who flies the batches."""

    @property
    def workers(self) -> int:
        """How many fly at once."""
        ...

    def fly(self, campaign: Campaign, chunks: Sequence[list[int]]) -> Iterator[list[CampaignRow]]:
        """The flights of each chunk of seeds, in any order.

        Raises:
            ConfigError: the crew cannot go on; what to do.
        """
        ...


def run(
    campaign: Campaign,
    seeds: Sequence[int],
    crew: Crew,
    *,
    out: Path | None = None,
    batch: int | None = None,
    on_progress: Callable[[int], None] = lambda done: None,
) -> tuple[list[CampaignRow], int]:
    """Let ``crew`` fly the ``seeds`` that the folder ``out`` does not hold yet, ``batch`` at a time.

    Without ``batch`` the work is shared out evenly, up to ``BATCH``. ``on_progress`` hears how many rows there are.
    Returns all rows in the order of the seeds, and how many of them were flown now.

    Raises:
        ConfigError: see :meth:`Campaign.require_batchable`, :class:`Folder` and :meth:`Crew.fly`.
    """
    campaign.check()
    folder = Folder(out, campaign.settings()) if out is not None else None
    wanted = set(seeds)
    rows = {row.seed: row for row in (folder.rows if folder is not None else []) if row.seed in wanted}
    missing = [seed for seed in seeds if seed not in rows]
    size = batch or max(1, min(BATCH, math.ceil(len(missing) / crew.workers)))
    chunks = [missing[i : i + size] for i in range(0, len(missing), size)]
    on_progress(len(rows))
    for flown in crew.fly(campaign, chunks):
        if folder is not None:
            folder.add(flown)
        rows |= {row.seed: row for row in flown}
        on_progress(len(rows))
    return [rows[seed] for seed in seeds], len(missing)


def fly_chunk(campaign: Campaign, seeds: list[int]) -> list[CampaignRow]:
    """Fly ``seeds`` as one batch."""
    worlds = [draw_world(campaign.world, seed, campaign.draws) for seed in seeds]
    stages, _ = choose_stages(campaign.kernel)
    flights = fly_batch(worlds, campaign.config, seeds, duration_s=campaign.duration_s, stages=stages)
    columns = {name: column.tolist() for name, column in flights._asdict().items()}
    return [
        _row(seed, world, **{name: column[i] for name, column in columns.items()})
        for i, (seed, world) in enumerate(zip(seeds, worlds, strict=True))
    ]


def _row(seed: int, w: World, *, rms_m: float, max_m: float, survived: bool, **figures: float) -> CampaignRow:
    known: dict[str, Any] = {name: _finite_or_none(value) for name, value in figures.items()}
    return CampaignRow(
        seed=seed,
        **{name: getattr(w, name) for name in COPIED},
        wind_north=w.wind_mean[0],
        wind_east=w.wind_mean[1],
        wind_down=w.wind_mean[2],
        gust_north=w.wind_gust[0],
        gust_east=w.wind_gust[1],
        gust_down=w.wind_gust[2],
        rms_cm=_finite_or_none(100.0 * rms_m),
        max_cm=_finite_or_none(100.0 * max_m),
        survived=survived,
        **known,
    )


COPIED = [name for name in CampaignRow.__struct_fields__ if name in World.__struct_fields__]
"""What a row takes over from the world as it stands."""


def _finite_or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None
