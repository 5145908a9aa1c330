"""Other simulators for ``bench --peers``: the dependency group ``peers``, imported only when measured."""

import sys
import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

VEHICLES = 1000
STEPS = 50


class Bench(NamedTuple):
    """Something to time."""

    run: Callable[[], None]
    vehicle_steps: int
    """Vehicles times steps of one run."""
    note: str
    """What a reader must know of it; may be empty."""


def crazyflow(**settings: Any) -> Bench:
    """crazyflow (JAX, single precision): Mellinger's controller at a fixed point, rigid body and rotors."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import jax
        from crazyflow.control import Control
        from crazyflow.sim import Sim

        sim = Sim(n_worlds=VEHICLES, control=Control.state, freq=500, **settings)
        # Position, velocity, acceleration, attitude (x y z w) and rates.
        command = np.zeros((VEHICLES, 1, 16), np.float32)
        command[..., 2], command[..., 12] = 0.3, 1.0
        sim.state_control(command)

    def run() -> None:
        sim.step(STEPS)
        jax.block_until_ready(sim.data)

    run()  # compiles; and again, as the data's layout has changed
    return Bench(run, VEHICLES * STEPS, "single precision, rotor dynamics")


def rotorpy() -> Bench:
    """rotorpy: its SE(3) controller and one vehicle, steps of 2 ms; its batch needs torch."""
    from rotorpy.controllers.quadrotor_control import SE3Control
    from rotorpy.vehicles.crazyflie_params import quad_params
    from rotorpy.vehicles.multirotor import Multirotor

    vehicle, law = Multirotor(quad_params), SE3Control(quad_params)
    state = {key: np.array(value, float) for key, value in vehicle.initial_state.items()}
    nought = np.zeros(3)
    wanted: dict[str, Any] = {"x": nought, "x_dot": nought, "x_ddot": nought, "x_dddot": nought, "x_ddddot": nought}
    wanted |= {"yaw": 0.0, "yaw_dot": 0.0, "yaw_ddot": 0.0}

    def run() -> None:
        nonlocal state
        for _ in range(STEPS):
            state = vehicle.step(state, law.update(0.0, state, wanted), 0.002)

    return Bench(run, STEPS, "one vehicle at a time: its batch needs torch, which is not in the group")


def fly_circle(duration_s: float) -> None:
    """A whole flight of rotorpy's, at its defaults: its SE(3) controller on a circle at 100 Hz."""
    from rotorpy.controllers.quadrotor_control import SE3Control
    from rotorpy.environments import Environment
    from rotorpy.trajectories.circular_traj import ThreeDCircularTraj
    from rotorpy.vehicles.crazyflie_params import quad_params
    from rotorpy.vehicles.multirotor import Multirotor

    room = Environment(Multirotor(quad_params), SE3Control(quad_params), ThreeDCircularTraj())
    room.run(t_final=duration_s, plot=False)


PEERS: dict[str, Callable[[], Bench]] = {
    "crazyflow, 1,000 vehicles: its defaults (Euler)": crazyflow,
    "crazyflow, 1,000 vehicles: RK4, every loop at every step": lambda: crazyflow(integrator="rk4", state_freq=500),
    "rotorpy, one vehicle: law and plant at every step": rotorpy,
}


if __name__ == "__main__":
    fly_circle(float(sys.argv[1]))
