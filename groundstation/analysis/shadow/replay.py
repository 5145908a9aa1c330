"""The shadow: our estimator and controller over a recording, at the recorded instants. Deterministic.

The estimator gets the poses as in flight, with the autopilot's own velocity and its resets, and the set-points that
were sent, as they are what the vehicle obeyed. At each set-point in flight the controller says what it would have
sent along the path that was flown (path.py). What it says goes nowhere: the next set-point is again the recorded one.
So a correction that it asks for is never made, and it keeps asking: its commands are livelier than they would be in
flight. Most of all where the autopilot's velocity is corrected (by GPS): that looks like wind, and wind is answered.
"""

import math
from typing import NamedTuple

from groundstation.analysis.shadow.flight import flying, thrust_shares
from groundstation.analysis.shadow.path import FlownPath
from groundstation.analysis.shadow.recording import Recording
from groundstation.core.control import Adaptive, make_controller
from groundstation.core.estimation import ModelEstimator
from groundstation.core.geometry import Vec3
from groundstation.core.messages import Controller, Estimate, Pose
from groundstation.core.vehicle import Drive
from groundstation.settings import Config


class Known(NamedTuple):
    """What the shadow made of one pose."""

    pose: Pose
    velocity_ned: Vec3
    """Estimated velocity at the pose's instant, after its correction [m/s]."""
    innovation_m: float
    """Distance from where the model expected the pose."""
    flying: bool


class Compared(NamedTuple):
    """One set-point that was sent, and what the shadow would have sent."""

    sent: Drive
    shadow: Drive
    saturated: bool


class Replayed(NamedTuple):
    """A whole recording."""

    known: list[Known]
    compared: list[Compared]
    ignored: int
    """Poses not newer than the one before, on our clock."""


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

    def pose(self, pose: Pose) -> tuple[Vec3, float]:
        """Take one pose; the estimated velocity there [m/s] and the innovation [m]."""
        innovation = 0.0
        if self._estimator.ready:
            innovation = math.dist(pose.position_ned, self._estimate(pose.time_s).motion.position)
        self._estimator.pose(pose)
        return self._estimate(pose.time_s).motion.velocity, innovation

    def sent(self, time_s: float, drive: Drive, *, flying: bool) -> Compared | None:
        """``drive`` was sent at ``time_s`` [s]; in flight, what the shadow would have sent, where there is a path."""
        acting = time_s + self._vehicle.command_delay_s
        reference = self._path.at(acting) if flying else None
        compared = None
        if reference is not None and self._estimator.ready:
            if self._controller is None:  # each take-off begins without what the stand has taught, as in flight
                self._estimator.release()
                self._steps = (0.0, 0.0, 0.0)
                self._controller = make_controller(self._config, self._vehicle)
                self._last_decision_s = time_s
            estimate = self._estimate(acting)._replace(disturbance_step=self._steps)
            self._steps = (0.0, 0.0, 0.0)
            decision = self._controller.decide(estimate, reference, time_s - self._last_decision_s)
            self._last_decision_s = time_s
            compared = Compared(drive, decision.drive, decision.saturated)
        elif not flying:
            self._controller = None
        self._estimator.sent(acting, drive)
        if isinstance(self._controller, Adaptive) and self._config.composite != "provable":
            self._estimator.follow(self._controller.b_hat)
        return compared

    def _estimate(self, time_s: float) -> Estimate:
        """The estimate; what it asks b̂ to change by is kept for the controller, as it is told only once."""
        estimate = self._estimator.predict(time_s)
        (a, b, c), (x, y, z) = self._steps, estimate.disturbance_step
        self._steps = (a + x, b + y, c + z)
        return estimate


def replay(recording: Recording, config: Config, path: FlownPath, hover: float | None) -> Replayed:
    """Run the shadow over ``recording``; ``hover``: see flight.py."""
    shares = thrust_shares(recording.sent, config.thrust_curve)
    flags = flying(recording, shares, hover)
    shadow = Shadow(config, path)
    known: list[Known] = []
    compared: list[Compared] = []
    ignored = 0
    in_flight = False
    full_thrust_n = config.full_thrust_n
    events: list[tuple[float, int, int]] = [
        *((seen.pose.arrival_s, 0, i) for i, seen in enumerate(recording.poses)),
        *((each.time_s, 1, i) for i, each in enumerate(recording.sent)),
    ]
    for time_s, is_sent, index in sorted(events):
        if is_sent:
            drive = Drive(full_thrust_n * shares[index], recording.sent[index].rates)
            both = shadow.sent(time_s, drive, flying=in_flight)
            if both is not None:
                compared.append(both)
            continue
        pose = recording.poses[index].pose
        if known and pose.time_s <= known[-1].pose.time_s:
            ignored += 1
            continue
        in_flight = bool(flags[index])
        velocity, innovation = shadow.pose(pose)
        known.append(Known(pose, velocity, innovation, in_flight))
    return Replayed(known, compared, ignored)
