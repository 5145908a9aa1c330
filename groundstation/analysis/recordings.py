"""Recordings, listed and exported (``groundstation logs``, ``groundstation export``), and read as
arrays: flight data.

A list has the headline numbers of each flight. An export has channels as CSV, or a recording that
was cut off made whole.

Flight data is a recorded flight as arrays, tables and pictures, for notebooks and scripts:

    log = load("flight.mcap")
    log.time, log.reference.position, log.estimate.position, log.error      # arrays, one row a
                                                                            command
    log["errors"].to_pandas()                                               # any channel, one row a
                                                                            message
"""

import csv
import json
import sys
from collections.abc import Collection, Mapping
from contextlib import ExitStack, suppress
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TextIO

import msgspec
import numpy as np

from groundstation.config import ConfigError, refuse_io, refuse_value
from groundstation.core.messages import notice
from groundstation.machine import (
    RecordingConfig,
    folder_of,
    is_being_written,
    list_flights,
    open_private,
    open_whole,
)
from groundstation.recording import (
    CHANNELS,
    FlightHeadline,
    NoRecording,
    Recording,
    add_channel,
    begin_mcap,
    describe_channels,
    flatten,
    quick_headline,
    refuse_recordings,
    tabulate,
)
from groundstation.runtime import Exit, require_package

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import NDArray
    from pandas import DataFrame

    from groundstation.analysis.report import FlightColumns

    Column = NDArray[np.float64]
    Tables = Mapping[str, Mapping[str, NDArray[Any]]]


SUFFIXES = {"csv": "", "npz": ".npz", "mat": ".mat", "mcap": "-whole.mcap"}
"""Suffix of each format behind the recording's name, by default."""


def export_command(path: Path, form: str, channels: list[str], out: Path | None) -> Exit:
    """Write the recording at ``path`` in another format, say what was written, and return 0.

    Raises:
        ConfigError: a file is no recording, or so damaged that nothing can be read, a channel has
            another name, or the result can't be written.
    """
    wanted = [name if name.startswith("/") else f"/{name}" for name in channels]
    for name in wanted:
        if name not in CHANNELS:
            raise ConfigError(
                "--channel", notice("value.choice", choices=list(CHANNELS), found=name)
            )
    to_screen = form == "csv" and len(wanted) == 1 and out is None
    target = out or path.with_name(f"{path.stem}{SUFFIXES[form]}")
    if form == "csv" and target.is_file():
        raise ConfigError("--out", notice("file.no_folder", path=target))
    if form != "csv" and target.exists():
        raise ConfigError("--out", notice("file.exists", path=target))
    if form == "mcap" and target.suffix != ".mcap":
        raise ConfigError("--out", notice("file.ending", ending=".mcap", found=target.name))
    with refuse_recordings():
        recording = Recording(path)
    if to_screen:
        try:
            write_csv(recording, {wanted[0]: sys.stdout})
        except BrokenPipeError:
            sys.stderr.close()  # whoever read us has seen enough
        if recording.trouble and not sys.stderr.closed:
            print(f"groundstation: export: the recording {recording.trouble}", file=sys.stderr)
        return Exit.DONE
    was_there = target.exists()
    try:
        with refuse_io("--out", "file.unwritten", target):
            count, written = _export(recording, form, wanted, target)
            if recording.trouble and not count:
                raise ConfigError("LOG", notice("recording.nothing", trouble=recording.trouble))
    except ConfigError:
        if target.is_file():
            target.unlink()  # what was begun of it
        elif not was_there:
            with suppress(OSError):  # not there, or some of its files are whole
                target.rmdir()
        raise
    print(f"{target}: {written}{recording.remark}")
    return Exit.DONE


def _export(recording: Recording, form: str, topics: list[str], target: Path) -> tuple[int, str]:
    """Write ``recording`` to ``target``; returns how much was written, and the same in words."""
    if form == "mcap":
        count = rewrite(recording, target, topics)
        return count, f"{count} messages"
    topics = topics or list(CHANNELS)
    if form == "csv":
        rows = _write_csv_folder(recording, topics, target)
    else:
        found = tabulate(recording.entries(topics), topics)
        tables = {topic.strip("/").replace("/", "_"): some for topic, some in found.items() if some}
        (_write_npz if form == "npz" else _write_mat)(tables, target)
        rows = {name: len(next(iter(table.values()))) for name, table in tables.items()}
    counts = [count for count in rows.values() if count]
    return sum(counts), f"{sum(counts)} rows of {len(counts)} channels"


def _file_name(topic: str) -> str:
    return f"{topic.strip('/').replace('/', '_')}.csv"


