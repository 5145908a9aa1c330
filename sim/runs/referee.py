"""Referee: judges simulated flights and missions by the truth, which the controller never sees."""

import math
from array import array
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import msgspec

from groundstation.core.control import SUSPENDED, VIOLATED
from groundstation.core.geometry import Vec3, third_column
from groundstation.core.messages import (
    LEAST_JUDGED_S,
    SATURATION_FROM_S,
    SETTLED_M,
    STEADY_S,
    DisturbanceMeter,
    DisturbanceReading,
    Estimate,
    SteadyError,
    Tick,
    begin_of_steady_part,
)
from groundstation.core.mission import State
from groundstation.core.trajectory import Trajectory
from groundstation.core.vehicle import Vehicle
from sim.world import World

BACK_M = 0.05
"""After a step of the wind: back once the error stays below this [m]."""
CRASH_M = 20.0
"""Farther than this from the start, no room holds the vehicle [m]."""


class StateEntry(msgspec.Struct, frozen=True):
    """A state of the mission, when it began, and why."""

    state: str
    time_s: float
    """On the event loop's clock [s]."""
    reason: str


class MissionVerdict(msgspec.Struct, frozen=True, kw_only=True):
    """Verdict on one vehicle's mission, by the truth."""

    landed: bool
    """On the floor, motors off, and nothing made it come down early."""
    why: str
    """Why it ended, or what made it come down early."""
    states: tuple[StateEntry, ...]
    """In their order; of a fleet, times are from the first vehicle's release [s]."""
    touchdown_m_s: float | None
    """Fastest that it met the floor; None where it never did."""
    rms_cm: float | None
    """RMS of the true position error on the figure [cm], from 15 s on; None for a shorter
    flight."""
    max_cm: float | None
    figure_s: float
    """Length of that part [s]."""
    home_m: float
    """Distance between take-off and where the vehicle stands now [m]."""


class TrueTrack:
    """Every step of one plant after its release.

    Times on the event loop's clock [s], places in metres, NED.
    """

    def __init__(self) -> None:
        self.times = array("d")
        self._places = array("d")
        """North, east and down of every step, one after the other."""

    def step(self, time_s: float, place: Vec3) -> None:
        """One step."""
        self.times.append(time_s)
        self._places.extend(place)

    @property
    def axes(self) -> tuple["array[float]", "array[float]", "array[float]"]:
        """North, east and down [m], one entry a step."""
        return self._places[0::3], self._places[1::3], self._places[2::3]

    def errors(
        self,
        trajectory: Trajectory,
        start_s: float,
        since_s: float = -math.inf,
        until_s: float = math.inf,
    ) -> list[float]:
        """Distances from a trajectory begun at ``start_s`` [m], at each step from ``since_s`` until
        ``until_s``.
        """
        at = trajectory.position_at
        steps = zip(self.times, *self.axes, strict=True)
        return [math.dist(place, at(t - start_s)) for t, *place in steps if since_s <= t < until_s]

    def judge_figure(
        self,
        trajectory: Trajectory,
        started_s: float | None,
        states: Sequence[StateEntry],
        step_s: float,
    ) -> dict[str, Any]:
        """``rms_cm``, ``max_cm`` and ``figure_s``: from 15 s after the figure's beginning until it
        is left. Errors of a figure that is left before ``LEAST_JUDGED_S`` are None.

        Args:
            trajectory: the figure.
            started_s: when it began; None where it did not.
            states: of the mission, in their order.
            step_s: of the plant [s].
        """
        steady: list[float] = []
        if started_s is not None:
            left_s = min(
                (b.time_s for a, b in pairwise(states) if a.state == State.TRACKING),
                default=math.inf,
            )
            steady = self.errors(trajectory, started_s, started_s + STEADY_S, left_s)
        figure_s = len(steady) * step_s
        judged = steady if STEADY_S + figure_s >= LEAST_JUDGED_S else []
        return {**summarize_errors(judged), "figure_s": figure_s}


