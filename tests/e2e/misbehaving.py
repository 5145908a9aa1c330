"""A controller that fails on demand: ``controller.kind = "tests.e2e.misbehaving:make"``."""

import time

from groundstation.core.control import Adaptive, Gains
from groundstation.core.messages import Controller, Decision, Estimate
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import Vehicle


class Misbehaving:
    def __init__(self, vehicle: Vehicle, fault: str, after_s: float, for_s: float) -> None:
        self._inner = Adaptive(vehicle, Gains())
        self._fault, self._after, self._for = fault, after_s, for_s
        self._begun: float | None = None

    def decide(self, estimate: Estimate, reference: Reference, interval_s: float) -> Decision:
        if self._begun is None:
            self._begun = estimate.time_s
        if estimate.time_s > self._begun + self._after:
            if self._fault == "raise":
                raise ArithmeticError("the controller broke")
            if self._fault == "block":
                time.sleep(self._for)  # the whole process stands still, as in a bad loop
                self._after = 1e9
        return self._inner.decide(estimate, reference, interval_s)


def make(vehicle: Vehicle, options: dict[str, object]) -> Controller:
    after_s, for_s = float(str(options["after_s"])), float(str(options.get("for_s", 0.0)))
    return Misbehaving(vehicle, str(options["fault"]), after_s, for_s)