def _write_csv_folder(
    recording: Recording, topics: Collection[str], folder: Path
) -> dict[str, int]:
    """Write a folder with a file for each channel that holds anything; returns the rows of each."""
    folder.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        files = {
            topic: stack.enter_context(open_whole(folder / _file_name(topic))) for topic in topics
        }
        rows = write_csv(recording, files)
    for topic, count in rows.items():
        if not count:
            (folder / _file_name(topic)).unlink()
    return rows


def write_csv(recording: Recording, files: Mapping[str, TextIO]) -> dict[str, int]:
    """Write the messages on each topic to its file, one row each; returns the number of rows.

    Columns are named as ``rates_rad_s.x``: all that any message has, as some come only later (the
    attitude that a radio brings back, a counter's new reason). So the recording is read twice.
    """
    names: dict[str, dict[str, None]] = {topic: {} for topic in files}
    rows = dict.fromkeys(files, 0)
    for entry in recording.entries(files):
        names[entry.topic].update(dict.fromkeys(flatten(entry.value())))
    writers = {
        topic: csv.DictWriter(files[topic], list(some), extrasaction="ignore", lineterminator="\n")
        for topic, some in names.items()
        if some
    }
    for writer in writers.values():
        writer.writeheader()
    for entry in recording.entries(files):
        if entry.topic in writers:  # else it has come since then, of a flight that goes on
            writers[entry.topic].writerow(flatten(entry.value()))
            rows[entry.topic] += 1
    return rows


def rewrite(recording: Recording, target: Path, topics: list[str]) -> int:
    """Write what can be read of ``recording`` to ``target``, whole and with an index.

    The number of messages.
    """
    count = 0
    with open(target, "wb", opener=open_private) as file:  # Path.open has no opener
        writer = begin_mcap(file, "groundstation export", recording.about)
        ids = {form[0]: add_channel(writer, form) for form in describe_channels(topics or CHANNELS)}
        for entry in recording.entries(ids):
            writer.add_message(ids[entry.topic], entry.stamp_ns, entry.data, entry.stamp_ns)
            count += 1
        if recording.result:
            writer.add_metadata("result", recording.result)
        writer.finish()
    return count


def logs_command(folder: Path, *, as_json: bool) -> Exit:
    """List the recordings in ``folder``, which need not exist yet; returns 0.

    Raises:
        ConfigError: ``folder`` cannot be read.
    """
    with refuse_io("logs", "file.unread", folder), suppress(FileNotFoundError):
        next(folder.iterdir(), None)  # glob is silent about it
    flights = [describe_recording(path, folder) for path in list_flights(folder)]
    if as_json:
        print(json.dumps({"folder": str(folder), "flights": flights}))
        return Exit.DONE
    print(f"{folder}: {len(flights)} flight{'' if len(flights) == 1 else 's'}")
    rows = [_row(flight) for flight in flights]
    if folder != folder_of(RecordingConfig()):  # other commands find the names of that folder alone
        rows = [[str(folder / name), *cells] for name, *cells in rows]
    for line in _table(rows):
        print(line)
    return Exit.DONE


def describe_recording(path: Path, folder: Path) -> dict[str, Any]:
    """Describe one file for the list of ``folder``."""
    facts: dict[str, Any] = {"file": str(path.relative_to(folder)), "size_bytes": 0}
    try:
        facts["size_bytes"] = path.stat().st_size
        about, headline, whole = quick_headline(path)
    except NoRecording as error:
        return {**facts, "error": str(error)}
    except OSError as error:
        return {**facts, "error": error.strerror or str(error)}
    keys = ("started", "vehicle", "controller", "trajectory", "scenario", "seed", "version", "git")
    return {
        **facts,
        **{key: about.get(key, "") for key in keys},
        **msgspec.to_builtins(headline),
        "whole": whole,
        "being_written": not whole and is_being_written(path),
    }


_HEADS = (
    "",
    "controller",
    "trajectory",
    "flown",
    "RMS",
    "largest",
    "true RMS",
    "true largest",
    "size",
)


def _table(rows: list[list[str]]) -> list[str]:
    """The rows in columns as wide as what stands in them, below their heads.

    The last cell of a row is as it comes.
    """
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
    errors = [_cm(flight[key]) for key in ("rms_m", "max_m", "true_rms_m", "true_max_m")]
    names = (flight[key] for key in ("file", "controller", "trajectory"))
    return [*names, f"{flight['flown_s']:.1f} s", *errors, size, ended]


def _cm(value: float | None) -> str:
    return "-" if value is None else f"{100.0 * value:.2f} cm"


