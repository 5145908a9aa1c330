"""What the referee writes down about N flights: errors by the truth, and what the certificate rests on."""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from groundstation.core.control.gains import Law
from groundstation.core.messages.control import Decision, Estimate
from groundstation.core.vehicle.vehicle import Vehicle
from sim.batch.watch import BatchWatch
from sim.runs.referee import ROUNDING_S, SATURATION_FROM_S, SETTLED_M, STEADY_S, sought

STEADY_FROM_S = STEADY_S - ROUNDING_S
Array = npt.NDArray[np.float64]


class Flights(NamedTuple):
    """One figure a flight, arrays of shape (N,); see :class:`sim.runs.referee.Verdict`. Lengths in metres."""

    rms_m: Array
    max_m: Array
    settle_s: Array
    """nan where it never settled."""
    saturated: Array
    lyapunov_start: Array
    lyapunov_floor: Array
    certificate_violated: Array
    certificate_suspended: Array
    b_hat_share_max: Array
    """Largest |b̂| over the flight, in shares of B + ε [-]."""
    thrust_margin_n: Array
    """Least distance of the commanded thrust from either of its limits over the steady part [N]."""
    survived: npt.NDArray[np.bool_]


class Marks:
    """What the referee writes down about N flights."""

    def __init__(self, count: int, duration_s: float, vehicle: Vehicle, law: Law, watch: BatchWatch) -> None:
        """All still fly; ``vehicle`` and ``law`` as told, whose limits and bounds margins are counted from.

        ``watch`` is shown every command.
        """
        self._alive = np.ones(count, bool)
        self._squares, self._max = np.zeros(count), np.zeros(count)
        self._last_far = np.zeros(count)
        self._saturated, self._late, self._steps = np.zeros(count), 0, 0
        self._duration = duration_s
        self._law, self._watch = law, watch
        self._told_kg = vehicle.mass_kg
        self._thrusts = vehicle.thrust_min_n, vehicle.thrust_max_n
        self._margin, self._b_hat = np.full(count, np.inf), np.zeros(count)
        self._v: list[Array] = []

    def lost(self, who: Any) -> None:
        """These flights have failed."""
        self._alive &= ~who

    def command(self, time_s: float, decision: Decision, estimate: Estimate, wind: Array) -> None:
        """One command of each, what it was computed from, and the true disturbance b [m/s², NED] at that instant."""
        self._watch.look(decision)
        law, seen = self._law, decision.diagnostics
        if time_s >= SATURATION_FROM_S:
            self._saturated += decision.saturated
            self._late += 1
        x, y, z = seen.b_hat
        self._b_hat = np.maximum(self._b_hat, x * x + y * y + z * z)
        if 0.0 < time_s < STEADY_FROM_S:
            return
        weight = 0.5 / law.kb if law.kb > 0.0 else 0.0
        wind = sought(wind, estimate, self._told_kg)
        self._v.append(seen.v_known + weight * ((x - wind[0]) ** 2 + (y - wind[1]) ** 2 + (z - wind[2]) ** 2))
        if time_s >= STEADY_FROM_S:
            low, high = self._thrusts
            thrust: Any = decision.drive.thrust
            self._margin = np.minimum(self._margin, np.minimum(thrust - low, high - thrust))

    def steps(self, ends: Array, errors: Array) -> None:
        """The errors [m] of shape (steps, N) after the plant steps that end at ``ends`` [s after the release]."""
        far = errors >= SETTLED_M
        last = ends[ends.size - 1 - np.argmax(far[::-1], axis=0)]
        self._last_far = np.where(far.any(axis=0), last, self._last_far)
        steady = errors[ends >= STEADY_FROM_S]
        for error in steady:
            self._squares += error * error
        if len(steady):
            self._max = np.maximum(self._max, steady.max(axis=0))
            self._steps += len(steady)

    def flights(self) -> Flights:
        """The figures; nan for those that crashed."""
        law = self._law
        nan = np.where(self._alive, 0.0, np.nan)
        settled = np.where(self._last_far < self._duration - 0.01, self._last_far, np.nan)
        violated, suspended = self._watch.shares()
        floor = np.full(nan.size, np.nan)
        if len(self._v) > 2:  # long enough to have a steady part
            v = np.array(self._v[1:])
            floor = np.sort(v, axis=0)[len(v) // 2]
        return Flights(
            rms_m=np.sqrt(self._squares / max(self._steps, 1)) + nan,
            max_m=self._max + nan,
            settle_s=settled + nan,
            saturated=self._saturated / max(self._late, 1),
            lyapunov_start=self._v[0],
            lyapunov_floor=floor + nan,
            certificate_violated=violated + nan,
            certificate_suspended=suspended + nan,
            b_hat_share_max=np.sqrt(self._b_hat) / (law.b_bound + law.epsilon) + nan,
            thrust_margin_n=self._margin + nan,
            survived=self._alive,
        )
