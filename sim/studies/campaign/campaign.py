"""Campaign: a scenario flown a thousand times in drawn worlds, as arrays, on all cores.

Its folder and its crew.

Every flight is drawn from its seed alone, and neither the size of the batches nor who flies them
changes a figure of it: processes of this machine, or the workers of a Dask cluster, all of which
must run this very program.

The folder holds ``flights.csv``, one row a flight, and ``settings.json``, what all its flights
share. An interrupted campaign resumes from it: whole rows are kept, and the rest is flown again.
"""

import csv
import hashlib
import io
import json
import logging
import math
import shlex
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from statistics import median
from types import TracebackType
from typing import Any, NamedTuple

import msgspec
import numpy as np

from groundstation.config import ConfigError
from groundstation.core.geometry import Vec3
from groundstation.core.messages import LEAST_JUDGED_S
from groundstation.machine import write_whole
from groundstation.runtime import require_package
from groundstation.settings import Config
from sim.batch import Flights, fly_batch, require_batchable
from sim.runs import Flyers, check_duration
from sim.text import notice
from sim.world import World, generator


class CampaignRow(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One flight: what it met, how it went, and what its certificate rests on.

    What it takes over from the world is said there. Errors as in
    :class:`sim.runs.referee.FlightVerdict`.
    """

    seed: int
    """Seed of the flight's draws."""
    mass_kg: float
    """True mass [kg]."""
    thrust_lag_s: float
    rate_lag_s: float
    thrust_gain: float
    wind_north: float
    """Constant disturbance, north [m/s²]."""
    wind_east: float
    """East [m/s²]."""
    wind_down: float
    """Down [m/s²]."""
    gust_north: float
    """Amplitude of the sine gust, north [m/s²]."""
    gust_east: float
    """East [m/s²]."""
    gust_down: float
    """Down [m/s²]."""
    pose_latency_s: float
    pose_noise_m: float
    attitude_noise_rad: float
    pose_loss: float
    frame_loss: float
    outage_s: float
    rms_cm: float | None
    """RMS of the true position error over the steady part, from 15 s on [cm]."""
    max_cm: float | None
    """Largest true position error over the steady part [cm]."""
    settle_s: float | None
    """First time after which the error stays below 10 cm [s]; empty also where it never settled."""
    effort_rad_s: float | None
    """RMS over the steady part of the commanded roll and pitch rates less their low-pass of 0.15 s
    [rad/s]."""
    saturated: float
    """Share of the commands after 5 s in which any of the four was clamped [-]."""
    lyapunov_start: float
    """V at the first command, b̃ from the truth [m²/s²]."""
    lyapunov_floor: float | None
    """Median of V over the steady part [m²/s²]."""
    b_hat_share_max: float | None
    """Largest |b̂| over the flight, in shares of its bound B + ε [-]."""
    thrust_margin_n: float | None
    """Least distance of the commanded thrust from either of its limits over the steady part [N]."""
    thrust_scale: float | None
    """Estimated true thrust over the configured one at the end [-]."""
    thrust_scale_deviation: float | None
    """Standard deviation of that estimate [-]."""
    survived: bool
    """False where it crashed, or poses stayed away for too long."""


COLUMNS = CampaignRow.__struct_fields__


class Folder:
    """Rows on disk; see the module."""

    def __init__(self, path: Path, settings: Mapping[str, Any]) -> None:
        """Open or begin the campaign in ``path``.

        Raises:
            ConfigError: it holds flights made with other settings or by another program, or cannot
                be used.
        """
        self._csv = path / "flights.csv"
        about = path / "settings.json"
        text = json.dumps(settings, indent=1) + "\n"
        try:
            path.mkdir(parents=True, exist_ok=True)
            if self._csv.exists():
                _refuse_others(path, about, json.loads(text))
            else:
                # First what the flights share: rows never stand without it.
                write_whole(about, text)
                write_whole(self._csv, ",".join(COLUMNS) + "\n")
            self.rows = self._read()
        except OSError as error:
            raise ConfigError(
                "--out", notice("file.unusable", path=path, why=error.strerror)
            ) from None
        except ValueError as error:
            raise ConfigError("--out", notice("campaign.no_folder", path=path, why=error)) from None

    def _read(self) -> list[CampaignRow]:
        data = self._csv.read_bytes()
        whole = data[: data.rfind(b"\n") + 1]
        if whole != data:
            # The last row was cut off in the writing of it.
            self._csv.write_bytes(whole)
        table = csv.DictReader(io.StringIO(whole.decode()))
        return [
            msgspec.convert(
                {key: value or None for key, value in row.items()}, CampaignRow, strict=False
            )
            for row in table
        ]

    def add(self, rows: Iterable[CampaignRow]) -> None:
        """Write ``rows`` down; once this returns they outlive the program."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        for row in rows:
            # The shortest text that reads back to the same bits.
            writer.writerow("" if x is None else repr(x) for x in msgspec.structs.astuple(row))
        with self._csv.open("a", encoding="utf-8") as file:
            file.write(text.getvalue())


def program_sha256() -> str:
    """Digest of the program's own source: rows of two programs must not be mixed."""
    digest = hashlib.sha256()
    for package in ("groundstation", "links", "sim"):
        root = Path(__file__).parents[3] / package
        for source in sorted(root.rglob("*.py")):
            digest.update(f"{root.name}/{source.relative_to(root).as_posix()}\n".encode())
            digest.update(source.read_bytes())
    return digest.hexdigest()


def _refuse_others(path: Path, about: Path, settings: Any) -> None:
    before, now = dict(_flat(json.loads(about.read_text(encoding="utf-8")))), dict(_flat(settings))
    for key in sorted(before.keys() | now.keys()):
        if before.get(key) != now.get(key):
            says = notice(
                "campaign.other_settings",
                path=path,
                key=key,
                before=before.get(key),
                now=now.get(key),
            )
            raise ConfigError("--out", says)


def _flat(value: Any, key: str = "") -> Iterable[tuple[str, Any]]:
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _flat(inner, f"{key}.{name}" if key else name)
    else:
        yield key, value


class Draw(NamedTuple):
    """Some fields of :class:`World` that are drawn together, each by itself and uniformly."""

    fields: tuple[str, ...]
    low: float
    high: float
    relative: bool
    """The bounds are shares of the scenario's value; otherwise they are in the field's own unit,
    whatever it says."""

    def __str__(self) -> str:
        bounds = f"{self.low:g} to {self.high:g}"
        return (
            f"{' and '.join(self.fields)} {bounds}{' times the scenario' if self.relative else ''}"
        )


DRAWS: dict[str, tuple[Draw, ...]] = {
    "mass": (Draw(("mass_kg",), 0.9, 1.1, True),),
    "lags": (Draw(("thrust_lag_s", "rate_lag_s"), 0.8, 1.2, True),),
    "gain": (Draw(("thrust_gain",), 0.8, 1.1, False),),
    "wind": (),
    "latency": (Draw(("pose_latency_s",), 0.75, 1.5, True),),
    "noise": (Draw(("pose_noise_m", "attitude_noise_rad"), 0.5, 2.0, True),),
    "losses": (
        Draw(("pose_loss", "frame_loss"), 0.0, 0.05, False),
        Draw(("outage_s",), 0.0, 0.15, False),
    ),
}
"""Quantities that can be drawn. ``wind`` turns mean wind and gusts, each to its own direction,
uniform on the sphere.

The controller is told nothing of it: a pose that comes later than it is told is stamped wrongly by
the difference.
"""
WINDS = ("wind_mean", "wind_gust")
USUAL = ("mass", "lags", "gain", "wind")
"""Drawn unless told otherwise: what the figures of ``adverse`` are defined for."""


def fields(names: Iterable[str]) -> tuple[str, ...]:
    """The fields of :class:`World` that the draws of these names set."""
    return tuple(
        f
        for name in names
        for f in (*(f for draw in DRAWS[name] for f in draw.fields), *_winds(name))
    )


def absolute(names: Iterable[str]) -> dict[str, Draw]:
    """Those among them that do not depend on the scenario's value."""
    return {
        f: draw for name in names for draw in DRAWS[name] if not draw.relative for f in draw.fields
    }


def draw_world(world: World, seed: int, names: Collection[str] = USUAL) -> World:
    """``world`` as the flight of ``seed`` meets it, with the draws of ``names``.

    Always the same numbers are drawn in the same order, so that neither a figure of ``world`` nor
    the choice of ``names`` shifts another draw.
    """
    random = generator(seed, "campaign")
    values: dict[str, float | Vec3] = {}
    for name, draws in DRAWS.items():
        found: dict[str, float | Vec3] = {}
        for draw in draws:
            for field in draw.fields:
                value = float(random.uniform(draw.low, draw.high))
                found[field] = value * getattr(world, field) if draw.relative else value
        for field in _winds(name):
            found[field] = _turn(getattr(world, field), random)
        if name in names:
            values |= found
    return msgspec.structs.replace(world, **values)


def overrides(world: World, names: Iterable[str] = USUAL) -> list[str]:
    """Return the ``--set`` values with which a single flight meets ``world`` to the last bit."""
    return [f"sim.{field}={_toml(getattr(world, field))}" for field in fields(names)]


def _winds(name: str) -> tuple[str, ...]:
    return WINDS if name == "wind" else ()


def _turn(v: Vec3, random: np.random.Generator) -> Vec3:
    """A vector as long as ``v``.

    Three normal numbers point in every direction with equal density.
    """
    x, y, z = random.standard_normal(3).tolist()
    scale = math.hypot(*v) / math.hypot(x, y, z)
    return (scale * x, scale * y, scale * z)


def _toml(value: float | Vec3) -> str:
    return "[" + ",".join(map(repr, value)) + "]" if isinstance(value, tuple) else repr(value)


BATCH = 500
"""Most flights to fly at once: more are hardly faster each, and what is interrupted is lost."""


class Campaign(msgspec.Struct, frozen=True, kw_only=True):
    """Settings shared by all flights."""

    scenario: str
    world: World
    """World before the draws of :func:`sim.studies.campaign.campaign.draw_world`."""
    config: Config
    duration_s: float
    """Duration of each flight from the release [s]."""
    overrides: list[str]
    """``--set`` as given, to name the command that flies one flight again."""
    draws: tuple[str, ...] = USUAL
    """Names of what differs from flight to flight, keys of ``DRAWS``."""

    def check(self) -> None:
        """Refuse what cannot be flown or would not be true.

        Raises:
            ConfigError: a controller that no batch flies, an unknown draw, a value that is drawn
                whatever is set, or too short flights.
        """
        require_batchable(self.world, self.config)
        check_duration(self.duration_s, LEAST_JUDGED_S)
        for name in self.draws:
            if name not in DRAWS:
                raise ConfigError(
                    "--draw", notice("value.choices", choices=list(DRAWS), found=name)
                )
        for field, draw in absolute(self.draws).items():
            if any(o.partition("=")[0].strip() == f"sim.{field}" for o in self.overrides):
                raise ConfigError(
                    f"sim.{field}", notice("campaign.drawn", low=draw.low, high=draw.high), "--set"
                )

    def settings(self) -> dict[str, Any]:
        """Return the settings that two comparable rows share, for ``settings.json``."""
        return {
            "scenario": self.scenario,
            "duration_s": self.duration_s,
            "drawn": {
                name: "; ".join(map(str, DRAWS[name])) or "directions" for name in self.draws
            },
            "sim": msgspec.to_builtins(self.world),
            "told": msgspec.to_builtins(self.config),
            "program_sha256": program_sha256(),
        }


def run(
    campaign: Campaign,
    seeds: Sequence[int],
    crew: "Crew",
    *,
    out: Path | None = None,
    batch: int | None = None,
    on_progress: Callable[[int], None] = lambda done: None,
) -> tuple[list[CampaignRow], int]:
    """Let ``crew`` fly the ``seeds`` that the folder ``out`` does not hold yet, ``batch`` at a
    time.

    Without ``batch`` the work is shared out evenly, up to ``BATCH``. ``on_progress`` hears how many
    rows there are. Returns all rows in the order of the seeds, and how many of them were flown now.

    Raises:
        ConfigError: see :meth:`Campaign.require_batchable`, :class:`Folder` and ``fly`` of the
            crew.
    """
    campaign.check()
    folder = Folder(out, campaign.settings()) if out is not None else None
    wanted = set(seeds)
    rows = {
        row.seed: row for row in (folder.rows if folder is not None else []) if row.seed in wanted
    }
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
    flights = fly_batch(worlds, campaign.config, seeds, duration_s=campaign.duration_s)
    return [
        _row(seed, world, flights, i)
        for i, (seed, world) in enumerate(zip(seeds, worlds, strict=True))
    ]


def _row(seed: int, w: World, flights: Flights, i: int) -> CampaignRow:
    """Return the row of flight ``i`` of the batch, flown in ``w``."""
    figures: dict[str, Any] = {
        name: _finite_or_none(getattr(flights, name)[i].item()) for name in FIGURES
    }
    return CampaignRow(
        seed=seed,
        **{name: getattr(w, name) for name in COPIED},
        wind_north=w.wind_mean[0],
        wind_east=w.wind_mean[1],
        wind_down=w.wind_mean[2],
        gust_north=w.wind_gust[0],
        gust_east=w.wind_gust[1],
        gust_down=w.wind_gust[2],
        rms_cm=_finite_or_none(100.0 * flights.rms_m[i].item()),
        max_cm=_finite_or_none(100.0 * flights.max_m[i].item()),
        **figures,
    )


FIGURES = [name for name in COLUMNS if name in Flights._fields]
"""Fields of a row that are copied from the flight's figures."""
COPIED = [name for name in COLUMNS if name in World.__struct_fields__]
"""Fields of a row that are copied from the world."""


def _finite_or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


CONNECT_S = 10.0
"""Timeout of the connection to the scheduler [s]."""


class Cluster:
    """The workers of the Dask scheduler at ``address``, as host:port or tcp://host:port."""

    def __init__(self, address: str) -> None:
        """Connect.

        Raises:
            ConfigError: dask.distributed is missing, nobody answers, no worker is there, or one
                runs another program.
        """
        require_package("distributed", "--cluster", "cluster")
        from distributed import Client

        self._address = address
        for name in ("client", "core", "utils"):
            # What they tell in tracebacks is said here in a sentence.
            logging.getLogger(f"distributed.{name}").setLevel(logging.CRITICAL)
        try:
            self._client = Client(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            reason = str(error) or type(error).__name__
            raise ConfigError(
                "--cluster", notice("cluster.no_scheduler", address=address, why=reason)
            ) from None
        try:
            self.workers = self._check()
        except BaseException:
            self._client.close()
            raise

    def _check(self) -> int:
        """Return the number of workers; check that all run this program."""
        found: dict[str, Any] = self._client.run(program_sha256, on_error="return")
        if not found:
            raise ConfigError("--cluster", notice("cluster.no_workers", address=self._address))
        mine = program_sha256()
        for worker, theirs in found.items():
            if theirs != mine:
                raise _foreign(worker, mine, theirs)
        return len(found)

    def __enter__(self) -> "Cluster":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Disconnect; what is still being flown is called off."""
        self._client.close()

    def fly(self, campaign: Campaign, chunks: Sequence[list[int]]) -> Iterator[list[CampaignRow]]:
        """The flights of each chunk of seeds, in any order."""
        from distributed import CancelledError, KilledWorker, as_completed

        mine = program_sha256()
        futures = [
            self._client.submit(_fly_there, mine, campaign, chunk, pure=False) for chunk in chunks
        ]
        try:
            for done in as_completed(futures, loop=self._client.loop):
                flown = done.result()
                if isinstance(flown, tuple):
                    worker, theirs = flown
                    raise _foreign(worker, mine, theirs)
                done.release()
                yield flown
        except (ImportError, AttributeError) as error:
            raise ConfigError("--cluster", notice("cluster.no_program", why=error)) from None
        except KilledWorker as error:
            raise ConfigError("--batch", notice("cluster.workers_lost", why=error)) from None
        except CancelledError:
            raise ConfigError(
                "--cluster", notice("cluster.scheduler_gone", address=self._address)
            ) from None
        finally:
            self._client.cancel(futures)


def _fly_there(
    program: str, campaign: Campaign, seeds: list[int]
) -> list[CampaignRow] | tuple[str, str]:
    """On a worker: the flights of ``seeds``.

    Or, where this is not ``program``, the worker's address and program.
    """
    mine = program_sha256()
    if mine != program:
        from distributed import get_worker

        return get_worker().address, mine
    return fly_chunk(campaign, seeds)


def _foreign(worker: str, mine: str, theirs: Any) -> ConfigError:
    what = f"sha256 {theirs[:12]}…" if isinstance(theirs, str) else f"it answers {theirs!r}"
    return ConfigError(
        "--cluster", notice("cluster.other_program", worker=worker, theirs=what, ours=mine[:12])
    )


class Local:
    """Processes of this machine."""

    def __init__(self, workers: int) -> None:
        self.workers = workers

    def fly(self, campaign: Campaign, chunks: Sequence[list[int]]) -> Iterator[list[CampaignRow]]:
        """The flights of each chunk of seeds, in any order."""
        with Flyers(min(self.workers, max(len(chunks), 1))) as flyers:
            for _, rows in flyers.as_done(partial(fly_chunk, campaign), chunks):
                yield rows


Crew = Local | Cluster
"""Executor of the batches, ``workers`` at once."""

PERCENTILES = (50, 90, 99)
"""Percentiles of the errors in a summary [%]."""
WORST = 5
"""Worst flights that a summary names."""


def report(
    campaign: Campaign, rows: list[CampaignRow], *, flown: int, wall_s: float, workers: int
) -> dict[str, Any]:
    """The figures of ``rows`` as JSON has them.

    A crash counts as an error beyond all others (null).

    Of ``rows``, ``flown`` took ``wall_s`` [s] on ``workers`` processes; the rest was there already.
    Percentiles are the smallest RMS that so many percent of the flights do not exceed.
    """
    count = len(rows)
    worst = sorted(
        rows,
        key=lambda row: (math.inf if row.rms_cm is None else row.rms_cm, -row.seed),
        reverse=True,
    )
    return {
        "scenario": campaign.scenario,
        "flights": count,
        "flown_now": flown,
        "duration_s": campaign.duration_s,
        "survived": sum(row.survived for row in rows) / count,
        "rms_cm": {
            **{f"p{p}": worst[count - math.ceil(p * count / 100)].rms_cm for p in PERCENTILES},
            "max": worst[0].rms_cm,
        },
        "certificate": _sum_up_certificate(rows),
        "worst": [
            {
                "seed": row.seed,
                "survived": row.survived,
                "rms_cm": row.rms_cm,
                "max_cm": row.max_cm,
                "command": command(campaign, row.seed),
            }
            for row in worst[:WORST]
        ],
        "workers": workers,
        "wall_s": wall_s,
    }


def _sum_up_certificate(rows: list[CampaignRow]) -> dict[str, float | None]:
    shares = _drop_unknown([row.b_hat_share_max for row in rows])
    margins_n = _drop_unknown([row.thrust_margin_n for row in rows])
    return {
        "lyapunov_floor": _middle([row.lyapunov_floor for row in rows]),
        "b_hat_share_max": max(shares, default=None),
        "thrust_margin_n": min(margins_n, default=None),
    }


def command(campaign: Campaign, seed: int) -> str:
    """The shell command that flies the flight of ``seed`` alone, through wire bytes."""
    words = ["groundstation-sim", "fly", campaign.scenario, "--seed", str(seed)]
    words += ["--duration", repr(campaign.duration_s)]
    for override in campaign.overrides + overrides(
        draw_world(campaign.world, seed, campaign.draws), campaign.draws
    ):
        words += ["--set", override]
    return shlex.join(words)


def text(facts: dict[str, Any]) -> str:
    """``report`` for people."""
    rms = facts["rms_cm"]
    lines = [
        f"{facts['scenario']}: {facts['flights']} flights of {facts['duration_s']:g} s, "
        f"{facts['flown_now']} flown now",
        "",
        f"{'survived':24}{100.0 * facts['survived']:.2f} %",
        *(f"{f'RMS error, {p} %':24}{_cm(rms[f'p{p}'])}" for p in PERCENTILES),
        f"{'RMS error, worst':24}{_cm(rms['max'])}",
        *_certificate(facts["certificate"]),
        f"{'wall time':24}{facts['wall_s']:.1f} s on {facts['workers']} processes",
    ]
    lines += ["", "worst flights, and how to fly each again:"]
    for row in facts["worst"]:
        lines.append(f"seed {row['seed']}: RMS {_cm(row['rms_cm'])}, largest {_cm(row['max_cm'])}")
        lines.append(f"    {row['command']}")
    return "\n".join(lines)


def _certificate(facts: dict[str, Any]) -> list[str]:
    if None in facts.values():
        return []
    return [
        f"{'V, floor':24}{facts['lyapunov_floor']:.3g} (median)",
        f"{'|b̂| / (B + ε), most':24}{facts['b_hat_share_max']:.2f}",
        f"{'thrust margin, least':24}{facts['thrust_margin_n']:.3f} N",
    ]


def _middle(values: Sequence[float | None]) -> float | None:
    known = _drop_unknown(values)
    return median(known) if known else None


def _drop_unknown(values: Sequence[float | None]) -> list[float]:
    return [value for value in values if value is not None]


def _cm(value: float | None) -> str:
    return "crashed" if value is None else f"{value:.2f} cm"
