"""Latency of the poses and of the vehicle's answer beyond what is configured, by least squares. Sans-IO.

ω is what the model makes of the commands, or what the autopilot's gyros measure. Gravity lies where these rates have
taken it; what the poses show comes δ later, so that gravity lies elsewhere in the body's axes by -δ ġ, ġ = -ω × g. δ is
what explains most of the difference over the last seconds. What differs slowly (a body mounted askew, an estimate that
leans) is taken out of both sides first; the heading takes no part.

Against the model δ is the latency of the poses and the lag and delay of the rates in one; against the autopilot's
attitude it is the latency of the poses alone.
"""

import math
from collections import deque
from collections.abc import Callable

from groundstation.core.geometry import Quat, Vec3, third_row
from groundstation.core.messages import Pose, Sentence, notice
from links.core import Attitude

GAP_S = 0.26
"""Interval of poses after which the fit begins anew [s]: flight.coast_s."""
MEMORY_S = 20.0
"""Time constant of the fit [s]: a minute of flight tells 1 ms."""
SLOW_S = 0.5
"""Time constant above which a difference is no latency [s]."""
SURE = 4.0
"""Standard deviations of a latency that is told [-]: a flight has thousands of looks."""
RESPONSE_LEAST_S = 0.010
"""Least latency of the response that is told [s]: no first-order lag with a delay describes rates better."""
AGAIN_S = 0.010
"""Change of a latency after which it is told again [s]."""
RESPONSE_LOOKS = 200
"""Poses before a latency of the response is told [-]: 4 s at 50 Hz."""
LOOK_S = 0.02
"""Interval of poses below which neighbours show the same turn [s]: they count as one look per so long."""
POSE_LEAST_S = 0.008
"""Least latency against the autopilot's attitude that is told [s]: autopilots send what their last loop had."""
POSE_LOOKS = 100
"""Attitudes before a latency against the autopilot's is told [-]: 10 s at 10 Hz."""
KEPT = 32
"""Attitudes that wait for a pose of their instant [-]."""


Sides = tuple[float, float, float, float]


class LatencyFit:
    """The time by which one signal e comes later than another, by ġ of that: least squares of e = -δ ġ."""

    def __init__(self, memory_s: float, looks: float) -> None:
        """Nothing seen; what is older than ``memory_s`` [s] counts less, and ``looks`` are needed to say anything."""
        self._memory_s, self._looks = memory_s, looks
        self._slow = (0.0, 0.0, 0.0, 0.0)
        """Averages of e and of ġ, x and y of each."""
        self._moved = self._both = self._off = 0.0
        """Σ ġ², -Σ e ġ, Σ e² over the last seconds."""
        self._count = 0.0

    def begin(self, now: Sides) -> None:
        """Begin again with what differs slowly: e and ġ, x and y of each."""
        self._slow = now

    def add(self, dt: float, looks: float, now: Sides) -> None:
        """Take e and ġ, x and y of each, ``dt`` [s] after the last ones; they count as so many looks."""
        gain = dt / SLOW_S
        (a, b, c, d), (e, f, u, v) = self._slow, now
        self._slow = a, b, c, d = a + gain * (e - a), b + gain * (f - b), c + gain * (u - c), d + gain * (v - d)
        e, f, u, v = e - a, f - b, u - c, v - d
        keep = 1.0 - dt / self._memory_s
        self._moved = keep * self._moved + u * u + v * v
        self._both = keep * self._both - e * u - f * v
        self._off = keep * self._off + e * e + f * f
        self._count = keep * self._count + looks

    @property
    def estimate(self) -> tuple[float, float] | None:
        """The time, below 0 where it comes earlier, and one deviation of that [s]; None at first."""
        if self._count < self._looks or self._moved <= 0.0:
            return None
        late = self._both / self._moved
        return late, math.sqrt(max(self._off / self._moved - late * late, 0.0) / self._count)

    def late_s(self, least_s: float) -> float | None:
        """The same [s]; None while that could be chance, or is not more than ``least_s``."""
        late, spread = self.estimate or (0.0, math.inf)
        return late if abs(late) > max(least_s, SURE * spread) else None


