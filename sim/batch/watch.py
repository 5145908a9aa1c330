"""The certificate in N flights: :class:`groundstation.core.control.certificate.Watch` on arrays of shape (N,).

The same V_m against the same bound, and how long that lasts; nobody is told. Written again is only what the watch
does step by step with numbers of one flight (a test holds both against each other).
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from groundstation.core import NOISE_POSES
from groundstation.core.control import LASTING_S, Law, measure, noise_power
from groundstation.core.messages import Decision

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]


class BatchWatch:
    """Looks at every command of N flights, and changes nothing."""

    def __init__(self, count: int, law: Law, period_s: float) -> None:
        """Take the gains, and the time from each command to the next [s]."""
        self._law, self._period, self._measure = law, period_s, measure(law)
        self._poses, self._counted_s = np.zeros(count, np.intp), np.zeros(count)
        self._power: Any = np.full(count, self._measure.decrease.power)
        self._v: Any = None
        self._fall: Any = None
        self._clamped: Any = None
        self._excess, self._peak = np.zeros(count), np.zeros(count)
        self._above_s, self._outside_s = np.zeros(count), np.zeros(count)
        self._violated, self._suspended, self._looks = np.zeros(count), np.zeros(count), 0

    def pose(self, who: Index, stamp_s: Array, noise_m2: Array) -> None:
        """One pose of each of the vehicles ``who``; D follows the noise of everyone's as measured [m², per axis]."""
        self._poses[who] += 1
        turn = self._poses[who] % NOISE_POSES == 1
        if not turn.any():
            return
        who, stamp_s = who[turn], stamp_s[turn]
        again = self._poses[who] > 1
        some, now = who[again], stamp_s[again]
        noise_m: Any = np.sqrt(noise_m2[some])
        interval_s: Any = (now - self._counted_s[some]) / NOISE_POSES
        self._power[some] = self._measure.decrease.power + noise_power(self._law, noise_m, interval_s)
        self._counted_s[who] = stamp_s

    def look(self, decision: Decision) -> None:
        """One command of each."""
        self._looks += 1
        v, fall = self._measure.of(decision.diagnostics)
        if self._v is not None and self._period < LASTING_S:  # after longer gaps each look begins anew
            self._see(v, fall, decision.diagnostics.b_hat)
        self._v, self._fall, self._clamped = v, fall, decision.saturated

    def _see(self, v: Any, fall: Any, b_hat: Any) -> None:
        dt, known, clamped = self._period, self._measure.decrease, self._clamped
        fallen = 0.5 * dt * (fall + self._fall)
        excess = self._excess + (v - self._v) + known.share * fallen - self._power * dt
        # The highest V since it has been above its bound.
        self._peak = np.maximum(np.where(self._excess == 0.0, 0.0, self._peak), v)
        self._excess = np.minimum(np.maximum(excess, 0.0), self._peak + known.spare)
        # While adaptation is suspended nothing is promised, so that time does not count.
        above = self._excess > known.spare
        self._above_s = np.where(above, self._above_s + np.where(clamped, 0.0, dt), 0.0)
        x, y, z = b_hat
        beyond = x * x + y * y + z * z > self._measure.b_bound2
        self._outside_s = np.where(beyond, self._outside_s + dt, 0.0)
        violated = np.maximum(self._above_s, self._outside_s) >= LASTING_S
        self._violated += violated
        self._suspended += clamped & ~violated

    def shares(self) -> tuple[Array, Array]:
        """Shares of the commands at which the bound was violated, and suspended [-]."""
        looks = max(self._looks, 1)
        return self._violated / looks, self._suspended / looks
