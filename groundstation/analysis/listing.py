"""``groundstation logs``: the recorded flights, each with its headline numbers."""

import argparse
import json
from pathlib import Path
from typing import Any

import msgspec

from groundstation.config import ConfigError
from groundstation.recording import NoRecording, quick_headline
from groundstation.runtime import RecordingConfig, folder_of, is_being_written, tidy


def logs_command(config: RecordingConfig, args: argparse.Namespace) -> int:
    """List what ``config`` has recorded (or what is in ``args.folder``), tidy first where ``args.tidy``; returns 0.

    Raises:
        ConfigError: ``args.folder`` is no folder. That of ``config`` need not be there: nothing has been recorded yet.
    """
    if args.folder is not None:
        if not args.folder.expanduser().is_dir():
            is_what = "is no folder" if args.folder.expanduser().exists() else "does not exist"
            raise ConfigError("--folder", f"{args.folder} {is_what}")
        config = msgspec.structs.replace(config, folder=str(args.folder))
    folder = folder_of(config)
    removed = tidy(config, args.now_s) if args.tidy else []
    flights = [described(path, folder) for path in _recordings(folder)]
    if args.json:
        print(json.dumps({"folder": str(folder), "flights": flights, "removed": [path.name for path in removed]}))
        return 0
    for path in removed:
        print(f"removed {path.name}")
    print(f"{folder}: {len(flights)} flight{'' if len(flights) == 1 else 's'}")
    for line in _table([_row(flight) for flight in flights]):
        print(line)
    return 0


def _recordings(folder: Path) -> list[Path]:
    """Those in it, and those of simulated flights, each of which has a folder of its own."""
    return sorted(folder.glob("*.mcap")) + sorted(folder.glob("*/*.mcap"))


def described(path: Path, folder: Path) -> dict[str, Any]:
    """What the list of ``folder`` says of one file in it."""
    facts: dict[str, Any] = {"file": str(path.relative_to(folder)), "size_bytes": path.stat().st_size}
    try:
        about, headline, whole = quick_headline(path)
    except (NoRecording, OSError) as error:
        return {**facts, "error": str(error)}
    keys = ("started", "vehicle", "controller", "trajectory", "scenario", "seed", "version", "git")
    return {
        **facts,
        **{key: about.get(key, "") for key in keys},
        **msgspec.to_builtins(headline),
        "whole": whole,
        "being_written": not whole and is_being_written(path),
    }


_HEADS = ("", "controller", "trajectory", "flown", "RMS", "largest", "size")


def _table(rows: list[list[str]]) -> list[str]:
    """The rows in columns as wide as what stands in them, below their heads; the last cell of a row is as it comes."""
    if not rows:
        return []
    rows = [[*_HEADS, "ended"], *rows]
    full = [row for row in rows if len(row) == len(rows[0])]
    first = max(len(row[0]) for row in rows)
    widths = [max(len(row[column]) for row in full) for column in range(1, len(_HEADS))]
    lines = []
    for row in rows:
        cells = [f"{cell:>{width}}" for cell, width in zip(row[1:-1], widths, strict=False)]
        lines.append("  ".join([f"{row[0]:{first}}", *cells, row[-1]]))
    return lines


def _row(flight: dict[str, Any]) -> list[str]:
    if "error" in flight:
        return [flight["file"], flight["error"].rpartition(f"{flight['file']} ")[2]]
    ended = f"{flight['state']}: {flight['reason']}"
    if flight["being_written"]:
        ended = f"{flight['state']}: being recorded now"
    size = f"{flight['size_bytes'] / 1e6:.1f} MB"
    errors = [_cm(flight["rms_m"]), _cm(flight["max_m"])]
    return [
        flight["file"],
        flight["controller"],
        flight["trajectory"],
        f"{flight['flown_s']:.1f} s",
        *errors,
        size,
        ended,
    ]


def _cm(value: float | None) -> str:
    return "-" if value is None else f"{100.0 * value:.2f} cm"
