"""Lyapunov certificate: the bound of the theory before a flight, and a monitor of V against it in
flight.

Before: The paper's bound in consistent units: T/m >= g - (B + ε) - sup|p¨d| - sup|u*| - √(2 V(0)),
each sup over time of a Euclidean norm. It is conservative (with the paper's own gains it is
negative), so it is reported, not refused on: in flight the commanded thrust is clamped above
``vehicle.thrust_min_n``.

In flight, floats only: The wind is unknown, so b̃ is too; the observer's estimate replaces it: w =
d̂ - b̂. With V_m = V_known + |w|²/(2 kb), docs/explanation/law-proof.md (5.9) has V_m˙ = -(W +
κ|w|²) + terms, each a gradient at mid-frame times the change within the frame; and, for the noise
and the gusts that it covers,

    V_m˙ <= -s (W + κ|w|²) + D

on average. So from any instant on, V_m stays below its value there plus the integral of the right
side. The monitor keeps the excess of V_m over the lowest of these bounds: zero where the theory
holds; it grows where V rises, and also where V only swings, though it must fall. Lasting excess is
a warning that names the largest term of V_m˙.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import msgspec

from groundstation.core.control.adaptive import (
    DecreaseBound,
    DecreaseProof,
    Gains,
    bound_decrease,
    least_k3,
    projection_slope,
)
from groundstation.core.control.backstepping import Law, evaluate_axis
from groundstation.core.estimation import Estimation
from groundstation.core.geometry import FLOATS, Real, Vec3, to_body
from groundstation.core.messages import (
    Certificate,
    CertificateReading,
    Decision,
    Diagnostics,
    Sentence,
    notice,
)
from groundstation.core.vehicle import Motion, Vehicle

NO_FUNCTION = DecreaseBound(DecreaseProof.NONE, "this controller comes without a Lyapunov function")
NOT_ADAPTIVE = DecreaseBound(DecreaseProof.NONE, "the gains of the law alone")


@lru_cache(16)
def virtual_control_sup(law: Law) -> float:
    """The largest |u*| on one axis [m/s²], over all position and speed errors.

    A coarse grid far beyond where Ω' has made u* fall again (half of it, z1 <= 0, as u* is odd),
    then three finer ones around its best point.
    """
    m = law.sigma_bound
    z1, z1_span = 0.0, 10.0 * m / law.sigma_slope
    x2 = x2_span = 5.0 * (m + law.velocity_scale)
    top, points = 0.0, 30
    for last in (0, 12, 12, 12):
        best = (z1, x2)
        for i in range(last, -points - 1, -1):
            first = z1 + z1_span * i / points
            slope = evaluate_axis(FLOATS, law.shape, first, 0.0).sigma_prime
            if law.k2 * law.rho_bound + m + slope * (m + law.velocity_scale) < top:
                continue  # |u*| is nowhere more than that for this z1: |x2| <= (M + c) Ω'(x2)
            for j in range(-points, points + 1):
                second = x2 + x2_span * j / points
                value = abs(evaluate_axis(FLOATS, law.shape, first, second).u_star)
                if value > top:
                    top, best = value, (first, second)
        z1, x2 = best
        z1_span, x2_span, points = 2.0 * z1_span / points, 2.0 * x2_span / points, 12
    return top


def thrust_bound(law: Law, *, acceleration_sup: float, v_start: float) -> float:
    """Return the least thrust over mass [m/s²] for a reference whose acceleration stays below
    ``acceleration_sup``.

    ``v_start`` is V(0). A negative bound promises nothing.
    """
    control = math.sqrt(3.0) * virtual_control_sup(law)  # |u*| from its largest value on one axis
    return (
        law.gravity
        - (law.b_bound + law.epsilon)
        - acceleration_sup
        - control
        - math.sqrt(2.0 * v_start)
    )


COVERED_RATE_M_S3 = 8.0
"""β: largest change of b̂ and û by wind and actuators that the bound covers [m/s³]. The sine gusts
of `adverse` have 0.9; a tilt rate that is off by 0.8 rad/s, as behind the front of `gust_front`,
has 8."""


class Decrease(NamedTuple):
    """The bound V_m˙ <= -s (W + κ|w|²) + D for one set of gains (docs/explanation/law-proof.md,
    section 5.9).
    """

    name: str
    """Name of the bound, or the reason why there is none."""
    share: float
    """s [-]; 0 where nothing is proved."""
    power: float
    """Part of D for wind and actuators; :func:`noise_power` comes on top [m²/s³]."""
    spare: float
    """Excess of V_m over its bound that unmeasured terms explain [m²/s²]."""


def decrease(law: Law) -> Decrease:
    """Return the bound of these gains in flight."""
    bound = bound_decrease(law) if isinstance(law, Gains) else NOT_ADAPTIVE
    left, spare = 1.0, 0.0
    if bound.proof is DecreaseProof.COMPOSITE and isinstance(law, Gains):
        slope = projection_slope(law)
        left = 1.0 - 0.5 * law.kb * slope * math.sqrt(law.kappa / least_k3(law))
    elif bound.proof is DecreaseProof.PAPER:
        # Without a d̂ of its own b̃ has no estimate: V_known may rise by the range of V's last term.
        spare = 0.5 * (2.0 * law.b_bound + law.epsilon) ** 2 / law.kb
    share = 0.0 if bound.proof is DecreaseProof.NONE else 0.5 * left
    power = COVERED_RATE_M_S3**2 / (2.0 * left * least_k3(law))
    return Decrease(str(bound), share, power, spare)


class LyapunovMeasure(NamedTuple):
    """V_m = V_known + |w|²/(2 kb) with w = d̂ - b̂, and its least decrease, for one set of gains.

    Elementwise.
    """

    law: Law | None
    """The gains; None for a controller without a Lyapunov function."""
    decrease: Decrease
    """The bound that these gains have."""
    weight: float
    """1/(2 kb) [s²]; 0 without an observer that finds d̂ by itself."""
    kappa: float
    """κ [s]; 0 likewise."""

    @property
    def pull(self) -> float:
        """kb κ [1/s]."""
        return 0.0 if self.law is None else self.law.kb * self.kappa

    def of(self, d: Diagnostics) -> tuple[Real, Real]:
        """Return V_m [m²/s²], and W + κ|w|² [m²/s³], by the law's values ``d``."""
        bx, by, bz = d.b_hat
        wx, wy, wz = d.disturbance
        wx, wy, wz = wx - bx, wy - by, wz - bz
        ww = wx * wx + wy * wy + wz * wz
        return d.v_known + self.weight * ww, d.w + self.kappa * ww