def summarize_errors(errors: list[float]) -> dict[str, float | None]:
    """``rms_cm`` and ``max_cm`` of ``errors`` [m]; None where there are none."""
    return {
        "rms_cm": 100.0 * math.sqrt(sum(e * e for e in errors) / len(errors)) if errors else None,
        "max_cm": 100.0 * max(errors) if errors else None,
    }


EFFORT_S = 0.15
"""Slower changes of the commanded body rates are the figure's own [s]."""


class Effort:
    """Control effort: the commanded roll and pitch rates [rad/s] less their low-pass of
    ``EFFORT_S``.

    Numbers, or arrays of shape (N,).
    """

    def __init__(self) -> None:
        self._slow: Any = None
        self._time = 0.0

    def square(self, time_s: float, rates: Any) -> Any:
        """The mean square of both for one more command, at ``time_s`` [s]: [rad²/s²]."""
        (p, q, _), keep = rates, math.exp(-(time_s - self._time) / EFFORT_S)
        x, y = (p, q) if self._slow is None else self._slow
        self._slow = x, y = p + keep * (x - p), q + keep * (y - q)
        self._time = time_s
        return 0.5 * ((p - x) ** 2 + (q - y) ** 2)


class FlightVerdict(msgspec.Struct, frozen=True, kw_only=True):
    """The figures of one flight.

    Lengths of the errors are true position against reference, at plant steps.
    """

    rms_cm: float | None
    """Over the steady part; None where the flight ended before it."""
    max_cm: float | None
    settle_s: float | None
    """First time after which the error stays below 10 cm; None if there is none."""
    estimate_rms_cm: float | None = None
    """RMS of the estimated position error [cm], as dashboards and reports show it."""
    wind_true: Vec3
    """Mean true disturbance over the last second [m/s², NED], without the effect of wrong thrust or
    mass."""
    wind_estimate: Vec3
    """Mean b̂ over the last second [m/s², NED]."""
    disturbance_true: Vec3 = (0.0, 0.0, 0.0)
    """Mean acceleration over the last second beyond that of thrust, mass and drag as told
    [m/s², NED]: the wind, drag that was not told, and what thrust and mass are off."""
    disturbance_found: Vec3 = (0.0, 0.0, 0.0)
    """Disturbance as the estimator finds it [m/s², NED]: what every screen and report shows."""
    disturbance: DisturbanceReading | None = None
    """Disturbance and its split into wind and thrust scale, each with its interval; None without a
    command."""
    thrust_effectiveness: float
    """λ̂ at the last command [-]."""
    thrust_min_n: float | None
    thrust_max_n: float | None
    """Commanded thrust over the whole flight [N]."""
    effort_rad_s: float | None
    """RMS over the steady part of what :class:`Effort` has of each command; None where the flight
    ended before it."""
    saturated_fraction: float
    """Share of the commands after 5 s in which any of the four was clamped."""
    lyapunov_increase_max: float | None
    """Largest increase of V from one command to the next over the steady part."""
    lyapunov_floor: float | None
    """Median of V over the steady part: its sampling and noise floor."""
    lyapunov_start: float | None
    """V at the first command."""
    certificate_violated: float
    """Share of the commands at which V's bound was violated for longer than a moment; see
    control/certificate.py."""
    certificate_suspended: float
    """Share of the commands at which it was suspended, as the one before was clamped."""
    certificate_warnings: tuple[str, ...]
    """Warnings of the certificate to the operator, with the time on the trajectory."""
    gust_peak_cm: float | None = None
    """After a step of the wind: largest error [cm]."""
    gust_back_s: float | None = None
    """After a step of the wind: time until the error stays below 5 cm [s]."""


