"""Latency of the poses and of the vehicle's response beyond the configured one, by least squares.

Sans-IO.

ω are the body rates of the model, or those measured by the autopilot's gyros. They turn the
direction of gravity in the body's axes by ġ = -ω × g. Poses that are late by δ have this direction
off by e = -δ ġ, and δ is the least-squares fit of that over the last seconds. Slow differences (a
mounting offset, a leaning attitude estimate) are taken out of both sides first. The heading takes
no part.

Against the model, δ is the latency of the poses plus lag and delay of the body rates. Against the
autopilot's attitude, δ is the latency of the poses alone.
"""

import math
from collections import deque

from groundstation.core.estimation import SIGNIFICANT
from groundstation.core.geometry import Quat, Vec3, interpolate, third_row
from groundstation.core.health.pose_response import POSE_GAP_S
from groundstation.core.messages import Pose, Sentence, notice
from links.core import Attitude
from links.text import to_ms

MEMORY_S = 20.0
"""Time constant of the fit [s]: a minute of flight resolves 1 ms."""
SLOW_S = 0.5
"""Time constant of the means that are taken out of both sides [s]: longer than any latency, shorter
than a drift."""
REPORT_S = 0.010
"""Least latency of the response, and least change of any latency, that is reported [s]: lag and
delay of the body rates describe a vehicle no better."""
POSE_REPORT_S = 0.008
"""Least latency against the autopilot's attitude that is reported [s]: an autopilot sends the
result of its last loop, which is that old."""
RESPONSE_SAMPLES = 200
"""Samples before a latency of the response is reported [-]: 4 s at 50 Hz."""
SAMPLE_S = 0.02
"""Time of one independent sample [s]: poses closer than this count as a part of one."""
POSE_SAMPLES = 100
"""Samples before a latency against the autopilot's attitude is reported [-]: 10 s at 10 Hz."""
ATTITUDES_KEPT = 32
"""Attitudes that are kept until a pose of their instant arrives [-]: .6 s at 50 Hz."""

Signals = tuple[float, float, float, float]
"""e and ġ, x and y of each."""


class LatencyFit:
    """Least-squares fit of δ in e = -δ ġ."""

    def __init__(self, memory_s: float, least_samples: float) -> None:
        """``memory_s`` is the time constant of forgetting [s], ``least_samples`` are needed for an
        estimate.
        """
        self._memory_s, self._least_samples = memory_s, least_samples
        self._slow: Signals = (0.0, 0.0, 0.0, 0.0)
        """Slow means of the signals."""
        self._rate2 = self._product = self._error2 = 0.0
        """Fading sums of ġ², -e ġ and e²."""
        self._samples = 0.0

    def begin(self, now: Signals) -> None:
        """Restart the slow means at the signals ``now``."""
        self._slow = now

    def add(self, dt: float, samples: float, now: Signals) -> None:
        """Take the signals ``now``, ``dt`` [s] after the last ones; they count as ``samples``
        [-].
        """
        self._slow = slow = interpolate(self._slow, now, dt / SLOW_S)
        e, f, u, v = (x - mean for x, mean in zip(now, slow, strict=True))
        keep = 1.0 - dt / self._memory_s
        self._rate2 = keep * self._rate2 + u * u + v * v
        self._product = keep * self._product - e * u - f * v
        self._error2 = keep * self._error2 + e * e + f * f
        self._samples = keep * self._samples + samples

    @property
    def estimate(self) -> tuple[float, float] | None:
        """Latency and its standard deviation [s]; None at first."""
        if self._samples < self._least_samples or self._rate2 <= 0.0:
            return None
        late = self._product / self._rate2
        return late, math.sqrt(max(self._error2 / self._rate2 - late * late, 0.0) / self._samples)

    def late_s(self, least_s: float) -> float | None:
        """Latency [s]; None if it may be chance, or is at most ``least_s`` [s]."""
        late, deviation = self.estimate or (0.0, math.inf)
        return late if abs(late) > max(least_s, SIGNIFICANT * deviation) else None