def measure(config: Estimation) -> LyapunovMeasure:
    """Return the measure of V under these gains: none for a controller without a Lyapunov
    function.
    """
    law = config if isinstance(config, Law) else None
    known = Decrease(str(NO_FUNCTION), 0.0, 0.0, 0.0) if law is None else decrease(law)
    if isinstance(config, Gains) and config.composite == "provable" and config.kb > 0.0:
        return LyapunovMeasure(law, known, 0.5 / config.kb, config.kappa)
    return LyapunovMeasure(law, known, 0.0, 0.0)


def noise_power(law: Law, noise_m: Real, interval_s: Real) -> Real:
    """Return the part of D for noise ``noise_m`` [m, 1σ per axis] every ``interval_s`` [s].

    Elementwise [m²/s³].

    Innovations are white, so on average V_m only gains the second-order part of their jumps: half
    of its curvature at the origin times their intensity, on three axes. The observer's gains are
    those of its steady state in continuous time for a chain that the disturbance's rate drives: a
    Butterworth filter of order 4.
    """
    intensity = noise_m * noise_m * interval_s
    w: Real = (law.wind_rate_noise**2 / intensity) ** 0.125
    l1, l2, l3 = 2.613 * w, 3.414 * w * w, 2.613 * w * w * w
    if law.composite == "off":
        l3 = 0.0
    r = law.sigma_slope
    z2 = l2 + r * l1
    z3 = l3 + law.k2 * law.rho_slope * z2 + r * (l1 + l2)
    return 1.5 * intensity * (r * l1 * l1 + z2 * z2 + z3 * z3)


RATES = "rate error of the actuators"
THRUST = "thrust error of the actuators"
LIMITS = "commands at their limit"
WITNESSES = "observer and tracking disagree about the wind (kb² κ against 4 k3)"
SIDEWAYS = (
    "the disturbance moves sideways (gusts; or rate lag, delay or attitude not as configured)"
)
VERTICAL = "the disturbance moves vertically (gusts; or thrust, its lag or delay not as configured)"
POSES = "poses contradict the model (noise, or lags or delay not as configured)"


