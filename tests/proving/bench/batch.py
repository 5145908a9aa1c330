"""Nanoseconds per vehicle and step: law and plant on arrays of vehicles, beside other simulators in the same run.

These are the dependency group ``peers``, for ``bench --peers``, imported only when measured.
"""

import sys
import warnings
from collections.abc import Callable
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from groundstation.core.control import Adaptive, Gains
from groundstation.core.geometry import FLOATS, Ops, arrays
from groundstation.core.messages import Estimate
from groundstation.core.trajectory import LemniscateConfig
from groundstation.core.vehicle import Motion, Vehicle
from sim.batch import fly_batch, zeros
from sim.scenarios import SCENARIOS, prepare
from sim.world import Body, Physics, integrate
from tests.proving.bench.bench import Options, in_turns


class Bench(NamedTuple):
    """Something to time."""

    run: Callable[[], None]
    vehicle_steps: int
    """Vehicles times steps of one run."""
    note: str
    """Note for the reader; may be empty."""


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


VEHICLES = 1000
STEPS = 50
"""Steps of one turn."""
STEP_S = 0.0025
FLIGHT_S = 1.0
"""Length of the whole flights of one turn [s]."""
ROUNDS = 5


def law_and_plant(count: int, ops: Ops, steps: int) -> Bench:
    """One law and one step of the plant for each of ``count`` vehicles (plain floats for one), in double precision."""
    vehicle = Vehicle()
    pilot = Adaptive(vehicle, Gains(), ops)
    world = SCENARIOS["paper"].world
    physics = Physics(world.mass_kg, world.thrust_lag_s, world.rate_lag_s, 0.0, 0.0, world.gravity)
    trajectory = LemniscateConfig().build()
    one: Any = 1.0 if count == 1 else np.ones(count)
    nought: Any = (0.0, 0.0, 0.0) if count == 1 else zeros(count, 3)
    body = Body(nought, nought, (one, *nought), 0.785 * one, nought)
    time = 0.0

    def run() -> None:
        nonlocal body, time
        for _ in range(steps):
            estimate = Estimate(time, Motion(*body), nought, nought)
            drive = pilot.decide(estimate, trajectory.at(time), STEP_S).drive
            body = integrate(ops, body, drive.thrust, drive.rates, nought, STEP_S, physics)
            time += STEP_S

    return Bench(run, count * steps, "")


def whole_flights() -> Bench:
    """Flights of a campaign: observer, predictor, law at 44 Hz, plant at 400 Hz, cameras, wind, wire rounding."""
    world, config = prepare(SCENARIOS["adverse"], [])
    worlds, seeds = [world] * VEHICLES, list(range(VEHICLES))
    steps = round(FLIGHT_S / world.frame_period_s) * round(world.frame_period_s / world.step_s)
    return Bench(lambda: _ignore(fly_batch(worlds, config, seeds, duration_s=FLIGHT_S)), VEHICLES * steps, "")


def _ignore(_: object) -> None:
    """A run answers nothing."""


OURS: dict[str, Callable[[], Bench]] = {
    "ours, 1,000 vehicles: law and plant at every step": lambda: law_and_plant(VEHICLES, arrays(), STEPS),
    "ours, 1,000 vehicles: whole flights of a campaign": whole_flights,
    "ours, one vehicle: law and plant at every step": lambda: law_and_plant(1, FLOATS, 1000),
}


def measure(options: Options) -> dict[str, Any]:
    """Every row in turns; a peer that can't run says why in its note."""
    rows: dict[str, dict[str, Any]] = {}
    benches: dict[str, Bench] = {}
    for name, make in {**OURS, **(PEERS if options.peers else {})}.items():
        start = perf_counter()
        rows[name] = {"name": name, "ns_per_vehicle_step": None, "ratio": None, "start_up_s": None, "note": ""}
        try:
            bench = make()
            bench.run()
        except ImportError as error:
            rows[name]["note"] = f"not measured: {error}; install it with `uv sync --group peers`"
            continue
        except Exception as error:  # noqa: BLE001  # whatever a peer does, the others are measured
            rows[name]["note"] = f"not measured: {type(error).__name__}: {error}".strip()
            continue
        rows[name] |= {"start_up_s": perf_counter() - start, "note": bench.note}
        benches[name] = bench
    found = in_turns({name: bench.run for name, bench in benches.items()}, ROUNDS)
    ours = found[next(iter(OURS))] / benches[next(iter(OURS))].vehicle_steps
    for name, spent in found.items():
        each = spent / benches[name].vehicle_steps
        rows[name] |= {"ns_per_vehicle_step": 1e9 * each, "ratio": each / ours}
    return {"rounds": ROUNDS, "rows": list(rows.values())}


def text(facts: dict[str, Any]) -> list[str]:
    """A table."""
    lines = [f"{'ns per vehicle and step':58}{'ns':>10}{'ratio':>9}{'start-up':>11}"]
    for row in facts["rows"]:
        if row["ns_per_vehicle_step"] is None:
            lines.append(f"{row['name']:58}{'-':>10}  {row['note']}")
            continue
        lines.append(
            f"{row['name']:58}{row['ns_per_vehicle_step']:>10.0f}{row['ratio']:>9.2f}{row['start_up_s']:>9.1f} s"
            + (f"  {row['note']}" if row["note"] else "")
        )
    return lines
