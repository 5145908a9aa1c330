"""``groundstation export``: channels as CSV, poses to be played again, or a recording that was cut off made whole."""

import csv
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any, TextIO

import msgspec

from groundstation.config import ConfigError
from groundstation.pose import CSV_COLUMNS, CsvRow, encode_csv
from groundstation.recording import CHANNELS, MeasuredMessage, NoRecording, Recording, schema
from groundstation.runtime import open_private


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
            count = rewritten(recording, target, wanted)
            print(f"{target}: {count} messages{_short_of(recording)}")
        elif form == "poses":
            target = out or path.with_name(f"{path.stem}-poses.csv")
            count = write_poses(recording, target)
            print(f"{target}: {count} poses; pose.kind = 'csv' plays them{_short_of(recording)}")
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
        row = dict(_flat(entry.value(), ""))
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


def _flat(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Nested objects and arrays as one row."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _flat(item, f"{name}.{key}" if name else key)
    elif isinstance(value, list):
        for index, item in enumerate(value):
            yield from _flat(item, f"{name}.{index}")
    else:
        yield name, value


def rewritten(recording: Recording, target: Path, topics: list[str]) -> int:
    """Write what can be read of ``recording`` to ``target``, whole and with an index; the number of messages."""
    from groundstation.recording import McapWriter

    if target.exists():
        raise ConfigError("--out", f"{target} is there already")
    count = 0
    with open(target, "wb", opener=open_private) as file:  # Path.open has no opener
        writer = McapWriter(file, "groundstation export")
        writer.add_metadata("about", recording.about)
        ids = {
            topic: writer.add_channel(topic, name, schema(name, message))
            for topic, (name, message) in CHANNELS.items()
            if not topics or topic in topics
        }
        for entry in recording.entries(topics):
            if entry.topic in ids:
                writer.add_message(ids[entry.topic], entry.stamp_ns, entry.data)
                count += 1
        if recording.result:
            writer.add_metadata("result", recording.result)
        writer.finish()
    return count
