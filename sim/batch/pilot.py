"""The controller of N vehicles: :class:`groundstation.core.control.adaptive.Adaptive` on arrays, memory and all."""

from typing import Any

import msgspec
import numpy as np

from groundstation.core.control.adaptive import Adaptive
from groundstation.core.control.gains import Gains
from groundstation.core.geometry.ops import Ops, arrays
from groundstation.core.messages.control import Decision, Estimate
from groundstation.core.messages.snapshot import Diagnostics
from groundstation.core.trajectory.port import Reference
from groundstation.core.vehicle.vehicle import Vehicle
from sim.batch.columns import columns
from sim.batch.stages import Stage, Stages


class BatchPilot:
    """All vehicles are told the same, and a command leaves every ``period_s`` [s]."""

    def __init__(self, vehicle: Vehicle, gains: Gains, period_s: float, stages: Stages) -> None:
        """Start as :class:`Adaptive` does."""
        self._vehicle, self._gains, self._period, self._stages = vehicle, gains, period_s, stages
        self._decide: Stage | None = None

    def decide(self, estimate: Estimate, reference: Reference) -> Decision:
        """One command each."""
        if self._decide is None:  # the first, before which there is nothing to remember
            pilot = Adaptive(self._vehicle, self._gains, arrays())
            decision = pilot.decide(estimate, reference, 0.0)
            self._decide = self._stages(self._decided, columns(pilot.memory, np.size(decision.saturated)))
            return decision
        drive, saturated, seen = self._decide((estimate, msgspec.structs.astuple(reference)))
        return Decision(drive, saturated, Diagnostics(*seen))

    def _decided(self, ops: Ops, memory: Any, given: Any) -> Any:
        estimate, reference = given
        pilot = Adaptive(self._vehicle, self._gains, ops)
        pilot.memory = memory
        drive, saturated, seen = pilot.decide(estimate, Reference(*reference), self._period)
        return pilot.memory, (drive, saturated, msgspec.structs.astuple(seen))
