"""Pose latency: how much later poses are than told, by the autopilot's own attitude. Sans-IO.

A pose that is stamped δ too late shows the vehicle as it was δ before its stamp. While the vehicle turns, gravity then
lies elsewhere in its axes than the autopilot has it at that instant: by -δ ġ, where ġ = -ω × g follows from the
autopilot's own rates. δ is what explains most of the difference, by least squares over the last seconds. What differs
slowly (a body mounted askew, an estimate that leans) is taken out of both sides first; a heading takes no part.
"""

import math
from collections import deque
from collections.abc import Callable

from groundstation.core.geometry import Quat
from groundstation.core.messages import Pose
from links.core import Attitude

MEMORY_S = 20.0
"""What is older counts less [s]."""
SLOW_S = 0.5
"""What differs for longer than this is no latency [s]."""
GAP_S = 0.13
"""Between two poses further apart nothing is known [s]."""
SURE = 4.0
"""So many deviations are no chance: there are many looks in a flight."""
LEAST_S = 0.008
"""Less is left to the noise of clocks, and to autopilots that tell what their last loop had [s]."""
AGAIN_S = 0.010
"""It is told again where it has changed by so much [s]."""
LOOKS = 100
"""Instants that are looked at, before anything is said."""
KEPT = 32
"""So many attitudes are kept until a pose of their instant comes."""

_Level = tuple[float, float]


class PoseLatency:
    """One vehicle's. Times are on the event loop's clock [s]."""

    def __init__(self, memory_s: float = MEMORY_S) -> None:
        """Nothing heard; what is older than ``memory_s`` [s] counts less."""
        self._memory_s = memory_s
        self._told: deque[Attitude] = deque(maxlen=KEPT)
        self._last: tuple[float, _Level] | None = None
        self._at_s = -math.inf
        self._slow = (0.0, 0.0, 0.0, 0.0)
        """Averages of difference and of ġ, x and y of each."""
        self._moved = self._both = self._off = 0.0
        """Σ ġ², -Σ e ġ, Σ e² over the last seconds."""
        self._count = 0.0
        self._said_s = 0.0

    def attitude(self, told: Attitude) -> None:
        """What the vehicle tells of itself; nothing where it tells no rates, as nobody tells either when that was."""
        if told.rates_rad_s is None:
            return
        if not self._told or told.time_s > self._told[-1].time_s:
            self._told.append(told)
        elif told.time_s < self._told[-1].time_s - GAP_S:  # its clock is another one
            self._told.clear()

    def pose(self, pose: Pose) -> None:
        """A pose has come: look at all that was told of the time since the one before."""
        time_s, (x, y) = pose.time_s, _level(pose.attitude)
        last, self._last = self._last, (time_s, (x, y))
        told = self._told
        if last is None or not 0.0 < time_s - last[0] <= GAP_S:
            return
        since, (x0, y0) = last
        while told and told[0].time_s <= time_s:
            one = told.popleft()
            share = (one.time_s - since) / (time_s - since)
            if share > 0.0:
                self._look(one, x0 + share * (x - x0), y0 + share * (y - y0))

    def _look(self, told: Attitude, x: float, y: float) -> None:
        """At one instant, at which the poses have gravity along ``x`` and ``y`` of the body."""
        w, i, j, k = told.attitude
        a, b, c = 2.0 * (i * k - w * j), 2.0 * (j * k + w * i), 1.0 - 2.0 * (i * i + j * j)
        assert told.rates_rad_s is not None, "others are not kept"
        p, q, r = told.rates_rad_s
        now = (x - a, y - b, r * b - q * c, p * c - r * a)
        dt, self._at_s = told.time_s - self._at_s, told.time_s
        if dt > SLOW_S:
            self._slow = now
            return
        gain = dt / SLOW_S
        e, f, u, v = self._slow
        e, f, u, v = e + gain * (now[0] - e), f + gain * (now[1] - f), u + gain * (now[2] - u), v + gain * (now[3] - v)
        self._slow = e, f, u, v
        e, f, u, v = now[0] - e, now[1] - f, now[2] - u, now[3] - v
        keep = 1.0 - dt / self._memory_s
        self._moved = keep * self._moved + u * u + v * v
        self._both = keep * self._both - e * u - f * v
        self._off = keep * self._off + e * e + f * f
        self._count = keep * self._count + 1.0

    @property
    def estimate(self) -> tuple[float, float] | None:
        """How much later poses are than told, below 0 earlier, and one deviation of that [s]; None at first."""
        if self._count < LOOKS or self._moved <= 0.0:
            return None
        late = self._both / self._moved
        return late, math.sqrt(max(self._off / self._moved - late * late, 0.0) / self._count)

    @property
    def late_s(self) -> float | None:
        """The same [s]; None while that could be chance, or little."""
        late, spread = self.estimate or (0.0, math.inf)
        return late if abs(late) > max(LEAST_S, SURE * spread) else None

    def describe_news(self, clock_off_s: Callable[[], float]) -> str | None:
        """A line for the operator, where there is something that was not told yet.

        ``clock_off_s`` tells by how much the vehicle's clock may be taken wrong [s]: half of a round trip.
        """
        late = self.late_s
        if late is None or abs(late - self._said_s) < AGAIN_S or abs(late) < LEAST_S + clock_off_s():
            return None
        self._said_s = late
        word = "later" if late > 0.0 else "earlier"
        found = f"poses seem {abs(late) * 1e3:.0f} ms {word} than told, by the vehicle's own attitude"
        return f"{found}: measure their latency"


def _level(q: Quat) -> _Level:
    """Gravity along x and y of the body, of length 1 in all."""
    w, x, y, z = q
    return 2.0 * (x * z - w * y), 2.0 * (y * z + w * x)
