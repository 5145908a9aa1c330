"""Recordings, listed and exported: ``groundstation logs`` and ``groundstation export``.

A list has the headline numbers of each flight. An export has channels as CSV, poses to be played again, or a recording
that was cut off made whole.
"""

import argparse
import csv
import json
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import msgspec

from groundstation.config import ConfigError
from groundstation.pose import CSV_COLUMNS, CsvRow, encode_csv
from groundstation.recording import CHANNELS, MeasuredMessage, NoRecording, Recording, describe_channels, quick_headline
from groundstation.runtime import RecordingConfig, folder_of, is_being_written, open_private, tidy

if TYPE_CHECKING:
    from groundstation.analysis.viewers import FoxgloveScene


def export_command(path: Path, form: str, channels: list[str], out: Path | None) -> int:
    """Do it, say what was written, and return 0.

    Raises:
        ConfigError: the file is no recording, a channel has another name, or the result can't be written.
    """
    wanted = [name if name.startswith("/") else f"/{name}" for name in channels]
    for name in wanted:
        if name not in CHANNELS:
            raise ConfigError("--channel", f"expected one of {list(CHANNELS)}, got {name!r}")
    try:
        recording = Recording(path)
        if form == "mcap":
            target = out or path.with_name(f"{path.stem}-whole.mcap")
            count = rewrite(recording, target, wanted)
            print(f"{target}: {count} messages{_short_of(recording)}")
        elif form == "foxglove":
            from groundstation.analysis.viewers import FoxgloveScene

            target = out or path.with_name(f"{path.stem}-foxglove.mcap")
            count = rewrite(recording, target, wanted, FoxgloveScene("--format"))
            print(f"{target}: {count} messages{_short_of(recording)}; Foxglove and Rerun open it")
        elif form == "poses":
            target = out or path.with_name(f"{path.stem}-poses.csv")
            count = write_poses(recording, target)
            print(f"{target}: {count} poses; pose.kind = 'csv' plays them{_short_of(recording)}")
        elif form != "csv":
            _write_tables(recording, form, wanted or list(CHANNELS), out or path.with_suffix(f".{form}"))
        elif len(wanted) == 1 and out is None:
            write_csv(recording, {wanted[0]: sys.stdout})
            if not recording.whole:
                print(f"groundstation: export: the recording {recording.trouble}", file=sys.stderr)
        else:
            _write_folder(recording, wanted or list(CHANNELS), out or path.with_suffix(""))
    except NoRecording as error:
        raise ConfigError("LOG", str(error)) from None
    except BrokenPipeError:
        sys.stderr.close()  # whoever read us has seen enough
    except OSError as error:
        raise ConfigError("", f"{error.filename}: {error.strerror}") from None
    return 0


def _short_of(recording: Recording) -> str:
    return "" if recording.whole else f"; the recording {recording.trouble}"


def _write_tables(recording: Recording, form: str, topics: list[str], target: Path) -> None:
    from groundstation.analysis.flight_data import write_tables

    rows = write_tables(recording, form, topics, target)
    print(f"{target}: {sum(rows.values())} rows of {len(rows)} channels{_short_of(recording)}")


def _write_folder(recording: Recording, topics: list[str], folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        paths = {topic: folder / f"{topic.strip('/').replace('/', '_')}.csv" for topic in topics}
        files = {
            topic: stack.enter_context(path.open("w", encoding="utf-8", newline="")) for topic, path in paths.items()
        }
        rows = write_csv(recording, files)
    for topic, path in paths.items():
        print(f"{path}: {rows[topic]} rows")
    if not recording.whole:
        print(f"the recording {recording.trouble}")


def write_csv(recording: Recording, files: Mapping[str, TextIO]) -> dict[str, int]:
    """Write the messages on each topic to its file, one row each; returns the number of rows.

    Columns are named as ``rates_rad_s.x``. They are those of the first row: what comes only later (a counter's new
    reason) is left out.
    """
    writers: dict[str, Any] = {}
    rows = dict.fromkeys(files, 0)
    for entry in recording.entries(files):
        row = dict(flatten(entry.value(), ""))
        if entry.topic not in writers:
            writer = csv.DictWriter(files[entry.topic], list(row), extrasaction="ignore", lineterminator="\n")
            writer.writeheader()
            writers[entry.topic] = writer
        writers[entry.topic].writerow(row)
        rows[entry.topic] += 1
    return rows


def write_poses(recording: Recording, target: Path) -> int:
    """Write the poses as they came, in the columns that `pose.kind = "csv"` plays; the number of poses."""
    count = 0
    with target.open("w", encoding="utf-8") as file:
        file.write(CSV_COLUMNS + "\n")
        for entry in recording.entries(("/measured",)):
            count += 1
            seen = msgspec.json.decode(entry.data, type=MeasuredMessage)
            p, q = seen.position_ned, seen.attitude
            file.write(encode_csv(CsvRow(seen.time_s, seen.arrival_s, (p.x, p.y, p.z), (q.w, q.x, q.y, q.z))))
    return count


def flatten(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Nested objects and arrays as one row."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield from flatten(item, f"{name}.{key}" if name else key)
    elif isinstance(value, list):
        for index, item in enumerate(value):
            yield from flatten(item, f"{name}.{index}")
    else:
        yield name, value


def rewrite(recording: Recording, target: Path, topics: list[str], scene: "FoxgloveScene | None" = None) -> int:
    """Write what can be read of ``recording`` to ``target``, whole and with an index; the number of messages.

    With a ``scene``, what viewers draw is made of it and stands beside the messages on ``topics``.
    """
    from groundstation.recording import McapWriter

    if target.exists():
        raise ConfigError("--out", f"{target} is there already")
    count = 0
    with open(target, "wb", opener=open_private) as file:  # Path.open has no opener
        writer = McapWriter(file, "groundstation export")
        writer.add_metadata("about", recording.about)
        kept = [topic for topic in CHANNELS if not topics or topic in topics]
        channels = scene.channels(kept) if scene else describe_channels(kept)
        ids = {form[0]: writer.add_channel(*form) for form in channels}
        for entry in recording.entries(() if scene else topics):
            for topic, data in scene.messages(entry) if scene else ((entry.topic, entry.data),):
                if topic in ids:
                    writer.add_message(ids[topic], entry.stamp_ns, data)
                    count += 1
        if recording.result:
            writer.add_metadata("result", recording.result)
        writer.finish()
    return count


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
    flights = [describe_recording(path, folder) for path in _recordings(folder)]
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


def describe_recording(path: Path, folder: Path) -> dict[str, Any]:
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


_HEADS = ("", "controller", "trajectory", "flown", "RMS", "true RMS", "largest", "size")


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
    errors = [_cm(flight["rms_m"]), _cm(flight["true_rms_m"]), _cm(flight["max_m"])]
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