class ResponseLatency:
    """Latency of one vehicle's turns, measured by the poses, behind the modelled ones."""

    def __init__(self) -> None:
        """Begin without a pose."""
        self._model: tuple[float, float] | None = None
        """Direction of gravity by the model, x and y in the body's axes; None before a pose."""
        self._slow_rate = (0.0, 0.0)
        """Slow mean of its rate ġ, x and y [1/s]."""
        self._fit = LatencyFit(MEMORY_S, RESPONSE_SAMPLES)
        self._reported_s = 0.0

    def add_pose(self, attitude: Quat, modelled_turn: Vec3, dt: float) -> None:
        """Take one pose.

        Args:
            attitude: measured attitude, body FRD to world NED.
            modelled_turn: turn by the modelled rates since the pose before, body axes [rad].
            dt: time since the pose before [s].
        """
        a, b, c = third_row(attitude)
        model = self._model
        if model is None or not 0.0 < dt <= POSE_GAP_S:
            self._model = a, b
            self._fit.begin((0.0, 0.0, 0.0, 0.0))
            self._slow_rate = 0.0, 0.0
            return
        p, q, r = modelled_turn
        u, v = (r * b - q * c) / dt, (p * c - r * a) / dt
        # The integrated direction follows the measured one with time constant SLOW_S, which takes
        # the slow part out of their difference; it is taken out of the rate alike. Both take the
        # same way through the fit, so its own slow mean does no harm.
        gain = dt / SLOW_S
        e, f = a - model[0] - dt * u, b - model[1] - dt * v
        self._model = a - (1.0 - gain) * e, b - (1.0 - gain) * f
        self._slow_rate = s, t = interpolate(self._slow_rate, (u, v), gain)
        self._fit.add(dt, min(dt / SAMPLE_S, 1.0), (e, f, u - s, v - t))

    @property
    def late_s(self) -> float | None:
        """Latency beyond the configured one [s].

        None if it is too small to report, or may be chance.
        """
        return self._fit.late_s(REPORT_S)

    def describe_news(self, poses: tuple[float, float] | None) -> Sentence | None:
        """Sentence for the operator about a latency that was not reported yet.

        ``poses`` is the latency of the poses alone beyond the configured one, and its standard
        deviation [s]; None where the autopilot's attitude does not determine it.
        """
        late = self.late_s
        if late is None:
            return None
        rest = late - (poses[0] if poses else 0.0)
        if abs(rest) < REPORT_S or not _is_new(rest, self._reported_s):
            return None
        self._reported_s = rest
        id = "latency.total" if poses is None else "latency.vehicle"
        return notice(id, late=describe_latency(rest), late_ms=to_ms(rest))


class PoseLatency:
    """Latency of one vehicle's poses behind its autopilot's attitude.

    Times are on the event loop's clock [s].
    """

    def __init__(self, memory_s: float = MEMORY_S) -> None:
        """Begin without a pose; ``memory_s`` is the time constant of forgetting [s]."""
        self._attitudes: deque[Attitude] = deque(maxlen=ATTITUDES_KEPT)
        self._last: tuple[float, tuple[float, float]] | None = None
        """Instant of the last pose [s], and its direction of gravity, x and y in the body's
        axes."""
        self._at_s = -math.inf
        """Instant of the last attitude that was compared [s]."""
        self._fit = LatencyFit(memory_s, POSE_SAMPLES)
        self._reported_s = 0.0

    def add_attitude(self, reported: Attitude) -> None:
        """Take an attitude reported by the autopilot.

        One without body rates came by a radio, which does not send its instant, and is ignored.
        """
        if reported.rates_rad_s is None:
            return
        if not self._attitudes or reported.time_s > self._attitudes[-1].time_s:
            self._attitudes.append(reported)
        elif reported.time_s < self._attitudes[-1].time_s - POSE_GAP_S:  # its clock was restarted
            self._attitudes.clear()

    def add_pose(self, pose: Pose) -> None:
        """Take one pose; compare it with all attitudes since the pose before."""
        time_s, (x, y, _) = pose.time_s, third_row(pose.attitude)
        last, self._last = self._last, (time_s, (x, y))
        attitudes = self._attitudes
        if last is None or not 0.0 < time_s - last[0] <= POSE_GAP_S:
            return
        since, before = last
        while attitudes and attitudes[0].time_s <= time_s:
            reported = attitudes.popleft()
            share = (reported.time_s - since) / (time_s - since)
            if share > 0.0:
                self._compare(reported, *interpolate(before, (x, y), share))

    def _compare(self, reported: Attitude, x: float, y: float) -> None:
        """Compare one attitude with the poses, which have gravity along ``x`` and ``y`` of the body
        at its instant.
        """
        a, b, c = third_row(reported.attitude)
        assert reported.rates_rad_s is not None, "others are not kept"
        p, q, r = reported.rates_rad_s
        now = (x - a, y - b, r * b - q * c, p * c - r * a)
        dt, self._at_s = reported.time_s - self._at_s, reported.time_s
        if dt > SLOW_S:
            self._fit.begin(now)
        else:
            self._fit.add(dt, 1.0, now)

    @property
    def estimate(self) -> tuple[float, float] | None:
        """Latency beyond the configured one and its standard deviation [s]; None at first."""
        return self._fit.estimate

    @property
    def late_s(self) -> float | None:
        """Latency beyond the configured one [s].

        None if it is too small to report, or may be chance.
        """
        return self._fit.late_s(POSE_REPORT_S)

    def describe_news(self, clock_error_s: float) -> Sentence | None:
        """Sentence for the operator about a latency that was not reported yet.

        ``clock_error_s`` is the largest error of the autopilot's clock [s]: half of a round trip.
        """
        late = self.late_s
        if (
            late is None
            or not _is_new(late, self._reported_s)
            or abs(late) < POSE_REPORT_S + clock_error_s
        ):
            return None
        self._reported_s = late
        return notice("latency.poses", late=describe_latency(late), late_ms=to_ms(late))


def _is_new(late_s: float, reported_s: float) -> bool:
    """Return whether a latency differs from the reported one [s] by ``REPORT_S`` and by half.

    A growing one, as of poses whose axes are turned, is not reported every 10 ms.
    """
    return abs(late_s - reported_s) >= max(REPORT_S, 0.5 * abs(reported_s))


def describe_latency(late_s: float) -> str:
    """Return the latency in words; below 0 it is earlier [s]."""
    return f"{to_ms(abs(late_s)):.0f} ms {'later' if late_s > 0.0 else 'earlier'}"
