"""Comparison of the poses with the attitude that the vehicle reports. Sans-IO."""

from groundstation.core.messages import Pose
from groundstation.core.safety import PoseLatency, Witness
from links.core import Attitude

WAITING_POSES = 64
"""Number of poses that wait for the vehicle's attitude, at most [-]."""


class AttitudeComparison:
    """Comparison of the poses with the attitude that the vehicle reports: do they agree, and how late are they?

    Poses wait until the vehicle reports its attitude, or a result is needed.
    """

    def __init__(self) -> None:
        self.witness, self.latency = Witness(), PoseLatency()
        self._unseen: list[Pose] = []

    def add_pose(self, pose: Pose) -> None:
        """Take one pose."""
        self._unseen.append(pose)
        if len(self._unseen) >= WAITING_POSES:
            self.compare()

    def compare(self) -> Witness:
        """Compare all poses so far."""
        unseen, self._unseen = self._unseen, []
        for pose in unseen:
            self.witness.add_pose(pose)
            self.latency.add_pose(pose)
        return self.witness

    def add_attitude(self, attitude: Attitude) -> Witness:
        """Compare all poses so far, then take the vehicle's own attitude."""
        self.compare()
        self.witness.add_attitude(attitude)
        self.latency.add_attitude(attitude)
        return self.witness

    def find_latency(self) -> tuple[float, float] | None:
        """Return the extra delay of all poses so far, and its 1σ [s]; None before it is known."""
        self.compare()
        return self.latency.estimate