class Track(NamedTuple):
    """Where the vehicle was, was believed to be, or should have been: one row a command.

    What is not known is NaN.
    """

    position: "Column"
    """Position (N, 3) [m], world NED: north, east, down."""
    velocity: "Column"
    """Velocity (N, 3) [m/s], world NED."""
    attitude: "Column | None"
    """Attitude (N, 4), a unit quaternion w, x, y, z, body FRD to world NED; None of a reference."""
    error: "Column"
    """Distance from the reference (N,) [m]; zero for the reference itself."""


class Channel(dict[str, "NDArray[Any]"]):
    """One channel of a recording: its columns by name, such as ``z1_m.x``.

    A vector's own name gives all components.

    A column has the shape (N,), one row a message; the components of a vector together (N, 3) or
    (N, 4).
    """

    def __init__(self, topic: str, columns: "dict[str, NDArray[Any]]") -> None:
        """``columns`` are all of one length."""
        super().__init__(columns)
        self.topic = topic

    def __repr__(self) -> str:
        rows = len(next(iter(self.values()), ()))
        return f"<Channel {self.topic}, {rows} rows: {', '.join(self)}>"

    def __missing__(self, name: str) -> "NDArray[Any]":
        """All components of the vector ``name``.

        Raises:
            KeyError: there is none; the text says which columns there are.
        """
        parts = [column for key, column in self.items() if key.rpartition(".")[0] == name]
        if not parts:
            raise KeyError(
                str(
                    notice(
                        "recording.no_column", topic=self.topic, name=name, columns=", ".join(self)
                    )
                )
            )
        return np.stack(parts, axis=-1)

    def to_pandas(self) -> "DataFrame":
        """The columns as a table, one row a message, by ``time_s`` on the event loop's clock [s]
        where it has that.

        Raises:
            ConfigError: pandas is not installed.
        """
        require_package("pandas", "to_pandas", "notebook")
        from pandas import DataFrame

        table = DataFrame(dict(self))
        return table.set_index("time_s") if "time_s" in table else table


