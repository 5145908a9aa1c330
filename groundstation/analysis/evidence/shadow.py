"""Shadow of our controller over a recorded flight: what it would have sent along the path that was flown.

As no correction that it asks for is ever made, it keeps asking: its commands are livelier than in flight. The reference
is a polynomial fitted to the positions around each instant, later ones included (local regression; Savitzky and Golay's
filter, but for uneven stamps).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from groundstation.core.control import Adaptive, make_controller
from groundstation.core.estimation import ModelEstimator
from groundstation.core.geometry import Vec3, so3
from groundstation.core.messages import Controller, Estimate, Pose
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import ActuatorCommand
from groundstation.settings import Config

Column = NDArray[np.float64]

HALF_WIDTH_S = 0.4
"""Poses this near take part in the fit [s]; weights fall to zero there, so that nothing jumps."""
ORDER = 4
"""Degree of the polynomial: one above the jerk."""
FEWEST = 2 * (ORDER + 1)
"""Without this many poses around it an instant has no reference."""
LONGEST_GAP_S = 0.25
"""The path breaks at a longer gap between poses [s]."""


class FlownPath:
    """Position, its derivatives, and heading of one vehicle over time."""

    def __init__(self, poses: Sequence[Pose]) -> None:
        """Take poses in order of time; the path breaks at a gap and at a reset."""
        self._time: Column = np.array([pose.time_s for pose in poses])
        yaw = np.unwrap([so3.euler_zyx(pose.attitude)[2] for pose in poses])
        self._places: Column = np.column_stack([np.array([pose.position_ned for pose in poses]), yaw])
        resets = np.array([pose.reset_count for pose in poses])
        starts = np.flatnonzero((np.diff(self._time) > LONGEST_GAP_S) | (np.diff(resets) != 0)) + 1
        self._starts = [0, *starts.tolist(), len(poses)]

    def at(self, time_s: float) -> Reference | None:
        """The path at ``time_s`` [s], with derivatives to the jerk; None where too few poses are around it."""
        after = int(np.searchsorted(self._time, time_s, "right"))
        piece = int(np.searchsorted(self._starts, after - 1, "right"))
        if not 0 < piece < len(self._starts):
            return None
        first, end = self._starts[piece - 1], self._starts[piece]
        low = max(first, int(np.searchsorted(self._time, time_s - HALF_WIDTH_S, "right")))
        high = min(end, int(np.searchsorted(self._time, time_s + HALF_WIDTH_S, "left")))
        if high - low < FEWEST or time_s > self._time[end - 1]:
            return None
        place, velocity, acceleration, jerk, _ = _fit_polynomial(self._time[low:high] - time_s, self._places[low:high])
        (x0, y0, z0, yaw), (x1, y1, z1, yaw_rate) = place, velocity
        (x2, y2, z2, _), (x3, y3, z3, _) = acceleration, jerk
        return Reference((x0, y0, z0), (x1, y1, z1), (x2, y2, z2), (x3, y3, z3), yaw, yaw_rate)


def _fit_polynomial(time_s: Column, values: Column) -> list[list[float]]:
    """Value and derivatives at time 0 of the polynomial through ``values`` (N, K)."""
    x = time_s / HALF_WIDTH_S
    root_weight = (1.0 - np.abs(x) ** 3) ** 1.5
    design = np.vander(x, ORDER + 1, increasing=True) * root_weight[:, None]
    origin = values[0]  # small numbers, whatever the lab's origin
    fit = np.linalg.lstsq(design, (values - origin) * root_weight[:, None], rcond=None)[0]
    fit[0] += origin
    return [(math.factorial(k) / HALF_WIDTH_S**k * fit[k]).tolist() for k in range(ORDER + 1)]


class ShadowedCommand(NamedTuple):
    """One command that was sent, and what the shadow would have sent."""

    sent: ActuatorCommand
    shadow: ActuatorCommand
    saturated: bool


class Shadow:
    """Estimator and controller of one vehicle, driven by what was recorded."""

    def __init__(self, config: Config, path: FlownPath) -> None:
        """``path`` is what the controller follows."""
        self._vehicle = config.vehicle
        self._config = config.controller
        self._path = path
        self._estimator = ModelEstimator(self._vehicle, self._config)
        self._controller: Controller | None = None
        self._last_decision_s = 0.0
        self._steps: Vec3 = (0.0, 0.0, 0.0)

    def pose(self, pose: Pose) -> None:
        """Take one pose."""
        self._estimator.update(pose)
        self._estimate(pose.time_s)

    def compare_command(self, time_s: float, drive: ActuatorCommand, *, flying: bool) -> ShadowedCommand | None:
        """``drive`` was sent at ``time_s`` [s]; in flight, what the shadow would have sent, where there is a path."""
        acting = time_s + self._vehicle.acting_delay_s
        reference = self._path.at(acting) if flying else None
        compared = None
        if reference is not None and self._estimator.ready:
            if self._controller is None:  # what the stand has taught is forgotten, as at a take-off
                self._estimator.release()
                self._steps = (0.0, 0.0, 0.0)
                self._controller = make_controller(self._config, self._vehicle)
                self._last_decision_s = time_s
            estimate = self._estimate(acting)._replace(disturbance_step=self._steps)
            self._steps = (0.0, 0.0, 0.0)
            decision = self._controller.decide(estimate, reference, time_s - self._last_decision_s)
            self._last_decision_s = time_s
            compared = ShadowedCommand(drive, decision.drive, decision.saturated)
        self._estimator.add_command(time_s + self._vehicle.command_delay_s, drive)
        if isinstance(self._controller, Adaptive) and self._config.composite != "provable":
            self._estimator.drive(self._controller.b_hat)
        return compared

    def _estimate(self, time_s: float) -> Estimate:
        """The estimate; what it asks b̂ to change by is kept for the controller, as it is told only once."""
        estimate = self._estimator.predict(time_s)
        (a, b, c), (x, y, z) = self._steps, estimate.disturbance_step
        self._steps = (a + x, b + y, c + z)
        return estimate


def shadow_flight(
    config: Config,
    poses: Sequence[Pose],
    commands: Sequence[tuple[float, ActuatorCommand]],
    flown_s: tuple[float, float],
) -> list[ShadowedCommand]:
    """Run the shadow over ``poses`` and ``commands``; it flies between the two times ``flown_s`` [s]."""
    shadow, compared = Shadow(config, FlownPath(poses)), list[ShadowedCommand]()
    events = [(pose.arrival_s, 0, i) for i, pose in enumerate(poses)]
    events += [(time_s, 1, i) for i, (time_s, _) in enumerate(commands)]
    for time_s, is_command, i in sorted(events):
        if not is_command:
            shadow.pose(poses[i])
            continue
        flying = flown_s[0] <= time_s <= flown_s[1]
        if both := shadow.compare_command(time_s, commands[i][1], flying=flying):
            compared.append(both)
    return compared


class ComparedNumber(msgspec.Struct, frozen=True):
    """One number of the commands, as sent and as the shadow would have sent it, in flight."""

    sent_mean: float
    shadow_mean: float
    sent_std: float
    shadow_std: float
    difference_rms: float
    correlation: float | None
    """None where one of the two never changed."""


COMPARED = ("thrust_n", "roll_rate_rad_s", "pitch_rate_rad_s", "yaw_rate_rad_s")
"""Numbers of a command."""


def compare_commands(compared: Sequence[ShadowedCommand]) -> dict[str, ComparedNumber]:
    """The shadow's commands beside those that were sent, by number."""
    sent, shadow = (
        np.array([(one.thrust, *one.rates) for one in side])
        for side in ([both.sent for both in compared], [both.shadow for both in compared])
    )
    return {name: _compare(sent[:, i], shadow[:, i]) for i, name in enumerate(COMPARED)}


def _compare(sent: Column, shadow: Column) -> ComparedNumber:
    deviation = float(sent.std()), float(shadow.std())
    return ComparedNumber(
        float(sent.mean()),
        float(shadow.mean()),
        *deviation,
        float(np.sqrt(np.mean((shadow - sent) ** 2))),
        float(np.corrcoef(sent, shadow)[0, 1]) if min(deviation) > 0.0 else None,
    )
