"""Controllers that know floats only, one for each vehicle of a batch."""

from typing import Any

import numpy as np

from groundstation.core.control import make_controller
from groundstation.core.geometry import ZERO
from groundstation.core.messages import Controller, Decision, Diagnostics, Estimate
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import ActuatorCommand, Motion
from groundstation.settings import Config


class OneByOne:
    """N controllers of the configured kind, called one after the other."""

    def __init__(self, count: int, config: Config) -> None:
        """Make ``count`` controllers of ``config``."""
        self._controllers: list[Controller] = [
            make_controller(config.controller, config.vehicle) for _ in range(count)
        ]

    def decide(self, estimate: Estimate, reference: Reference, interval_s: float) -> Decision:
        """Return the commands of all as one decision.

        Each number of ``estimate`` is an array of shape (N,), or one for all; so are thrust [N],
        rates [rad/s, FRD] and ``b_hat`` [m/s², NED] of the decision. All follow one ``reference``.
        """
        motion, count = estimate.motion, len(self._controllers)
        numbers = (
            *motion.position,
            *motion.velocity,
            *motion.attitude,
            motion.thrust,
            *motion.rates,
            *estimate.disturbance,
            estimate.effectiveness,
        )
        rows = np.stack([np.broadcast_to(number, count) for number in numbers], axis=1).tolist()
        decisions = [
            controller.decide(_make_estimate(estimate.time_s, row), reference, interval_s)
            for controller, row in zip(self._controllers, rows, strict=True)
        ]
        found: Any = np.array(
            [(d.drive.thrust, *d.drive.rates, *d.diagnostics.b_hat) for d in decisions]
        ).T
        thrust, p, q, r, *b_hat = found
        saturated: Any = np.array([d.saturated for d in decisions])
        zero: Any = np.zeros(count)
        unread: Any = ZERO  # no batch reads these diagnostics
        # Controllers of one configuration prove the same.
        certificate = decisions[0].diagnostics.certificate
        return Decision(
            ActuatorCommand(thrust, (p, q, r)),
            saturated,
            Diagnostics(
                z1=unread,
                z2=unread,
                z3=unread,
                u_star=unread,
                b_hat=(b_hat[0], b_hat[1], b_hat[2]),
                b_hat_dot=unread,
                disturbance=estimate.disturbance,
                v_terms=unread,
                w_terms=unread,
                v_known=zero,
                w=zero,
                certificate=certificate,
            ),
        )


def _make_estimate(time_s: float, row: list[float]) -> Estimate:
    """Return the estimate of one vehicle, from the numbers in the order of :meth:`decide`."""
    px, py, pz, vx, vy, vz, w, x, y, z, thrust, p, q, r, north, east, down, effectiveness = row
    motion = Motion((px, py, pz), (vx, vy, vz), (w, x, y, z), thrust, (p, q, r))
    return Estimate(time_s, motion, (north, east, down), ZERO, effectiveness)