class FlightData:
    """A recorded flight. Everything is read from the recording when it is first asked for."""

    def __init__(self, path: Path) -> None:
        """Look at the recording's beginning.

        Raises:
            ConfigError: it is no recording of a flight, or can't be read.
        """
        self.path = path
        """Path of the recording."""
        _ = self._recording

    @cached_property
    def _recording(self) -> Recording:
        with refuse_recordings():
            return Recording(self.path)

    def __repr__(self) -> str:
        """For a notebook: what was flown, and how well."""
        rms = (
            "no steady part"
            if self.rms_cm is None
            else f"RMS error {self.rms_cm:.2f} cm against {self.error_against}"
        )
        short = self._recording.remark  # known by now: the figures are read to its end
        return (
            f"<{type(self).__name__} of {self.path.name}, "
            f"{self.about.get('controller', 'no controller')}: {rms}{short}>"
        )

    @property
    def about(self) -> dict[str, str]:
        """Facts known before the flight, as text: vehicle, controller, config, scenario, seed,
        version, ...
        """
        return self._recording.about

    @cached_property
    def headline(self) -> FlightHeadline:
        """The figures of the flight, as ``groundstation logs`` lists them."""
        return self._recording.headline()

    @cached_property
    def columns(self) -> "FlightColumns":
        """One row a command: what the report draws.

        Raises:
            ConfigError: nothing was commanded in it.
        """
        from groundstation.analysis.report import NoCommand, read_columns

        with refuse_value("LOG", NoCommand):
            return read_columns(self.path)

    @property
    def time(self) -> "Column":
        """Time of each command since the trajectory began (N,) [s].

        Where it never did, since the first command.
        """
        return self.columns.t

    @property
    def reference(self) -> Track:
        """Where the vehicle should have been."""
        vectors = self.columns.vectors
        return Track(
            vectors["reference_ned"],
            vectors["reference_velocity_ned"],
            None,
            np.zeros_like(self.columns.t),
        )

    @property
    def estimate(self) -> Track:
        """Estimate of the vehicle at the instant when each command acts."""
        vectors, error = self.columns.vectors, self.columns.scalars["error_m"]
        return Track(vectors["position_ned"], vectors["velocity_ned"], vectors["attitude"], error)

    @property
    def truth(self) -> Track | None:
        """Where a simulated vehicle really was when the command was computed.

        None where no truth was recorded.
        """
        vectors, error = self.columns.vectors, self.columns.scalars["true_error_m"]
        if not np.isfinite(vectors["true_position_ned"]).any():
            return None
        return Track(
            vectors["true_position_ned"],
            vectors["true_velocity_ned"],
            vectors["true_attitude"],
            error,
        )

    @property
    def error(self) -> "Column":
        """Distance of the vehicle from the reference (N,) [m]: see :attr:`error_against`."""
        return (self.truth or self.estimate).error

    @property
    def error_against(self) -> str:
        """``truth`` or ``estimate``: what :attr:`error`, :attr:`rms_cm` and :attr:`max_cm` are
        measured by.
        """
        return (
            "truth"
            if self.headline.true_rms_m is not None or self.truth is not None
            else "estimate"
        )

    @property
    def rms_cm(self) -> float | None:
        """Root mean square of the error over the steady part [cm].

        None where the flight ended before it.
        """
        return _to_cm(
            self.headline.true_rms_m if self.error_against == "truth" else self.headline.rms_m
        )

    @property
    def max_cm(self) -> float | None:
        """The largest error of the steady part [cm]; None where the flight ended before it."""
        return _to_cm(
            self.headline.true_max_m if self.error_against == "truth" else self.headline.max_m
        )

    @property
    def channels(self) -> list[str]:
        """The names for ``flight[name]``.

        Docs/reference/recording-channels.md tells what is in each.
        """
        return [topic.strip("/") for topic in CHANNELS]

    def __getitem__(self, channel: str) -> Channel:
        """One channel, as ``errors`` or ``/errors``.

        Its messages in the order in which things happened.

        Raises:
            KeyError: there is none of that name.
        """
        topic = f"/{str(channel).strip('/')}"
        if topic not in CHANNELS:
            raise KeyError(str(notice("value.choice", choices=self.channels, found=channel)))
        return Channel(topic, tabulate(self._recording.entries((topic,)), (topic,))[topic])

    def to_pandas(self) -> "DataFrame":
        """One row a command by its time [s]: reference, estimate and truth in columns such as
        ``truth.position.north``.

        Raises:
            ConfigError: pandas is not installed.
        """
        require_package("pandas", "to_pandas", "notebook")
        from pandas import DataFrame

        table: dict[str, Column] = {}
        for name, track in (
            ("reference", self.reference),
            ("estimate", self.estimate),
            ("truth", self.truth),
        ):
            if track is None:
                continue
            for part, values in zip(("position", "velocity"), track[:2], strict=True):
                table |= {
                    f"{name}.{part}.{axis}": values[:, i]
                    for i, axis in enumerate(("north", "east", "down"))
                }
            if track.attitude is not None:
                table |= {
                    f"{name}.attitude.{axis}": track.attitude[:, i] for i, axis in enumerate("wxyz")
                }
                table[f"{name}.error_m"] = track.error
        table["thrust_n"] = self.columns.scalars["thrust_n"]
        return DataFrame(table, index=self.time).rename_axis("time_s")

    def plot(self, figure: str = "position") -> "Figure":
        """One figure of ``groundstation report``, such as position, error, path, disturbance,
        actuation, lyapunov.

        Raises:
            ConfigError: there is no figure of that name, or matplotlib is not installed.
        """
        require_package("matplotlib", "plot", "notebook")
        from groundstation.analysis.report import draw_figure, find_figure

        return draw_figure(find_figure(figure), self.columns)


def load(path: Path | str) -> FlightData:
    """The recorded flight at ``path`` (NAME.mcap), also one that was cut off.

    Raises:
        ConfigError: it is no recording of a flight, or can't be read.
    """
    told: Any = path
    if not isinstance(told, Path | str) or not str(told):
        raise ConfigError("LOG", notice("recording.no_path", found=path))
    if Path(path).is_dir():
        raise ConfigError(
            "LOG", notice("recording.folder", path=path, example=Path(path) / "flight.mcap")
        )
    return FlightData(Path(path))


def _write_npz(tables: "Tables", target: Path) -> None:
    columns: Any = {
        f"{topic}.{name}": _without_objects(column)
        for topic, table in tables.items()
        for name, column in table.items()
    }
    with target.open("wb") as file:  # which keeps the name that was asked for
        np.savez_compressed(file, **columns)


def _without_objects(column: "NDArray[Any]") -> "NDArray[Any]":
    """Texts as NumPy's own, which `numpy.load` reads as it is: objects would be pickled, and nobody
    unpickles those.
    """
    if column.dtype != object:
        return column
    return np.array(["" if value is None else value for value in column], dtype=str)


def _write_mat(tables: "Tables", target: Path) -> None:
    """MATLAB's format: a struct for each channel, whose fields may have no dots."""
    require_package("scipy", target.name, "tables")
    from scipy.io import savemat

    told = {
        topic: {name.replace(".", "_"): column for name, column in table.items()}
        for topic, table in tables.items()
    }
    savemat(target, told, long_field_names=True, oned_as="column")


def _to_cm(metres: float | None) -> float | None:
    return None if metres is None else 100.0 * metres