class Referee:
    """Sees every step of the plant and every command of one flight."""

    def __init__(self, world: World, told: Vehicle, kb: float | None) -> None:
        """Take the truth, and the vehicle that the controller was told.

        ``kb`` weighs b̃ in V (0: V without that term; None: the controller has no V at all).
        """
        self._world = world
        self._told = told
        self._kb = kb
        self.track = TrueTrack()
        """Takes the steps of the plant."""
        self._ticks: list[tuple[float, float, bool, float, Vec3]] = []
        self._winds: list[Vec3] = []
        self._wanted: list[Vec3] = []
        self._moves: list[tuple[float, Vec3, Vec3]] = []
        """Time [s], true velocity [m/s], and acceleration by thrust, mass and drag as told [m/s²];
        both NED."""
        self._disturbance = DisturbanceMeter(told.mass_kg)
        self._effort, self._squares = Effort(), array("d")
        self._states: list[str] = []
        self._believed = SteadyError()
        self._warnings: list[str] = []
        self.crash: str | None = None

    def tick(self, tick: Tick, wind: Vec3, velocity: Vec3) -> None:
        """One command, and the true wind [m/s²] and velocity [m/s] at that instant, NED."""
        d, estimate = tick.decision, tick.estimate
        self._believed.add(
            tick.flight_time_s, math.dist(estimate.motion.position, tick.reference.position_ned)
        )
        self._ticks.append(
            (
                tick.flight_time_s,
                d.drive.thrust,
                d.saturated,
                d.diagnostics.v_known,
                d.diagnostics.b_hat,
            )
        )
        self._disturbance.add(tick.time_s, estimate)
        self._squares.append(self._effort.square(tick.flight_time_s, d.drive.rates))
        self._winds.append(wind)
        self._wanted.append(sought(wind, estimate, self._told.mass_kg))
        push, drag = estimate.motion.thrust / self._told.mass_kg, self._told.drag_per_s
        x, y, z = (
            -push * r - drag * v
            for r, v in zip(third_column(estimate.motion.attitude), velocity, strict=True)
        )
        self._moves.append((tick.time_s, velocity, (x, y, self._world.gravity + z)))
        self._states.append(tick.certificate.state)
        self._warnings += [
            f"{tick.flight_time_s:.2f} {warning}" for warning in tick.certificate.warnings
        ]

    def find_crash(self, position: Vec3, *, lands: bool = False) -> bool:
        """Whether the vehicle hit the floor, unless it ``lands``, or left every room.

        Says why in ``crash``.
        """
        sx, sy, sz = self._world.start_ned
        if not lands and position[2] >= self._world.floor_z_m - 1e-9:
            self.crash = "hit the floor"
        elif math.dist(position, (sx, sy, sz)) > CRASH_M:
            self.crash = f"flew {CRASH_M:g} m away from its start"
        return self.crash is not None

    def verdict(self, trajectory: Trajectory, start_s: float) -> FlightVerdict:
        """Judge the flight; the reference started at ``start_s`` on the event loop's clock."""
        times = [t - start_s for t in self.track.times]
        steady_s = begin_of_steady_part(times[-1] if times else 0.0)
        errors = self.track.errors(trajectory, start_s)
        steady = [e for t, e in zip(times, errors, strict=True) if t >= steady_s]
        late = [i for i, tick in enumerate(self._ticks) if tick[0] >= SATURATION_FROM_S]
        everything = self._lyapunov()
        values = [
            v for v, tick in zip(everything, self._ticks, strict=False) if tick[0] >= steady_s
        ]
        efforts = [
            x for x, tick in zip(self._squares, self._ticks, strict=True) if tick[0] >= steady_s
        ]
        end = self._ticks[-1][0] if self._ticks else 0.0
        last = [i for i, tick in enumerate(self._ticks) if tick[0] > end - 1.0]
        thrusts, found = [tick[1] for tick in self._ticks], self._disturbance.reading
        return FlightVerdict(
            **summarize_errors(steady),
            settle_s=stays_below(times, errors, SETTLED_M) if self.crash is None else None,
            wind_true=_mean([self._winds[i] for i in last]),
            estimate_rms_cm=None if self._believed.rms_m is None else 100.0 * self._believed.rms_m,
            wind_estimate=_mean([self._ticks[i][4] for i in last]),
            disturbance_true=find_disturbance([self._moves[i] for i in last]),
            disturbance_found=(0.0, 0.0, 0.0) if found is None else found.ned_m_s2,
            disturbance=found,
            thrust_effectiveness=1.0 if found is None else found.thrust_scale,
            thrust_min_n=min(thrusts, default=None),
            thrust_max_n=max(thrusts, default=None),
            effort_rad_s=math.sqrt(sum(efforts) / len(efforts)) if efforts else None,
            saturated_fraction=sum(self._ticks[i][2] for i in late) / len(late) if late else 0.0,
            lyapunov_increase_max=max(
                (b - a for a, b in zip(values, values[1:], strict=False)), default=None
            ),
            lyapunov_start=everything[0] if everything else None,
            certificate_violated=self._states.count(VIOLATED) / max(len(self._states), 1),
            certificate_suspended=self._states.count(SUSPENDED) / max(len(self._states), 1),
            certificate_warnings=tuple(self._warnings),
            lyapunov_floor=sorted(values)[len(values) // 2] if values else None,
            **self._gust(times, errors),
        )

    def _lyapunov(self) -> list[float]:
        """V at each command, b̃ from the truth."""
        if self._kb is None:
            return []
        weight = 0.5 / self._kb if self._kb > 0.0 else 0.0
        return [
            v + weight * math.dist(b_hat, wind) ** 2
            for (_, _, _, v, b_hat), wind in zip(self._ticks, self._wanted, strict=True)
        ]

    def _gust(self, times: list[float], errors: list[float]) -> dict[str, Any]:
        """Peak and recovery after the wind's step, where there is one."""
        step = self._world.wind_step_time_s
        if self._world.wind_step == (0.0, 0.0, 0.0):
            return {}
        after = [(t - step, e) for t, e in zip(times, errors, strict=True) if t >= step]
        if not after:
            return {}
        return {
            "gust_peak_cm": 100.0 * max(e for _, e in after),
            "gust_back_s": stays_below([t for t, _ in after], [e for _, e in after], BACK_M),
        }


def sought(wind: Any, estimate: Estimate, told_kg: float) -> Any:
    """Compute the true value of b̂ [m/s², NED]: the wind, and the thrust that the law counts beyond
    the configured one.

    Components are numbers or arrays of shape (N,), and so are those of ``estimate``.
    """
    more = (estimate.effectiveness - 1.0) * estimate.motion.thrust / told_kg
    x, y, z = third_column(estimate.motion.attitude)
    return wind[0] + more * x, wind[1] + more * y, wind[2] + more * z


def find_disturbance(moves: Sequence[tuple[float, Vec3, Vec3]]) -> Vec3:
    """Mean acceleration beyond the one told [m/s²], of times [s], velocities [m/s] and told
    accelerations [m/s²].
    """
    if len(moves) < 2:
        return (0.0, 0.0, 0.0)
    (begin_s, begin, _), (end_s, end, _) = moves[0], moves[-1]
    told = [[(b[0] - a[0]) * part for part in a[2]] for a, b in pairwise(moves)]
    x, y, z = (
        (end[i] - begin[i] - sum(part[i] for part in told)) / (end_s - begin_s) for i in range(3)
    )
    return x, y, z


def stays_below(times: list[float], errors: list[float], limit: float) -> float | None:
    """The first time from which on every error is below ``limit``; None if the last one is not."""
    first: float | None = None
    for t, e in zip(reversed(times), reversed(errors), strict=True):
        if e >= limit:
            break
        first = t
    return first


def _mean(vectors: list[Vec3]) -> Vec3:
    n = len(vectors) or 1
    return (
        sum(v[0] for v in vectors) / n,
        sum(v[1] for v in vectors) / n,
        sum(v[2] for v in vectors) / n,
    )
