"""The poses of N vehicles: true at their exposures, noisy, late, some lost. What sim/trackers/mocap.py does for one."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from groundstation.core.geometry import turned
from sim.world import World, generator

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]
Seen = Callable[[Index, Index, Array], Any]
"""``seen(step, who, taken_s)``: the Body of each vehicle of ``who`` at ``taken_s`` [s], in that step of the frame."""


class Cameras:
    """The poses of N vehicles: true at their exposures, delivered later or never."""

    def __init__(
        self,
        worlds: Sequence[World],
        seeds: Sequence[int],
        duration_s: float,
        release_s: float,
        told_latency_s: float,
    ) -> None:
        """Draw every pose's noise and fate as :class:`sim.trackers.mocap.Mocap` does.

        ``told_latency_s`` [s] is what the pose source takes off a pose's arrival to stamp it.
        """
        n = len(worlds)
        self._period = 1.0 / worlds[0].pose_rate_hz
        phase = np.array([generator(seed, "phase").random() for seed in seeds]) * self._period
        self._next_s = phase - release_s
        self._number = np.zeros(n, int)
        poses = int((duration_s + release_s) / self._period) + 4
        self._noise = np.stack([generator(seed, "noise").standard_normal((poses, 6)) for seed in seeds], axis=2)
        luck = np.stack([generator(seed, "pose loss").random(poses) for seed in seeds], axis=1)
        self._lost = luck < np.array([w.pose_loss for w in worlds])
        self._sigma = np.array([w.pose_noise_m for w in worlds])
        self._sigma_attitude = np.array([w.attitude_noise_rad for w in worlds])
        self._latency = np.array([w.pose_latency_s for w in worlds])
        self._told_latency = told_latency_s
        self._outage = np.array([w.outage_s for w in worlds])
        self._outage_period = np.array([w.outage_period_s for w in worlds])
        self._who: Index = np.empty(0, int)
        self._under_way: Array = np.empty((9, 0))
        """Arrival, stamp, position, attitude of the poses under way, and ``_who`` they show, in order of exposure."""

    def expose(self, ends: Array, seen: Seen) -> None:
        """Take the pictures of one frame, whose steps end at ``ends`` [s after the release]."""
        limits = ends - 1e-12
        while (due := self._next_s < limits[-1]).any():
            who = np.flatnonzero(due)
            taken = self._next_s[who]
            self._expose(who, taken, seen(np.searchsorted(limits, taken, side="right"), who, taken))

    def _expose(self, who: Index, taken: Array, body: Any) -> None:
        """Take one picture of each of the vehicles ``who``."""
        number = self._number[who]
        normals, lost = self._noise[number, :, who].T, self._lost[number, who]
        self._next_s[who] += self._period
        self._number[who] += 1
        period, outage = self._outage_period[who], self._outage[who]
        lost |= (outage > 0.0) & (taken >= 0.0) & (taken % period >= period - outage)
        n, a = self._sigma[who], self._sigma_attitude[who]
        position = [p + n * normals[i] for i, p in enumerate(body.position)]
        angle: Any = tuple(a * normals[3 + i] for i in range(3))
        attitude: Any = turned(body.attitude, angle)
        latency = self._latency[who]
        # Exact where the source is told the truth: a pose is then stamped with its exposure.
        stamp = np.where(latency == self._told_latency, taken, taken + (latency - self._told_latency))
        kept = ~lost
        self._who = np.concatenate([self._who, who[kept]])
        pose = np.stack([taken + latency, stamp, *position, *attitude])
        self._under_way = np.concatenate([self._under_way, pose[:, kept]], axis=1)

    def arrived(self, time_s: float) -> Iterator[tuple[Index, Array, Any, Any]]:
        """(who, stamp, position, attitude) of what has arrived by ``time_s``.

        The first pose of each vehicle, then the second of each that has one, and so on.
        """
        now = self._under_way[0] <= time_s
        who, poses = self._who[now], self._under_way[:, now]
        self._who, self._under_way = self._who[~now], self._under_way[:, ~now]
        while who.size:
            _, first = np.unique(who, return_index=True)
            stamp, x, y, z, *attitude = poses[1:, first]
            yield who[first], stamp, (x, y, z), tuple(attitude)
            who, poses = np.delete(who, first), np.delete(poses, first, axis=1)
