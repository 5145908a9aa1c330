"""A campaign's folder: ``flights.csv``, one row a flight, and ``settings.json``, what all its flights share.

An interrupted campaign resumes from it: whole rows are kept, and the rest is flown again.
"""

import csv
import hashlib
import io
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import msgspec

from groundstation.config import ConfigError


class CampaignRow(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One flight: what it met, how it went, and what its certificate rests on.

    What it takes over from the world is said there. Errors as in :class:`sim.runs.referee.FlightVerdict`.
    """

    seed: int
    """What the flight is drawn from."""
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
    saturated: float
    """Share of the commands after 5 s in which any of the four was clamped [-]."""
    lyapunov_start: float
    """V at the first command, b̃ from the truth [m²/s²]."""
    lyapunov_floor: float | None
    """Median of V over the steady part [m²/s²]."""
    certificate_violated: float | None
    """Share of the commands at which the watch in flight finds V above its bound for longer than a moment [-]."""
    certificate_suspended: float | None
    """Share of the commands at which that bound was suspended, as the command before was clamped [-]."""
    b_hat_share_max: float | None
    """Largest |b̂| over the flight, in shares of its bound B + ε [-]."""
    thrust_margin_n: float | None
    """Least distance of the commanded thrust from either of its limits over the steady part [N]."""
    survived: bool
    """False where it crashed, or poses stayed away for too long."""


COLUMNS = CampaignRow.__struct_fields__


class Folder:
    """Rows on disk; see the module."""

    def __init__(self, path: Path, settings: Mapping[str, Any]) -> None:
        """Open or begin the campaign in ``path``.

        Raises:
            ConfigError: it holds flights made with other settings or by another program, or cannot be used.
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
                about.write_text(text, encoding="utf-8")
                self._csv.write_text(",".join(COLUMNS) + "\n", encoding="utf-8")
            self.rows = self._read()
        except OSError as error:
            raise ConfigError("--out", f"cannot use {path}: {error.strerror}") from None
        except ValueError as error:
            raise ConfigError("--out", f"{path} is no folder of a campaign: {error}") from None

    def _read(self) -> list[CampaignRow]:
        data = self._csv.read_bytes()
        whole = data[: data.rfind(b"\n") + 1]
        if whole != data:
            # The last row was cut off in the writing of it.
            self._csv.write_bytes(whole)
        table = csv.DictReader(io.StringIO(whole.decode()))
        return [
            msgspec.convert({key: value or None for key, value in row.items()}, CampaignRow, strict=False)
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
            raise ConfigError(
                "--out",
                f"the flights in {path} were flown with {key} = {before.get(key)}, now it is {now.get(key)}; "
                "take another folder, or the same settings",
            )


def _flat(value: Any, key: str = "") -> Iterable[tuple[str, Any]]:
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _flat(inner, f"{key}.{name}" if key else name)
    else:
        yield key, value