def terms(
    before: Motion,
    then: Diagnostics,
    saturated: bool,
    after: Motion,
    now: Diagnostics,
    dt: float,
    *,
    total: float,
    mass: float,
    pull: float,
) -> dict[str, float]:
    """Return the gain of V_m from each source within one frame [m²/s²].

    Args:
        before: motion at the last command.
        then: the law's values there.
        saturated: whether that command was clamped; the law then does not adapt at the present one.
        after: motion at the present command.
        now: the law's values there.
        dt: between the two [s].
        total: V_m's rise plus the decrease W + κ|w|² over the frame [m²/s²].
        mass: [kg].
        pull: kb κ [1/s].
    """
    z3: Vec3 = (
        0.5 * (then.z3[0] + now.z3[0]),
        0.5 * (then.z3[1] + now.z3[1]),
        0.5 * (then.z3[2] + now.z3[2]),
    )
    zx, zy, zz = to_body(before.attitude, z3)
    x, y = (0.5 * (before.rates[i] + after.rates[i]) - then.rates_wanted[i] for i in (0, 1))
    turning = before.thrust / mass * (zy * x - zx * y) * dt
    pushing = (then.thrust_rate * dt - (after.thrust - before.thrust)) / mass * zz
    d, e = then.disturbance, now.disturbance
    moved = (z3[0] * (e[0] - d[0]), z3[1] * (e[1] - d[1]), z3[2] * (e[2] - d[2]))
    w = (d[0] - then.b_hat[0], d[1] - then.b_hat[1], d[2] - then.b_hat[2])
    found = {
        LIMITS if saturated else RATES: turning,
        WITNESSES: 0.0 if saturated else pull * dt * (z3[0] * w[0] + z3[1] * w[1] + z3[2] * w[2]),
        SIDEWAYS: moved[0] + moved[1],
        VERTICAL: moved[2],
    }
    if saturated:
        found[LIMITS] += pushing
    else:
        found[THRUST] = pushing
    found[POSES] = total - sum(found.values())
    return found


LASTING_S = 0.5
"""Duration of a condition that is reported [s]: an outage of the poses, or a gust's front, is
shorter."""
PINNED_S = 1.0
"""Duration of commands at their limit that is reported [s]: a climb of 1 m takes less."""
SUSPENDED_MEAN_S = 1.0
"""Time constant of the share of commands at which the bound is suspended [s]; above one half it is
reported."""
REST_S = 5.0
"""Time after its end within which a condition is not reported again [s]."""

HOLDS = "holds"
VIOLATED = "violated"
SUSPENDED = "suspended"
NONE = "none"


class Lasting:
    """A condition that is reported once when it has lasted, and again only ``REST_S`` after its
    end.
    """

    def __init__(self, least_s: float = LASTING_S) -> None:
        self.for_s, self._least_s = 0.0, least_s
        self._is_reported = False
        self._ended_s = -math.inf

    def extend(self, time_s: float, dt: float) -> bool:
        """Add ``dt`` [s] of it; return whether it is to be reported now."""
        if self.for_s == 0.0 and time_s - self._ended_s > REST_S:
            self._is_reported = False
        self.for_s += dt
        if self._is_reported or self.for_s < self._least_s:
            return False
        self._is_reported = True
        return True

    def end(self, time_s: float) -> None:
        """End the condition."""
        if self.for_s > 0.0:
            self.for_s = 0.0
            self._ended_s = time_s


class Look(msgspec.Struct, frozen=True, gc=False):
    """Values of the monitor at one command."""

    time_s: float
    v: float
    """V_m [m²/s²]."""
    fall: float
    """W + κ|w|² [m²/s³]."""
    motion: Motion
    decision: Decision


class Frame(msgspec.Struct, frozen=True, gc=False):
    """Time from one command to the next, and the gain of V_m in it."""

    last: Look
    now: Look
    gained: float
    """V_m's rise plus the decrease W + κ|w|² over the frame [m²/s²]."""

    @property
    def dt(self) -> float:
        """Length [s]."""
        return self.now.time_s - self.last.time_s


class EnergySources:
    """Sums of the gain of V_m from each source."""

    def __init__(self, mass_kg: float) -> None:
        """Begin with nothing; ``mass_kg`` is the vehicle's [kg]."""
        self._mass_kg = mass_kg
        self._sums: dict[str, float] = {}
        self.for_s = 0.0
        """Length of the frames summed up [s]."""

    def clear(self) -> None:
        """Begin anew."""
        self._sums, self.for_s = {}, 0.0

    def drop(self, name: str) -> None:
        """Remove the sum of one source."""
        self._sums.pop(name, None)

    def add(self, frame: Frame, pull: float) -> None:
        """Add one frame; ``pull`` is kb κ [1/s]."""
        last, now = frame.last, frame.now
        for name, energy in terms(
            last.motion,
            last.decision.diagnostics,
            last.decision.saturated,
            now.motion,
            now.decision.diagnostics,
            frame.dt,
            total=frame.gained,
            mass=self._mass_kg,
            pull=pull,
        ).items():
            self._sums[name] = self._sums.get(name, 0.0) + energy
        self.for_s += frame.dt

    def name_largest(self, for_s: float) -> str:
        """Return the largest source over ``for_s`` [s], and the next where it is half as large."""
        (name, most), (other, next_) = sorted(self._sums.items(), key=lambda item: -item[1])[:2]
        said = f"{name}, {most / for_s:.2g} m²/s³"
        return said if next_ < 0.5 * most else f"{said}; then {other}, {next_ / for_s:.2g}"


