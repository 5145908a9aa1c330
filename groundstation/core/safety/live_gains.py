"""Gains that are changed in flight: within bounds, slowly, and reverted where the flight gets
worse. Sans-IO.

A change is a linear ramp of two seconds. The flight after it is compared with the ten seconds
before it: where the mean square of the error, or the mean of V, has risen too far, the gain is
reverted. That happens as soon as the integral exceeds its limit for the whole time, so a bad change
does not last. A change is also reverted where the vehicle neither holds nor tracks any more, as in
a landing, before the comparison is over.
"""

import math
from collections import deque
from typing import NamedTuple

import msgspec

from groundstation.config import locate
from groundstation.core.control import Gains
from groundstation.core.messages import Estimate, Reply, Sentence, notice
from groundstation.core.trajectory import Reference

RAMP_S = 2.0
"""Duration of a change [s]. Chosen: slow against the loop."""
BACK_S = 0.5
"""Duration of its reversal [s]. Chosen: the old gain has flown well."""
JUDGED_S = 10.0
"""Time that is compared, before and after a change [s]. Chosen: a figure of eight takes as long."""
INTERRUPTION_S = 0.5
"""Interval of commands above which a flight was interrupted: no change begins after it, and the
integrals count it as this long [s]. Chosen."""
RMS_FACTOR = 1.5
"""Factor on the RMS error above which a change is reverted [-]. Chosen."""
V_FACTOR = 4.0
"""Factor on the mean V above which a change is reverted [-]. Chosen: V is a sum of squares."""
STEP_FACTOR = 2.0
"""Largest factor of one change, up or down [-]. Chosen."""
LIVE = ("k2", "k3", "kb", "k_yaw", "kappa", "k_omega")
"""Gains that may be changed. The shapes of σ, ρ and Ω may not: with them V is another function."""
PREFIX = "controller."
"""Section of the gains' configuration keys."""


class GainStep(NamedTuple):
    """New value of a gain during a change."""

    name: str
    value: float


class _GainRamp(NamedTuple):
    """Linear change of one gain, from ``start_s`` on within ``over_s`` [s]."""

    name: str
    old: float
    new: float
    start_s: float
    over_s: float

    def at(self, time_s: float) -> float:
        """Return the gain at ``time_s`` [s]."""
        share = min(1.0, max(0.0, (time_s - self.start_s) / self.over_s))
        return self.new if share == 1.0 else self.old + share * (self.new - self.old)


class _GainTrial(NamedTuple):
    """Change that is being compared, and its limits."""

    ramp: _GainRamp
    most_squares: float
    """Largest ∫ e² dt that is accepted [m²s]."""
    most_v: float
    """Largest ∫ V dt that is accepted [m²/s]."""


