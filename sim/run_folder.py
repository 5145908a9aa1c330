"""A run's folder: config, every command and every pose as CSV, the bytes on the wire, events, and the result.

MAVLink is kept as .tlog, both ways; a radio's frames as lines of hex.
Rows are written as they come and flushed every half second of flight, so a crash loses no more than that.
"""

import json
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TextIO

import msgspec

from groundstation.config import ConfigError, dump
from groundstation.pilot import Tick
from groundstation.poses import csv_codec
from groundstation.poses.csv import IN_RUN_FOLDER
from groundstation.poses.port import Pose
from groundstation.settings import Config
from links.address import parse_address
from links.mavlink import MavlinkLinkConfig
from sim.inline_pacer import MODULE
from sim.world import World

COLUMNS = (
    "time_s,x_m,y_m,z_m,ref_x_m,ref_y_m,ref_z_m,vx_m_s,vy_m_s,vz_m_s,qw,qx,qy,qz,"
    "thrust_n,rate_x_rad_s,rate_y_rad_s,rate_z_rad_s,saturated,"
    "z2_x,z2_y,z2_z,z3_x,z3_y,z3_z,b_hat_x,b_hat_y,b_hat_z,d_hat_x,d_hat_y,d_hat_z,v_known,w,effectiveness,"
    "v_excess,certificate"
)
"""Positions are the estimate at the acting instant; world NED, body FRD. v_excess [m²/s²] and certificate: see Seen."""


class RunFolder:
    """Writes one run."""

    def __init__(self, path: Path, config: Config) -> None:
        """Make the folder and open its files.

        Raises:
            ConfigError: the folder can't be written.
        """
        self.path = path
        link = config.link
        self._mavlink_port = parse_address(link.address)[1] if isinstance(link, MavlinkLinkConfig) else None
        try:
            path.mkdir(parents=True, exist_ok=True)
            (path / "config.toml").write_text(dump(config))
            self._csv = _opened(path / "flight.csv")
            self._events = _opened(path / "events.txt")
            self._poses = _opened(path / IN_RUN_FOLDER)
            self._wire = (path / ("frames.txt" if self._mavlink_port is None else "mavlink.tlog")).open("wb")
        except OSError as error:
            raise ConfigError("--out", f"cannot write {path}: {error.strerror}") from None
        self._csv.write(COLUMNS + "\n")
        self._poses.write(csv_codec.COLUMNS + "\n")
        self._flushed = 0.0

    def tick(self, tick: Tick) -> None:
        """One command."""
        d, motion = tick.decision.diagnostics, tick.estimate.motion
        row: Sequence[float] = (
            tick.flight_time_s,
            *motion.position,
            *tick.reference.position_ned,
            *motion.velocity,
            *motion.attitude,
            tick.decision.drive.thrust,
            *tick.decision.drive.rates,
            int(tick.decision.saturated),
            *d.z2,
            *d.z3,
            *d.b_hat,
            *d.disturbance,
            d.v_known,
            d.w,
            tick.estimate.effectiveness,
            tick.seen.excess,
        )
        self._csv.write(",".join(f"{value:.9g}" for value in row) + f",{tick.seen.state}\n")
        if tick.time_s > self._flushed + 0.5:
            self._flushed = tick.time_s
            for file in (self._csv, self._events, self._poses, self._wire):
                file.flush()

    def datagram(self, time_s: float, source: tuple[str, int], target: tuple[str, int], data: bytes) -> None:
        """One datagram of the simulated network: MAVLink goes to the .tlog, a radio's frame is a line of hex."""
        if target == MODULE:
            self._wire.write(f"{time_s:.6f} {data.hex(' ')}\n".encode())
        elif self._mavlink_port in (source[1], target[1]):
            self._wire.write(struct.pack(">Q", round(time_s * 1e6)) + data)

    def pose(self, pose: Pose) -> None:
        """One pose as it came; `pose.kind = "csv"` plays the folder's again."""
        self._poses.write(
            csv_codec.encode(csv_codec.Row(pose.time_s, pose.arrival_s, pose.position_ned, pose.attitude))
        )

    def event(self, line: str) -> None:
        """One line for the operator."""
        self._events.write(line + "\n")

    def close(self, facts: dict[str, Any], world: World) -> None:
        """Write the result and close everything."""
        for file in (self._csv, self._events, self._poses, self._wire):
            file.close()
        result = {**facts, "sim": msgspec.to_builtins(world)}
        (self.path / "summary.json").write_text(json.dumps(result, indent=2) + "\n")


def _opened(path: Path) -> TextIO:
    return path.open("w", encoding="utf-8")
