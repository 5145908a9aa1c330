"""Dead reckoning: motion by the commands since the poses were above suspicion. Sans-IO."""

from collections import deque

import msgspec

from groundstation.core.geometry import FLOATS, Vec3
from groundstation.core.vehicle import ActuatorCommand, Motion, Vehicle, integrate, schedule

REMEMBER_S = 5.0
"""Time for which estimates and commands are kept [s]: the longest window of the response, and of
``SUSPECT``."""
STEP_S = 0.08
"""Longest single step of the model [s]. Chosen: short against the lags of thrust and rates (.1
s)."""


class Trusted(msgspec.Struct, frozen=True, gc=False):
    """State of the vehicle at one pose that was above suspicion."""

    time_s: float
    """Stamp of the pose, on the event loop's clock [s]."""
    motion: Motion
    disturbance: Vec3
    """Mean of the last seconds [m/s², NED]."""
    effectiveness: float
    """λ̂, estimated thrust scale [-]."""


class Reckoning:
    """Trusted estimates and commands of one vehicle. Times are on the event loop's clock [s]."""

    def __init__(self, vehicle: Vehicle, gravity: float) -> None:
        self._vehicle, self._gravity = vehicle, gravity
        self._trusted: deque[Trusted] = deque()
        self._drives: deque[tuple[float, ActuatorCommand]] = deque()

    def begin(self, first: Trusted) -> None:
        """Keep ``first`` alone."""
        self._trusted.clear()
        self._trusted.append(first)

    def trust(self, newest: Trusted) -> None:
        """Keep one more trusted estimate."""
        self._trusted.append(newest)
        while self._trusted[0].time_s < newest.time_s - REMEMBER_S:
            self._trusted.popleft()

    def find_trusted(self, until_s: float) -> Trusted:
        """Return the newest estimate trusted up to ``until_s``, or the oldest kept."""
        return next(
            (one for one in reversed(self._trusted) if one.time_s <= until_s), self._trusted[0]
        )

    def add_command(self, arrival_s: float, drive: ActuatorCommand) -> None:
        """Take a command that affects poses stamped from ``arrival_s`` [s] on."""
        drives = self._drives
        schedule(drives, self._vehicle, arrival_s, drive)
        while drives[0][0] < arrival_s - REMEMBER_S:
            drives.popleft()

    def reckon(self, before: Trusted, until_s: float) -> Motion:
        """Return the motion at ``until_s`` [s] by the commands since ``before``."""
        motion = before.motion
        now = before.time_s
        mass = self._vehicle.mass_kg / before.effectiveness
        drives = list(self._drives)
        for i, (begins, drive) in enumerate(drives):
            ends = min(drives[i + 1][0] if i + 1 < len(drives) else until_s, until_s)
            if ends > max(begins, now):
                motion = self.propagate(motion, drive, ends - now, mass, before.disturbance)
            now = max(now, ends)
        return motion

    def propagate(
        self,
        motion: Motion,
        drive: ActuatorCommand,
        duration_s: float,
        mass_kg: float,
        disturbance: Vec3,
    ) -> Motion:
        """Return ``motion`` after ``duration_s`` [s] of one ``drive``, in steps of ``STEP_S`` at
        most.

        ``mass_kg`` is the effective mass m/λ̂ [kg], ``disturbance`` is in [m/s², NED].
        """
        vehicle = self._vehicle
        steps = int(duration_s / STEP_S) + 1
        for _ in range(steps):
            motion = integrate(
                FLOATS,
                motion,
                drive,
                duration_s / steps,
                mass=mass_kg,
                gravity=self._gravity,
                disturbance=disturbance,
                thrust_lag=vehicle.thrust_lag_s,
                rate_lag=vehicle.rate_lag_s,
                drag=vehicle.drag_per_s,
            )
        return motion
