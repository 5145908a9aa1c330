"""The truth about N vehicles: plants, wind and cameras. What :mod:`sim.stage` is to one."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from groundstation.control.model import Drive
from groundstation.ops import arrays
from sim.batch_cameras import Cameras
from sim.columns import pick
from sim.draws import stream
from sim.plant import Body, Physics, moved
from sim.referee import CRASH_M
from sim.wind import begun, cell, felt, stirred
from sim.world import World

Array = npt.NDArray[np.float64]
OPS = arrays()
BODY = 14
"""Numbers that make a Body."""
BLOCK = 512
"""Grid steps of turbulence drawn at a time."""


class Fleet:
    """The truth about N vehicles, one frame of commands at a time.

    ``track`` has shape (steps + 1, 14, N): the vehicles at the start of each plant step of the frame, and at its end.
    """

    def __init__(
        self,
        worlds: Sequence[World],
        seeds: Sequence[int],
        *,
        duration_s: float,
        release_s: float,
        steps: int,
        told_latency_s: float,
    ) -> None:
        """``release_s`` [s] is when the flights begin, counted from the start of the cameras."""
        first = worlds[0]
        self.count = n = len(worlds)

        def column(name: str) -> Any:
            return np.array([getattr(w, name) for w in worlds], np.float64)

        self._physics: Any = Physics(
            column("mass_kg"),
            column("thrust_lag_s"),
            column("rate_lag_s"),
            column("drag_per_s"),
            column("rate_leak"),
            first.gravity,
        )
        self._thrust_max, self._thrust_curve = column("thrust_max_n"), column("thrust_curve")
        self._gain, self._sag = column("thrust_gain"), column("thrust_sag")
        self._limits = np.radians(np.array([w.rate_limits_deg_s for w in worlds])).T
        self._floor = column("floor_z_m")
        self.start = np.array([w.start_ned for w in worlds]).T
        self._steps, self._step_s = steps, first.frame_period_s / steps
        self.track = np.zeros((steps + 1, BODY, n))
        self.track[-1, :3] = self.start
        self.track[-1, 6] = 1.0
        self.track[-1, 10] = column("start_thrust") * self._physics.mass_kg * first.gravity
        self._felt = np.zeros((steps, 3, n))
        self._thrust_command: Any = np.zeros(n)
        self._rate_command: Any = (self._thrust_command,) * 3
        self._gust_hz, self._wind_step_s = column("wind_gust_hz"), column("wind_step_time_s")
        self._mean, self._gust, self._wind_step = (
            np.array([getattr(w, key) for w in worlds]).T for key in ("wind_mean", "wind_gust", "wind_step")
        )
        self._turbulence = column("wind_turbulence")
        self._normals = [stream(seed, "turbulence") for seed in seeds]
        self._block: Array = np.empty((0, 3, n))
        self._grid = -1
        self._eddies: Any = None
        self._cameras = Cameras(worlds, seeds, duration_s, release_s, told_latency_s)
        self.arrived = self._cameras.arrived
        losses = [stream(seed, "frame loss").random(int(duration_s / first.frame_period_s) + 8) for seed in seeds]
        self._frame_lost = column("frame_loss") > np.array(losses).T

    def hold(self, time_s: float) -> None:
        """A frame before the release: nothing moves, but the cameras run."""
        body = _body(self.track[-1])
        self._cameras.expose(np.array([time_s + self._steps * self._step_s]), lambda _, who, __: pick(body, who))

    def command(self, frame: int, time_s: float, drive: Drive, told_full_n: float, told_curve: float) -> None:
        """Frame number ``frame`` leaves at ``time_s`` after the release; some vehicles never hear it.

        The full signal is told to give ``told_full_n`` [N], on the curve ``told_curve`` (links/thrust_curve.py).
        """
        told, straight = np.clip(np.asarray(drive.thrust) / told_full_n, 1e-30, 1.0), 1.0 - told_curve
        signal = 2.0 * told / (straight + np.sqrt(straight * straight + 4.0 * told_curve * told))
        # On the wire both are single-precision numbers.
        signal = signal.astype(np.float32).astype(np.float64)
        share = self._thrust_curve * signal * signal + (1.0 - self._thrust_curve) * signal
        rates = [np.asarray(rate).astype(np.float32).astype(np.float64) for rate in drive.rates]
        gain = self._gain * (1.0 - self._sag * min(1.0, time_s / 60.0))
        # The first frame is what releases the vehicle; losses count from the second.
        lost = self._frame_lost[frame - 1] & (frame > 0)
        self._thrust_command = np.where(lost, self._thrust_command, gain * share * self._thrust_max)
        x, y, z = (
            np.where(lost, old, np.clip(new, -limit, limit))
            for old, new, limit in zip(self._rate_command, rates, self._limits, strict=True)
        )
        self._rate_command = (x, y, z)

    def fly(self, time_s: float) -> None:
        """All steps of the frame that begins at ``time_s`` after the release, and the pictures taken meanwhile."""
        h, track = self._step_s, self.track
        track[0] = track[-1]
        starts: Array = time_s + np.arange(self._steps, dtype=np.float64) * h
        for k, start in enumerate(starts.tolist()):
            self._felt[k] = self.wind(start + 0.5 * h)
            now: Any = moved(
                OPS,
                _body(track[k]),
                self._thrust_command,
                self._rate_command,
                tuple(self._felt[k]),
                h,
                self._physics,
            )
            _write(track[k + 1], now)

        def seen(step: Any, who: Any, taken: Any) -> Any:
            felt_then = self._felt[step, :, who].T
            physics = Physics(*(x[who] if isinstance(x, np.ndarray) else x for x in self._physics))
            return moved(
                OPS,
                _body(track[step, :, who].T),
                self._thrust_command[who],
                pick(self._rate_command, who),
                tuple(felt_then),
                np.maximum(taken - starts[step], 1e-12),
                physics,
            )

        self._cameras.expose(starts + h, seen)

    def wind(self, time_s: float) -> Any:
        """b [m/s², NED] at ``time_s`` after the release, of shape (3, N); questions go forward in time."""
        sine = np.sin(2.0 * np.pi * self._gust_hz * time_s)
        steady = self._mean + self._gust * sine + self._wind_step * (time_s >= self._wind_step_s)
        if not self._turbulence.any():
            return steady
        while self._grid < cell(time_s):
            self._grid += 1
            row = self._grid % BLOCK
            if row == 0:
                self._block = np.stack([g.standard_normal((BLOCK, 3)) for g in self._normals], axis=2)
            normals: Any = tuple(self._block[row])
            self._eddies = begun(normals) if self._eddies is None else stirred(self._eddies, normals)
        return steady + felt(self._eddies, self._turbulence)

    def crashed(self, steps: int) -> Any:
        """Who has hit the floor or left every room within so many ``steps`` of this frame.

        They are put back to their start, out of the way.
        """
        x, y, z = np.moveaxis(self.track[1 : steps + 1, :3], 1, 0)
        x0, y0, z0 = self.start
        far = (x - x0) ** 2 + (y - y0) ** 2 + (z - z0) ** 2 > CRASH_M**2
        down = ((z >= self._floor - 1e-9) | far | ~np.isfinite(x + y + z)).any(axis=0)
        if down.any():
            end = self.track[-1]
            end[:, down] = 0.0
            end[:3, down] = self.start[:, down]
            end[6, down] = 1.0
        return down


def _body(numbers: Any) -> Any:
    """The Body of 14 rows, without a copy."""
    px, py, pz, vx, vy, vz, w, x, y, z, thrust, p, q, r = numbers
    return Body((px, py, pz), (vx, vy, vz), (w, x, y, z), thrust, (p, q, r))


def _write(rows: Array, body: Any) -> None:
    """Put a Body into 14 rows."""
    for row, values in zip(
        rows, (*body.position, *body.velocity, *body.attitude, body.thrust, *body.rates), strict=True
    ):
        row[...] = values
