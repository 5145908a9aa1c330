"""Many flights at once: N vehicles as arrays of shape (N,), from the same law, observer, predictor and plant.

What :func:`sim.runs.fly.fly` does with one vehicle through wire bytes, this does with N: the same random numbers,
the same cameras, frames, losses and outages, the same single-precision set-points. Only the orchestration is written
again (a test holds both against each other). All vehicles are told the same and share the periods of frames and poses.
"""

import math
from collections.abc import Sequence

import numpy as np

from groundstation.config.load import ConfigError
from groundstation.core.control.gains import Gains
from groundstation.pose.sources.vicon import ViconConfig
from groundstation.settings.settings import Config
from sim.batch.estimator import BatchEstimator
from sim.batch.fleet import Fleet
from sim.batch.marks import Flights, Marks
from sim.batch.pilot import BatchPilot
from sim.batch.stages import Numpy, Stages
from sim.batch.watch import BatchWatch
from sim.runs.fly import CONFIRM_S
from sim.world.world import World

HANDSHAKE_S = 1.2
"""How long PX4 wants set-points before it is armed: the hand-shake of a whole flight lasts so many whole frames [s]."""


def check(world: World, config: Config) -> None:
    """Refuse what no batch can fly as whole flights do, in ``world``.

    Raises:
        ConfigError: the key, and what a batch flies instead.
    """
    gains = config.controller
    if gains.kind != "adaptive" or gains.composite != "provable" or gains.observer != "model":
        raise ConfigError(
            "controller", "a batch flies the adaptive controller with its observer and provable adaptation only"
        )
    if not isinstance(config.pose, ViconConfig):
        raise ConfigError("pose.kind", f"a batch sees through 'vicon' only, got {config.pose.__struct_config__.tag!r}")
    for key, delay_s in (
        ("vehicle.command_delay_s", config.vehicle.command_delay_s),
        ("sim.command_delay_s", world.command_delay_s),
    ):
        if delay_s > 0.0:
            raise ConfigError(key, "the commands of a batch act at once; expected 0")
    for name in ("occlusion_s", "swap_s"):
        if getattr(world, name) > 0.0:
            raise ConfigError(f"sim.{name}", "the cameras of a batch never take one body for another; expected 0")


def fly_batch(
    worlds: Sequence[World], config: Config, seeds: Sequence[int], *, duration_s: float = 60.0, stages: Stages = Numpy
) -> Flights:
    """Fly N vehicles in N worlds, all told the same ``config``, for ``duration_s`` [s] after the release.

    ``stages`` computes them; whichever does, the figures are the same.

    Raises:
        ValueError: the worlds differ in a period or in the reference.
        ConfigError: see :func:`check`.
    """
    gains, vehicle, pose = config.controller, config.vehicle, config.pose
    first = worlds[0]
    for name in ("frame_period_s", "pose_rate_hz", "speed_m_s", "gravity"):
        if any(getattr(w, name) != getattr(first, name) for w in worlds):
            raise ValueError(f"all flights of a batch need the same sim.{name}")
    for world in worlds:
        check(world, config)
    assert isinstance(gains, Gains) and isinstance(pose, ViconConfig)
    period = first.frame_period_s
    steps = math.ceil(period / first.step_s - 1e-9)
    h = period / steps
    release_s = CONFIRM_S + math.ceil(HANDSHAKE_S / period - 1e-9) * period
    fleet = Fleet(
        worlds,
        seeds,
        duration_s=duration_s,
        release_s=release_s,
        steps=steps,
        told_latency_s=pose.latency_s,
        stages=stages,
    )
    weight = vehicle.mass_kg * gains.gravity
    estimator = BatchEstimator(vehicle, gains, fleet.start, config.flight.idle_thrust * weight, period, stages)
    pilot = BatchPilot(vehicle, gains, period, stages)
    trajectory = config.trajectory.build()
    watch = BatchWatch(fleet.count, gains, period)
    marks = Marks(fleet.count, duration_s, vehicle, gains, watch)
    for frame in range(-math.ceil(release_s / period), math.ceil(duration_s / period - 1e-9)):
        time = frame * period
        for who, stamp, position, attitude in fleet.arrived(time):
            estimator.pose(who, stamp, position, attitude)
            watch.pose(who, stamp, estimator.noise_m2)
        if frame < 0:
            fleet.hold(time)
            continue
        if frame == 0:
            estimator.release()
        # Where poses stay away too long commands stop, and with them the flight.
        marks.lost(time > estimator.stamp_s + config.flight.coast_s)
        estimate = estimator.predict(time)
        decision = pilot.decide(estimate, trajectory.at(time))
        estimator.sent(frame, decision.drive)
        fleet.command(frame, time, decision.drive, config.full_thrust_n, config.thrust_curve)
        fleet.fly(time)
        marks.command(time, decision, estimate, fleet.felt[0])
        ends = time + np.arange(steps, dtype=np.float64) * h + h
        ends = ends[ends <= duration_s + 1e-9]  # the last frame is held beyond the end of the flight
        wanted = np.array([trajectory.position_at(end) for end in ends.tolist()])
        marks.steps(ends, np.sqrt(((fleet.track[1 : ends.size + 1, :3] - wanted[:, :, None]) ** 2).sum(axis=1)))
        marks.lost(fleet.crashed(ends.size))
    return marks.flights()