class ExcessWatch:
    """V_m above the lowest of its bounds."""

    def __init__(self, mass_kg: float) -> None:
        self.excess = 0.0
        """V_m above its bound [m²/s²]."""
        self._peak = 0.0
        self._sources, self._rising = EnergySources(mass_kg), Lasting()

    @property
    def for_s(self) -> float:
        """Time for which V_m has been above its bound and its spare [s]."""
        return self._rising.for_s

    def end(self, time_s: float) -> None:
        """Begin from V_m as it is: another V, or another reference."""
        self.excess = 0.0
        self._rising.end(time_s)

    def update(self, excess: float, frame: Frame, measure: LyapunovMeasure) -> Sentence | None:
        """Take the computed excess of one frame; return a sentence once it has lasted."""
        if self.excess == 0.0:
            self._sources.clear()
            self._peak = 0.0
        # The bound is not below zero by more than V has been above it: an old excess does not last.
        self._peak = max(self._peak, frame.now.v)
        spare, last = measure.decrease.spare, frame.last
        self.excess = excess = min(max(excess, 0.0), self._peak + spare)
        if excess <= spare:
            self._rising.end(last.time_s)
        if excess <= 0.0:
            return None
        self._sources.add(frame, measure.pull)
        if excess <= spare or not self._rising.extend(last.time_s, frame.dt):
            return None
        for_s = self._sources.for_s
        return notice("certificate.above", for_s=for_s, largest=self._sources.name_largest(for_s))


class SuspensionWatch:
    """Share of the commands at which the bound is suspended, because the one before was clamped."""

    def __init__(self, mass_kg: float) -> None:
        self.share = 0.0
        """The share, with a memory of ``SUSPENDED_MEAN_S`` [-]."""
        self._sources, self._limited = EnergySources(mass_kg), Lasting(PINNED_S)

    def update(self, frame: Frame, measure: LyapunovMeasure, *, pinned: bool) -> Sentence | None:
        """Take one frame; ``pinned``: whether the thrust at its limit, which has a sentence of its
        own, is the cause.
        """
        last, dt = frame.last, frame.dt
        share = self.share
        share += dt / (dt + SUSPENDED_MEAN_S) * (float(last.decision.saturated) - share)
        self.share = share if share > 0.01 else 0.0
        if share <= 0.5 or measure.law is None:
            self._limited.end(last.time_s)
            self._sources.clear()
            return None
        self._sources.add(frame, measure.pull)
        is_new = self._limited.extend(last.time_s, dt)
        # Commands at a limit are the consequence; the other sources are the cause.
        self._sources.drop(LIMITS)
        if not is_new or pinned:
            return None
        return notice(
            "certificate.suspended", largest=self._sources.name_largest(self._limited.for_s)
        )


