"""Batch: many flights at once, N vehicles as arrays of shape (N,), from the same law, observer, predictor and plant.

What :func:`sim.runs.flight.fly` does with one vehicle through wire bytes, this does with N: the same random numbers,
the same cameras, frames, losses and outages, the same single-precision set-points. Only the orchestration is written
again (a test holds both against each other): the controller on arrays, memory and all, and what the referee writes
down. All vehicles are told the same and share the periods of frames and poses.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

import msgspec
import numpy as np
import numpy.typing as npt

from groundstation.config import ConfigError
from groundstation.core.control import Adaptive, Gains, Law
from groundstation.core.geometry import Ops, arrays
from groundstation.core.messages import ROUNDING_S, SATURATION_FROM_S, STEADY_S, Decision, Diagnostics, Estimate
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import ActuatorCommand, Vehicle
from groundstation.pose.sources import ViconConfig
from groundstation.settings import Config
from sim.batch.estimator import BatchEstimator, BatchWatch
from sim.batch.fleet import Fleet
from sim.batch.kernel import Array, Index
from sim.batch.stages import BatchStage, Numpy, Stages, columns
from sim.runs import CONFIRM_S, SETTLED_M, sought
from sim.world import World

STEADY_FROM_S = STEADY_S - ROUNDING_S


class Flights(NamedTuple):
    """One figure a flight, arrays of shape (N,); see :class:`sim.runs.referee.FlightVerdict`. Lengths in metres."""

    rms_m: Array
    max_m: Array
    settle_s: Array
    """nan where it never settled."""
    saturated: Array
    lyapunov_start: Array
    lyapunov_floor: Array
    certificate_violated: Array
    certificate_suspended: Array
    b_hat_share_max: Array
    """Largest |b̂| over the flight, in shares of B + ε [-]."""
    thrust_margin_n: Array
    """Least distance of the commanded thrust from either of its limits over the steady part [N]."""
    survived: npt.NDArray[np.bool_]


class Marks:
    """What the referee writes down about N flights."""

    def __init__(self, count: int, duration_s: float, vehicle: Vehicle, law: Law, watch: BatchWatch) -> None:
        """All still fly; ``vehicle`` and ``law`` as told, whose limits and bounds margins are counted from.

        ``watch`` is shown every command.
        """
        self._alive = np.ones(count, bool)
        self._squares, self._max = np.zeros(count), np.zeros(count)
        self._last_far = np.zeros(count)
        self._saturated, self._late, self._steps = np.zeros(count), 0, 0
        self._duration = duration_s
        self._law, self._watch = law, watch
        self._told_kg = vehicle.mass_kg
        self._thrusts = vehicle.thrust_min_n, vehicle.thrust_max_n
        self._margin, self._b_hat = np.full(count, np.inf), np.zeros(count)
        self._v: list[Array] = []

    def mark_failed(self, who: Any) -> None:
        """These flights have failed."""
        self._alive &= ~who

    def command(self, time_s: float, decision: Decision, estimate: Estimate, wind: Array) -> None:
        """One command of each, what it was computed from, and the true disturbance b [m/s², NED] at that instant."""
        self._watch.look(decision)
        law, seen = self._law, decision.diagnostics
        if time_s >= SATURATION_FROM_S:
            self._saturated += decision.saturated
            self._late += 1
        x, y, z = seen.b_hat
        self._b_hat = np.maximum(self._b_hat, x * x + y * y + z * z)
        if 0.0 < time_s < STEADY_FROM_S:
            return
        weight = 0.5 / law.kb if law.kb > 0.0 else 0.0
        wind = sought(wind, estimate, self._told_kg)
        self._v.append(seen.v_known + weight * ((x - wind[0]) ** 2 + (y - wind[1]) ** 2 + (z - wind[2]) ** 2))
        if time_s >= STEADY_FROM_S:
            low, high = self._thrusts
            thrust: Any = decision.drive.thrust
            self._margin = np.minimum(self._margin, np.minimum(thrust - low, high - thrust))

    def steps(self, ends: Array, errors: Array) -> None:
        """The errors [m] of shape (steps, N) after the plant steps that end at ``ends`` [s after the release]."""
        far = errors >= SETTLED_M
        last = ends[ends.size - 1 - np.argmax(far[::-1], axis=0)]
        self._last_far = np.where(far.any(axis=0), last, self._last_far)
        steady = errors[ends >= STEADY_FROM_S]
        for error in steady:
            self._squares += error * error
        if len(steady):
            self._max = np.maximum(self._max, steady.max(axis=0))
            self._steps += len(steady)

    def flights(self) -> Flights:
        """The figures; nan for those that crashed."""
        law = self._law
        nan = np.where(self._alive, 0.0, np.nan)
        settled = np.where(self._last_far < self._duration - 0.01, self._last_far, np.nan)
        violated, suspended = self._watch.shares()
        floor = np.full(nan.size, np.nan)
        if len(self._v) > 2:  # long enough to have a steady part
            v = np.array(self._v[1:])
            floor = np.sort(v, axis=0)[len(v) // 2]
        return Flights(
            rms_m=np.sqrt(self._squares / max(self._steps, 1)) + nan,
            max_m=self._max + nan,
            settle_s=settled + nan,
            saturated=self._saturated / max(self._late, 1),
            lyapunov_start=self._v[0],
            lyapunov_floor=floor + nan,
            certificate_violated=violated + nan,
            certificate_suspended=suspended + nan,
            b_hat_share_max=np.sqrt(self._b_hat) / (law.b_bound + law.epsilon) + nan,
            thrust_margin_n=self._margin + nan,
            survived=self._alive,
        )


class BatchPilot:
    """All vehicles are told the same, and a command leaves every ``period_s`` [s]."""

    def __init__(self, vehicle: Vehicle, gains: Gains, period_s: float, stages: Stages) -> None:
        """Start as :class:`Adaptive` does."""
        self._vehicle, self._gains, self._period, self._stages = vehicle, gains, period_s, stages
        self._decide: BatchStage | None = None

    def decide(self, estimate: Estimate, reference: Reference) -> Decision:
        """One command each."""
        if self._decide is None:  # the first, before which there is nothing to remember
            pilot = Adaptive(self._vehicle, self._gains, arrays())
            decision = pilot.decide(estimate, reference, 0.0)
            self._decide = self._stages(self._decide_each, columns(pilot.memory, np.size(decision.saturated)))
            return decision
        drive, saturated, seen = self._decide((estimate, msgspec.structs.astuple(reference)))
        return Decision(drive, saturated, Diagnostics(*seen))

    def _decide_each(self, ops: Ops, memory: Any, given: Any) -> Any:
        estimate, reference = given
        pilot = Adaptive(self._vehicle, self._gains, ops)
        pilot.memory = memory
        drive, saturated, seen = pilot.decide(estimate, Reference(*reference), self._period)
        return pilot.memory, (drive, saturated, msgspec.structs.astuple(seen))


HANDSHAKE_S = 1.2
"""How long PX4 wants set-points before it is armed: the hand-shake of a whole flight lasts so many whole frames [s]."""


def require_batchable(world: World, config: Config) -> None:
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
    if world.tunnel != type(world.tunnel)():
        raise ConfigError("sim.tunnel", "a batch flies in no wind tunnel: leave it out")
    for name in ("occlusion_s", "swap_s"):
        if getattr(world, name) > 0.0:
            raise ConfigError(f"sim.{name}", "the cameras of a batch never take one body for another; expected 0")


OnPoses: TypeAlias = Callable[[Index, Array, Any, Any], None]
"""Takes who has a pose, its stamp [s], position [m, NED] and attitude."""
OnCommands: TypeAlias = Callable[[float, ActuatorCommand], None]
"""Takes when commands leave [s], and those of all."""


def fly_batch(
    worlds: Sequence[World],
    config: Config,
    seeds: Sequence[int],
    *,
    duration_s: float = 60.0,
    stages: Stages = Numpy,
    on_poses: OnPoses | None = None,
    on_commands: OnCommands | None = None,
) -> Flights:
    """Fly N vehicles in N worlds, all told the same ``config``, for ``duration_s`` [s] after the release.

    ``stages`` computes them; whichever does, the figures are the same. ``on_poses`` and ``on_commands`` are shown what
    a recording would have.

    Raises:
        ValueError: the worlds differ in a period or in the reference.
        ConfigError: see :func:`require_batchable`.
    """
    gains, vehicle, pose = config.controller, config.vehicle, config.pose
    first = worlds[0]
    for name in ("frame_period_s", "pose_rate_hz", "speed_m_s", "gravity", "plant"):
        if any(getattr(w, name) != getattr(first, name) for w in worlds):
            raise ValueError(f"all flights of a batch need the same sim.{name}")
    for world in worlds:
        require_batchable(world, config)
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
            if on_poses is not None:
                on_poses(who, stamp, position, attitude)
        if frame < 0:
            fleet.hold(time)
            continue
        if frame == 0:
            estimator.release()
        # Where poses stay away too long commands stop, and with them the flight.
        marks.mark_failed(time > estimator.stamp_s + config.flight.coast_s)
        estimate = estimator.predict(time + vehicle.acting_delay_s)
        decision = pilot.decide(estimate, trajectory.at(time + vehicle.acting_delay_s))
        estimator.take_command(frame, decision.drive)
        if on_commands is not None:
            on_commands(time, decision.drive)
        fleet.command(frame, time, decision.drive, config.full_thrust_n, config.thrust_curve)
        fleet.fly(time)
        marks.command(time, decision, estimate, fleet.felt[0])
        ends = time + np.arange(steps, dtype=np.float64) * h + h
        ends = ends[ends <= duration_s + 1e-9]  # the last frame is held beyond the end of the flight
        wanted = np.array([trajectory.position_at(end) for end in ends.tolist()])
        marks.steps(ends, np.sqrt(((fleet.track[1 : ends.size + 1, :3] - wanted[:, :, None]) ** 2).sum(axis=1)))
        marks.mark_failed(fleet.find_crashes(ends.size))
    return marks.flights()