class ResponseLatency:
    """One vehicle's, while it flies. Times are on the event loop's clock [s]."""

    def __init__(self) -> None:
        """Nothing seen."""
        self._model: tuple[float, float] | None = None
        self._slow = (0.0, 0.0)
        self._fit = LatencyFit(MEMORY_S, RESPONSE_LOOKS)
        self._said_s = 0.0

    def pose(self, attitude: Quat, told_turn: Vec3, dt: float) -> None:
        """Take one pose.

        Args:
            attitude: what it shows, body FRD to world NED.
            told_turn: turn by the modelled rates since the pose before, body axes [rad].
            dt: time since the pose before [s].
        """
        a, b, c = third_row(attitude)
        model = self._model
        if model is None or not 0.0 < dt <= GAP_S:
            self._model = a, b
            self._fit.begin((0.0, 0.0, 0.0, 0.0))
            self._slow = 0.0, 0.0
            return
        p, q, r = told_turn
        u, v = (r * b - q * c) / dt, (p * c - r * a) / dt
        # Where these rates take it is drawn to what is seen as slowly as an average forgets: theirs is taken out, too.
        gain = dt / SLOW_S
        e, f = a - model[0] - dt * u, b - model[1] - dt * v
        self._model = a - (1.0 - gain) * e, b - (1.0 - gain) * f
        s, t = self._slow
        self._slow = s, t = s + gain * (u - s), t + gain * (v - t)
        self._fit.add(dt, min(dt / LOOK_S, 1.0), (e, f, u - s, v - t))

    @property
    def late_s(self) -> float | None:
        """How much later it turns than told, below 0 earlier [s]; None while that could be chance, or little."""
        return self._fit.late_s(RESPONSE_LEAST_S)

    def describe_news(self, by_attitude: Callable[[], tuple[float, float] | None]) -> Sentence | None:
        """A sentence for the operator, where there is something that was not told yet.

        ``by_attitude`` tells how much later the poses alone are than told, and its deviation [s]; None where the
        vehicle's own attitude does not show it.
        """
        late = self.late_s
        if late is None:
            return None
        poses = by_attitude()
        rest = late - (poses[0] if poses else 0.0)
        if abs(rest) < RESPONSE_LEAST_S or abs(rest - self._said_s) < AGAIN_S:
            return None
        self._said_s = rest
        if poses is None:
            return notice("latency.total", late=describe_latency(rest), late_ms=1e3 * rest)
        return notice("latency.vehicle", late=describe_latency(rest), late_ms=1e3 * rest)


class PoseLatency:
    """One vehicle's. Times are on the event loop's clock [s]."""

    def __init__(self, memory_s: float = MEMORY_S) -> None:
        """Nothing heard; what is older than ``memory_s`` [s] counts less."""
        self._told: deque[Attitude] = deque(maxlen=KEPT)
        self._last: tuple[float, tuple[float, float]] | None = None
        self._at_s = -math.inf
        self._fit = LatencyFit(memory_s, POSE_LOOKS)
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
        time_s, (x, y, _) = pose.time_s, third_row(pose.attitude)
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
        a, b, c = third_row(told.attitude)
        assert told.rates_rad_s is not None, "others are not kept"
        p, q, r = told.rates_rad_s
        now = (x - a, y - b, r * b - q * c, p * c - r * a)
        dt, self._at_s = told.time_s - self._at_s, told.time_s
        if dt > SLOW_S:
            self._fit.begin(now)
        else:
            self._fit.add(dt, 1.0, now)

    @property
    def estimate(self) -> tuple[float, float] | None:
        """How much later poses are than told, below 0 earlier, and one deviation of that [s]; None at first."""
        return self._fit.estimate

    @property
    def late_s(self) -> float | None:
        """The same [s]; None while that could be chance, or little."""
        return self._fit.late_s(POSE_LEAST_S)

    def describe_news(self, clock_off_s: Callable[[], float]) -> Sentence | None:
        """A sentence for the operator, where there is something that was not told yet.

        ``clock_off_s`` tells by how much the vehicle's clock may be taken wrong [s]: half of a round trip.
        """
        late = self.late_s
        if late is None or abs(late - self._said_s) < AGAIN_S or abs(late) < POSE_LEAST_S + clock_off_s():
            return None
        self._said_s = late
        return notice("latency.poses", late=describe_latency(late), late_ms=1e3 * late)


def describe_latency(late_s: float) -> str:
    """How much later than something else, or earlier where it is below 0 [s], in words."""
    return f"{abs(late_s) * 1e3:.0f} ms {'later' if late_s > 0.0 else 'earlier'}"