class CertificateMonitor:
    """Evaluates every command of one flight, and changes nothing."""

    def __init__(self, vehicle: Vehicle, config: Estimation) -> None:
        self._noise: tuple[float, float] | None = None
        self._last: Look | None = None
        self._above = ExcessWatch(vehicle.mass_kg)
        self._suspension = SuspensionWatch(vehicle.mass_kg)
        self._least_n, self._most_n = vehicle.thrust_min_n, vehicle.thrust_max_n
        self._disturbance, self._thrust = Lasting(), Lasting(PINNED_S)
        """Times of |b̂| above B, and of the commanded thrust at one of its limits."""
        self._watched_s = self._violated_s = self._suspended_s = 0.0
        self._opening: tuple[Sentence, ...] = ()
        self.set_gains(config)
        if self._measure.law is not None and self._measure.decrease.share == 0.0:
            self._opening = (notice("certificate.no_proof", bound=self._measure.decrease.name),)

    def set_gains(self, config: Estimation) -> None:
        """Take new gains, and with them another V: begin anew."""
        self._measure = measure(config)
        self._power = self._measure.decrease.power
        if self._noise is not None:
            self.set_noise(*self._noise)
        self.restart()

    def restart(self) -> None:
        """Begin anew: the reference has jumped, and V with it."""
        if self._last is not None:
            self._above.end(self._last.time_s)
        self._last = None

    def set_noise(self, noise_m: float, interval_s: float) -> None:
        """Take the measured noise of the poses [m, 1σ per axis] and their mean interval [s]; D
        depends on both.
        """
        self._noise = (noise_m, interval_s)
        if self._measure.law is not None:
            self._power = self._measure.decrease.power + noise_power(
                self._measure.law, noise_m, interval_s
            )

    def evaluate(self, time_s: float, motion: Motion, decision: Decision) -> CertificateReading:
        """Take one command, and the motion that it was computed from; return V against its bound
        and new warnings.
        """
        now = Look(time_s, *self._measure.of(decision.diagnostics), motion, decision)
        last, self._last = self._last, now
        warnings, self._opening, state = self._opening, (), NONE
        if last is not None and 0.0 < time_s - last.time_s < LASTING_S:
            warnings += self._find_warnings(last, now)
            state, dt = self._state(suspended=last.decision.saturated), time_s - last.time_s
            self._watched_s += dt
            if state == VIOLATED:
                self._violated_s += dt
            elif state == SUSPENDED:
                self._suspended_s += dt
        return CertificateReading(state, self._above.excess, warnings)

    def _find_warnings(self, last: Look, now: Look) -> tuple[Sentence, ...]:
        """Show the frame from ``last`` to ``now`` to every watch that it concerns."""
        dt = now.time_s - last.time_s
        rise = now.v - last.v
        saturated = last.decision.saturated
        bound = self._measure
        fallen = 0.5 * dt * (now.fall + last.fall)
        above = self._above
        found = list[Sentence | None]()
        excess = above.excess + rise + bound.decrease.share * fallen - self._power * dt
        if saturated:  # nothing is promised: the bound begins anew from here
            excess = 0.0
        frame = Frame(last, now, rise + fallen)
        if excess > 0.0 or above.excess > 0.0:
            found.append(above.update(excess, frame, bound))
        if saturated or self._suspension.share > 0.0:
            found.append(
                self._suspension.update(frame, bound, pinned=self._thrust.for_s >= LASTING_S)
            )
        length = math.hypot(*now.decision.diagnostics.b_hat)
        found.append(self._check_disturbance(length, last.time_s, dt))
        found.append(self._check_thrust(now.decision.drive.thrust, last.time_s, dt))
        return tuple(one for one in found if one is not None)

    def _check_disturbance(self, length: float, last_s: float, dt: float) -> Sentence | None:
        """Return the sentence about |b̂| = ``length`` [m/s²] once it has been above B for long
        enough.
        """
        law, above = self._measure.law, self._disturbance
        if law is None or law.kb == 0.0 or length <= law.b_bound:
            above.end(last_s)
            return None
        if not above.extend(last_s, dt):
            return None
        return notice(
            "certificate.disturbance", found_m_s2=length, limit_m_s2=law.b_bound, for_s=above.for_s
        )

    def _check_thrust(self, thrust_n: float, last_s: float, dt: float) -> Sentence | None:
        """Return the sentence about the commanded thrust once it has been at one of its limits for
        long enough.
        """
        pinned = self._thrust
        if self._least_n < thrust_n < self._most_n:
            pinned.end(last_s)
            return None
        if not pinned.extend(last_s, dt):
            return None
        which = "upper" if thrust_n >= self._most_n else "lower"
        return notice(
            "certificate.thrust_margin", which=which, thrust_n=thrust_n, for_s=pinned.for_s
        )

    def _state(self, *, suspended: bool) -> str:
        if max(self._above.for_s, self._disturbance.for_s) >= LASTING_S:
            return VIOLATED
        if suspended and self._measure.law is not None:
            return SUSPENDED
        return HOLDS if self._measure.decrease.share > 0.0 else NONE

    def reading(self) -> Certificate | None:
        """For screens; None before the second command."""
        last, law = self._last, self._measure.law
        if last is None or self._watched_s == 0.0:
            return None
        radius = None if law is None else law.b_bound + law.epsilon
        return Certificate(
            state=self._state(suspended=last.decision.saturated),
            bound=self._measure.decrease.name,
            v=last.v,
            excess=self._above.excess,
            violated_fraction=self._violated_s / self._watched_s,
            suspended_fraction=self._suspended_s / self._watched_s,
            b_hat_fraction=radius and math.hypot(*last.decision.diagnostics.b_hat) / radius,
        )
