"""The simulated vehicle as its autopilot sees it: the plant behind motors that may be off, and its own estimate."""

from collections.abc import Iterator

import msgspec

from groundstation import so3
from groundstation.ops import Quat, Vec3
from links.thrust_curve import thrust
from sim.airframe import Truth
from sim.horizon import Horizon
from sim.quadrotor import Quadrotor
from sim.world import World


class SimulatedVehicle:
    """Implements :class:`sim.airframe.Airframe` on a :class:`Quadrotor`."""

    def __init__(
        self, plant: Quadrotor, world: World, noise: Iterator[list[float]], horizon: Horizon | None = None
    ) -> None:
        """Motors off; ``noise`` gives rows of six standard normal numbers for :meth:`measured`.

        Without a ``horizon`` its attitude is that of :meth:`measured`, as where its own estimate serves as the poses.
        """
        self.plant = plant
        self._world = world
        self._noise = noise
        self._horizon = horizon
        self._on = False

    def act(self, time_s: float, thrust_fraction: float, rates_rad_s: Vec3) -> None:
        """From ``time_s`` on, follow a thrust signal (0..1) and body rates [rad/s, FRD]."""
        if self._on:
            share = thrust(thrust_fraction, self._world.thrust_curve)
            self.plant.command(time_s, share * self._world.thrust_max_n, rates_rad_s)

    def power(self, time_s: float, on: bool) -> None:
        """Motors on or off."""
        self._on = on
        if not on:
            self.plant.command(time_s, 0.0, (0.0, 0.0, 0.0))

    def release(self, time_s: float) -> None:
        """Let go of the vehicle that is held in the air."""
        self.plant.release(time_s)

    def truth(self, time_s: float) -> Truth:
        """The exact state."""
        return self.plant.truth(time_s)

    def measured(self, time_s: float) -> Truth:
        """The state with the noise that the scenario gives to poses."""
        return with_noise(self.plant.truth(time_s), self._world, next(self._noise))

    def felt(self, time_s: float) -> tuple[Quat, Vec3]:
        """Attitude and body rates as its own estimator has them."""
        if self._horizon is not None:
            return self._horizon.feel(self.plant.truth(time_s))
        seen = self.measured(time_s)
        return seen.attitude, seen.rates_rad_s


def with_noise(truth: Truth, world: World, normals: list[float]) -> Truth:
    """``truth`` with the scenario's noise on position and attitude, from six standard normal numbers."""
    n, a = world.pose_noise_m, world.attitude_noise_rad
    if n == 0.0 and a == 0.0:
        return truth
    (x, y, z), (i, j, k, roll, pitch, yaw) = truth.position_ned, normals
    return msgspec.structs.replace(
        truth,
        position_ned=(x + n * i, y + n * j, z + n * k),
        attitude=so3.turned(truth.attitude, (a * roll, a * pitch, a * yaw)),
    )
