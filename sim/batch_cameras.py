"""The poses of N vehicles: true at their exposures, noisy, late, some lost. What :mod:`sim.mocap` does for one."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from groundstation.so3 import turned
from sim.columns import pick
from sim.draws import stream
from sim.world import World

Array = npt.NDArray[np.float64]
Step = Callable[[Any, Any], Any]
"""``step(who, h)``: where the vehicles ``who`` are ``h`` [s] later, as a Body."""


class Cameras:
    """The poses of N vehicles: true at their exposures, delivered later or never."""

    def __init__(self, worlds: Sequence[World], seeds: Sequence[int], duration_s: float, release_s: float) -> None:
        """Draw every pose's noise and fate as :class:`sim.mocap.Mocap` does."""
        first = worlds[0]
        n = len(worlds)
        self.period = 1.0 / first.pose_rate_hz
        phase = np.array([stream(seed, "phase").random() for seed in seeds]) * self.period
        self.next_s = phase - release_s
        self._number = np.zeros(n, int)
        poses = int((duration_s + release_s) / self.period) + 4
        self._noise = np.stack([stream(seed, "noise").standard_normal((poses, 6)) for seed in seeds], axis=2)
        luck = np.stack([stream(seed, "pose loss").random(poses) for seed in seeds], axis=1)
        self._lost = luck < np.array([w.pose_loss for w in worlds])
        self._sigma = np.array([w.pose_noise_m for w in worlds])
        self._sigma_attitude = np.array([w.attitude_noise_rad for w in worlds])
        self.latency = np.array([w.pose_latency_s for w in worlds])
        self._outage = np.array([w.outage_s for w in worlds])
        self._outage_period = np.array([w.outage_period_s for w in worlds])
        self.pending: list[tuple[Array, Any, Any, Any, Any]] = []
        """(arrival, who, stamp, position, attitude) of poses under way, in order of exposure."""

    def expose(self, time_s: float, h: float, body: Any, step: Step) -> None:
        """Take the pictures that fall within [time_s, time_s + h)."""
        while (due := self.next_s < time_s + h - 1e-12).any():
            self._expose(np.flatnonzero(due), time_s, body, step)

    def _expose(self, who: Any, time_s: float, body: Any, step: Step) -> None:
        """Take one picture of each of the vehicles ``who``."""
        taken = self.next_s[who]
        held = time_s < 0.0
        seen: Any = pick(body, who) if held else step(who, np.maximum(taken - time_s, 1e-12))
        number = self._number[who]
        normals, lost = self._noise[number, :, who], self._lost[number, who]
        self.next_s[who] += self.period
        self._number[who] += 1
        period, outage = self._outage_period[who], self._outage[who]
        lost |= (outage > 0.0) & (taken >= 0.0) & (taken % period >= period - outage)
        n, a = self._sigma[who], self._sigma_attitude[who]
        position = tuple(p + n * normals[:, i] for i, p in enumerate(seen.position))
        angle: Any = tuple(a * normals[:, 3 + i] for i in range(3))
        attitude: Any = turned(seen.attitude, angle)
        kept = ~lost
        if kept.any():
            self.pending.append(
                (
                    (taken + self.latency[who])[kept],
                    who[kept],
                    taken[kept],
                    tuple(p[kept] for p in position),
                    tuple(q[kept] for q in attitude),
                )
            )

    def arrived(self, time_s: float) -> list[tuple[Any, Any, Any, Any]]:
        """(who, stamp, position, attitude) of what has arrived by ``time_s``, in order of exposure."""
        out, rest = [], []
        for arrival, who, stamp, position, attitude in self.pending:
            now = arrival <= time_s
            if now.all():
                out.append((who, stamp, position, attitude))
                continue
            if now.any():
                out.append((who[now], stamp[now], pick(position, now), pick(attitude, now)))
            late = ~now
            rest.append((arrival[late], who[late], stamp[late], pick(position, late), pick(attitude, late)))
        self.pending = rest
        return out
