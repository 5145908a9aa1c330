"""A run's folder: the configuration, the recording (flight.mcap, flight.tlog), the poses as CSV, and the result.

A radio's frames, which leave by no network, are kept as lines of hex.
"""

import json
import sys
from collections import deque
from pathlib import Path
from typing import Any, TextIO

import msgspec

from groundstation.config import ConfigError, dump
from groundstation.core.messages import Pose
from groundstation.pose import CSV_COLUMNS, IN_RUN_FOLDER, CsvRow, encode_csv
from groundstation.recording import EndRecord, FlightLog, LineRecord, Record, TickRecord, about
from groundstation.settings import Config
from links.mavlink import MavlinkLinkConfig
from sim.radio import MODULE
from sim.world import World

AT_ONCE = 500
"""So many records are written one after the other, which takes less time than to write each as it comes. A simulation
that is killed loses them: some 2 s of flight, which took it some 50 ms."""
RECORDING, FRAMES = "flight.mcap", "frames.txt"


class RunFolder:
    """Writes one run."""

    def __init__(self, path: Path, config: Config, world: World, *, scenario: str, seed: int) -> None:
        """Make the folder and begin the recording; one that is there already is replaced.

        Raises:
            ConfigError: the folder can't be written.
        """
        self.path = path
        told = about(config, clock="virtual", scenario=scenario, seed=seed, sim=dump(world))
        try:
            path.mkdir(parents=True, exist_ok=True)
            (path / "config.toml").write_text(told.config)
            for name in (RECORDING, "flight.tlog", FRAMES):
                (path / name).unlink(missing_ok=True)
            # Virtual time begins at 0, whenever that is: the same flight gives the same bytes.
            self._log = FlightLog(path / RECORDING, told, epoch_ns=0, tell=_warn)
            self._poses = _opened(path / IN_RUN_FOLDER)
            self._frames = None if isinstance(config.link, MavlinkLinkConfig) else _opened(path / FRAMES)
        except OSError as error:
            raise ConfigError("--out", f"cannot write {path}: {error.strerror}") from None
        self._poses.write(CSV_COLUMNS + "\n")
        self._world = world
        self._waiting: deque[Record] = deque()
        self._last_s = 0.0
        self._state = "idle"
        self._ended = False

    def give(self, record: Record) -> None:
        """Take one record of the flight."""
        self._waiting.append(record)
        if len(self._waiting) >= AT_ONCE:
            self._write()
        if isinstance(record, TickRecord):
            self._last_s = record.tick.time_s
        elif isinstance(record, LineRecord):
            self._state = record.state
        elif isinstance(record, EndRecord):
            self._ended = True

    def _write(self) -> None:
        """Write what waits. What raises is left out, and the rest is written the next time."""
        while self._waiting:
            self._log.write(self._waiting.popleft())

    def abandon(self) -> None:
        """The simulation ends in an error: keep all that was given, of which the last is what one looks for."""
        self._write()
        self._log.flush()
        self._close_texts()

    def _close_texts(self) -> None:
        for file in (self._poses, self._frames):
            if file is not None:
                file.close()

    def datagram(self, time_s: float, source: tuple[str, int], target: tuple[str, int], data: bytes) -> None:
        """One datagram of the simulated network: a radio's frame is a line of hex."""
        del source
        if target == MODULE and self._frames is not None:
            self._frames.write(f"{time_s:.6f} {data.hex(' ')}\n")

    def pose(self, pose: Pose) -> None:
        """One pose as it came; `pose.kind = "csv"` plays the folder's again."""
        row = CsvRow(pose.time_s, pose.arrival_s, pose.position_ned, pose.attitude)
        self._poses.write(encode_csv(row))

    def close(self, facts: dict[str, Any]) -> None:
        """Write the result and close everything."""
        if not self._ended:  # the simulation has, in the air: that is no end of a mission
            self._waiting.append(EndRecord(self._last_s, self._state, facts["why"]))
        while self._waiting:
            try:
                self._write()
            except Exception as error:  # noqa: BLE001  # a controller of the user's own may put anything into a tick
                _warn(f"WARNING: a part of this flight can't be recorded: {error}")
        self._log.close()
        self._close_texts()
        result = {**facts, "sim": msgspec.to_builtins(self._world)}
        (self.path / "summary.json").write_text(json.dumps(result, indent=2) + "\n")


def _warn(line: str) -> None:
    print(line, file=sys.stderr)


def _opened(path: Path) -> TextIO:
    return path.open("w", encoding="utf-8")
