"""The law as it was before the turn rate came from the model, to prove by what it does that a plant is the one meant.

It differentiates the rates that it wants by differences of successive commands, through a filter; its gains are the
paper's but for the composite form; it knows no drag, and no delay beside a lag.
"""

from groundstation.core.control.adaptive import Adaptive
from groundstation.core.geometry import Vec3
from groundstation.core.messages import Decision, Estimate
from groundstation.core.trajectory import Reference

TOLD = (
    "controller.k2=2",
    "controller.k3=4",
    "controller.k3_down=4",
    "controller.kb=1",
    "controller.kappa=7",
    "controller.sigma_slope=3",
    "controller.rho_slope=1",
    "controller.wind_rate_noise=1.7",
    "vehicle.drag_per_s=0",
    "vehicle.thrust_delay_s=0",
    "vehicle.rate_delay_s=0",
)
"""Its gains, and what it was never told, as in ``--set``."""
FILTER_S = 0.03
"""Time constant of the filter on the derivative of the wanted rate [s]."""


class LawBefore(Adaptive):
    """Flies one vehicle in the place of :class:`Adaptive`, with :data:`TOLD`."""

    _interval_s = 0.0
    _wanted: Vec3 | None = None
    _slopes: Vec3 = (0.0, 0.0, 0.0)

    def decide(self, estimate: Estimate, reference: Reference, interval_s: float) -> Decision:
        """As ours, which leads its rates by what came before."""
        self._interval_s = interval_s
        return super().decide(estimate, reference, interval_s)

    def _lead(self, rates: Vec3, wanted: Vec3, ahead: Vec3) -> Vec3:
        h, before = self._interval_s, self._wanted
        if before is not None and h > 0.0:
            k = h / (h + FILTER_S)
            p, q, r = (s + k * ((w - o) / h - s) for s, w, o in zip(self._slopes, wanted, before, strict=True))
            self._slopes = p, q, r
        self._wanted = wanted
        n, k = self._rate_lead, self._gains.k_omega
        p, q, r = (x + n * (k * (w - x) + s) for x, w, s in zip(rates, wanted, self._slopes, strict=True))
        return p, q, r