class LiveGains:
    """The gains of one flight. Times are on the event loop's clock [s]."""

    def __init__(self, gains: object) -> None:
        """Take the controller's configuration; only our own law has gains that may be changed."""
        self.gains = gains if isinstance(gains, Gains) else None
        """Present gains; None for a controller without gains that may be changed."""
        self._past: deque[tuple[float, float, float]] = deque()
        """Instant [s], e² [m²] and V [m²/s²] of each command of the last ``JUDGED_S``."""
        self._ramp: _GainRamp | None = None
        """Change under way, also that of a reversal; None without one."""
        self._trial: _GainTrial | None = None
        """Change that is being compared; None without one."""
        self._squares = self._v = 0.0
        """∫ e² dt [m²s] and ∫ V dt [m²/s] since the change began."""
        self._last_s = -math.inf

    @property
    def now(self) -> dict[str, float]:
        """Present values of the gains that may be changed, by configuration key."""
        return (
            {}
            if self.gains is None
            else {PREFIX + name: float(getattr(self.gains, name)) for name in LIVE}
        )

    def set(self, key: str, value: float, now_s: float) -> Reply:
        """Begin to change the gain ``key`` (``controller.k2``) to ``value``, or reply why not."""
        gains, name = self.gains, key.removeprefix(PREFIX)
        if gains is None:
            return Reply.of(False, notice("gain.none"))
        if not key.startswith(PREFIX) or name not in LIVE:
            return Reply.of(
                False, notice("gain.unknown", key=key, keys=", ".join(PREFIX + one for one in LIVE))
            )
        now = getattr(gains, name)
        try:
            msgspec.convert({**msgspec.structs.asdict(gains), name: value}, type(gains))
        except msgspec.ValidationError as error:
            return Reply.of(False, notice("gain.invalid", key=key, why=locate(error)[1]))
        low, high = now / STEP_FACTOR, now * STEP_FACTOR
        if not low <= value <= high:
            return Reply.of(
                False, notice("gain.step", key=key, now=now, low=low, high=high, value=value)
            )
        trial = self._trial
        if trial is not None and (name, value) == (trial.ramp.name, trial.ramp.old):
            self._revert(trial, now_s)
            return Reply.of(True, notice("gain.back", key=key, value=value))
        if trial is not None or self._ramp is not None:
            return Reply.of(False, notice("gain.busy", key=key))
        if (
            not self._past
            or now_s - self._past[0][0] < JUDGED_S - INTERRUPTION_S
            or now_s - self._past[-1][0] > INTERRUPTION_S
        ):
            return Reply.of(False, notice("gain.too_early", key=key, before_s=JUDGED_S))
        squares, v = self._find_means()
        span_s = RAMP_S + JUDGED_S
        self._ramp = _GainRamp(name, now, value, now_s, RAMP_S)
        self._trial = _GainTrial(
            self._ramp, RMS_FACTOR**2 * squares * span_s, V_FACTOR * v * span_s
        )
        self._squares = self._v = 0.0
        return Reply.of(True, notice("gain.moves", key=key, now=now, value=value, ramp_s=RAMP_S))

    def update(
        self, time_s: float, estimate: Estimate, reference: Reference, v: float, *, counts: bool
    ) -> tuple[GainStep | None, Sentence | None]:
        """Take one command; return the gain to set now, and the sentence for the operator.

        ``v`` is the certificate's V [m²/s²]. ``counts``: whether the vehicle holds or tracks, so
        that its error is that of the configured gains.
        """
        if self.gains is None:
            return None, None
        squared = math.dist(estimate.motion.position, reference.position_ned) ** 2
        dt, self._last_s = min(time_s - self._last_s, INTERRUPTION_S), time_s
        past = self._past
        if counts:
            past.append((time_s, squared, v))
            while past[0][0] < time_s - JUDGED_S:
                past.popleft()
        else:
            past.clear()
        verdict = None
        if self._trial is not None:
            verdict = self._judge(self._trial, time_s, squared, v, dt, counts=counts)
        return self._advance(time_s), verdict

    def _judge(
        self, trial: _GainTrial, time_s: float, squared: float, v: float, dt: float, *, counts: bool
    ) -> Sentence | None:
        """Judge the change by one more command; return the sentence on its end, if it ends."""
        key = PREFIX + trial.ramp.name
        if not counts:
            self._revert(trial, time_s)
            return notice("gain.unproven", key=key, value=trial.ramp.old)
        self._squares += squared * dt
        self._v += v * dt
        # A sum that is not a number is within no limit.
        if not self._squares <= trial.most_squares:
            return self._reject(trial, time_s, "the RMS error", RMS_FACTOR)
        if not self._v <= trial.most_v:
            return self._reject(trial, time_s, "V", V_FACTOR)
        if time_s - trial.ramp.start_s >= RAMP_S + JUDGED_S:
            self._trial = None
            return notice("gain.stays", key=key, value=trial.ramp.new)
        return None

    def _reject(self, trial: _GainTrial, now_s: float, worse: str, factor: float) -> Sentence:
        """Revert the change; return the warning that ``worse`` has risen by more than ``factor``
        [-].
        """
        self._revert(trial, now_s)
        key, old = PREFIX + trial.ramp.name, trial.ramp.old
        return notice("gain.worse", key=key, value=old, worse=worse, factor=factor).as_warning()

    def _revert(self, trial: _GainTrial, now_s: float) -> None:
        """End the trial, and begin to change the gain back."""
        now = getattr(self.gains, trial.ramp.name)
        self._trial = None
        self._ramp = _GainRamp(trial.ramp.name, now, trial.ramp.old, now_s, BACK_S)

    def _advance(self, time_s: float) -> GainStep | None:
        """Return the gain of a change under way at ``time_s``; None without one."""
        ramp, gains = self._ramp, self.gains
        if ramp is None or gains is None:
            return None
        value = ramp.at(time_s)
        if value == ramp.new:
            self._ramp = None
        self.gains = msgspec.structs.replace(gains, **{ramp.name: value})
        return GainStep(ramp.name, value)

    def _find_means(self) -> tuple[float, float]:
        """Return the mean e² [m²] and the mean V [m²/s²] of the time before the change."""
        count = len(self._past)
        return sum(one[1] for one in self._past) / count, sum(one[2] for one in self._past) / count
