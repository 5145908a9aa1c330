"""The proof of docs/explanation/law-proof.md against the code: each step of it, on random states
and in flight.

Here e = (p̃, ṽ, d̃, c̃), three axes each, is what the observer does not know; the rows of A e are
p̃˙ = ṽ - l1 p̃, ṽ˙ = d̃ - l2 p̃, d̃˙ = c̃ - l3 p̃ = N e, c̃˙ = -l4 p̃, with l the code's own steady
Kalman gains.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, strategies as st

from groundstation.core.control import Gains, LawState, backstep
from groundstation.core.control.backstepping import (
    BacksteppingAxis,
    LawOutput,
    clamp_length,
    evaluate_axis,
    evaluate_growth,
    project,
)
from groundstation.core.estimation import (
    Covariance,
    Densities,
    initial_covariance,
    predict_covariance,
    update_covariance,
)
from groundstation.core.estimation.estimator import KalmanGain
from groundstation.core.geometry import FLOATS, Vec3, so3
from groundstation.core.trajectory import LemniscateConfig
from tests.property.test_effectiveness import dense, transition
from tests.property.test_law import small, vec, vec3

Array: TypeAlias = npt.NDArray[np.float64]
Reference: TypeAlias = Callable[[float], tuple[Vec3, Vec3]]
"""Acceleration and jerk of the reference at a time."""

MASS = 0.08
GRAVITY = Gains().gravity


def radius(law: Gains) -> float:
    return law.b_bound + law.epsilon


def ball(law: Gains) -> dict[str, float]:
    return {"bound": law.b_bound, "epsilon": law.epsilon, "delta": law.delta}


def lipschitz(law: Gains) -> float:
    """L: how much Proj can stretch a difference of its first argument."""
    return max(1.0, (radius(law) / law.b_bound) ** 2 - 1.0)


def theta(law: Gains) -> float:
    """θ = kb √κ L/(2 √k3), k3 the smaller of both: the proof needs θ < 1."""
    return 0.5 * law.kb * math.sqrt(law.kappa / min(law.k3, law.k3_down)) * lipschitz(law)


def damped(law: Gains, z3: Any) -> float:
    """z3ᵀ k3 z3."""
    x, y, z = z3
    return float(law.k3 * (x * x + y * y) + law.k3_down * z * z)


@st.composite
def laws(draw: st.DrawFn) -> Gains:
    """Gains for which the proof holds: κ follows from a θ < 1."""
    k3, k3_down = draw(st.floats(0.5, 8.0)), draw(st.floats(0.5, 20.0))
    kb = draw(st.floats(0.2, 4.0))
    bound, epsilon = draw(st.floats(1.0, 6.0)), draw(st.floats(0.1, 3.0))
    stretch = max(1.0, (1.0 + epsilon / bound) ** 2 - 1.0)
    return Gains(
        k2=draw(st.floats(0.2, 5.0)),
        k3=k3,
        k3_down=k3_down,
        kb=kb,
        kappa=min(k3, k3_down) * (2.0 * draw(st.floats(0.05, 0.98)) / (kb * stretch)) ** 2,
        sigma_bound=draw(st.floats(0.5, 3.0)),
        sigma_slope=draw(st.floats(0.3, 5.0)),
        b_bound=bound,
        epsilon=epsilon,
    )


class ObserverGain(NamedTuple):
    """What an innovation changes in continuous time, as :class:`KalmanGain` does in one step."""

    p: float
    v: float
    d: float
    c: float


class Observer(NamedTuple):
    """The observer's error dynamics e˙ = A e of one axis, and P with AᵀP + PA = -I."""

    l: ObserverGain  # noqa: E741  # the law document's letter
    a: Array
    p: Array

    @property
    def n(self) -> float:
        """|N|, where N e = d̃˙."""
        return math.hypot(self.l.d, 1.0)


def steady(h: float, noise: float, densities: Densities) -> tuple[KalmanGain, Covariance]:
    """The gain and the covariance of the code's filter after many poses at equal intervals."""
    covariance = initial_covariance(noise * noise)
    gain = (0.0, 0.0, 0.0, 0.0)
    for _ in range(5000):
        expected = predict_covariance(covariance, h, densities)
        gain, covariance = update_covariance(expected, noise * noise)
    return gain, covariance


def observer(h: float, noise: float, densities: Densities) -> Observer:
    """The filter in continuous time: K/h at 1 kHz, with the noise of intervals ``h`` in all."""
    dense = 0.001
    gain, _ = steady(dense, noise * math.sqrt(h / dense), densities)
    l = ObserverGain(*(k / dense for k in gain))  # noqa: E741  # the law document's letter
    a = np.array([[-l.p, 1, 0, 0], [-l.v, 0, 1, 0], [-l.d, 0, 0, 1], [-l.c, 0, 0, 0]])
    i = np.eye(4)
    p = np.linalg.solve(np.kron(a.T, i) + np.kron(i, a.T), -i.ravel()).reshape(4, 4)
    return Observer(l, a, 0.5 * (p + p.T))


DEFAULT = Densities(
    0.0, Gains().acceleration_noise ** 2, Gains().wind_noise ** 2, Gains().wind_rate_noise ** 2
)
OBSERVERS = [
    observer(0.02, 0.0003, DEFAULT),
    observer(0.01, 0.001, DEFAULT),
    observer(0.004, 0.002, Densities(0.0, 1e-3, 0.1, 0.02)),
    observer(0.05, 0.0001, Densities(0.0, 1e-5, 1e-4, 30.0)),
]


class State(NamedTuple):
    """The closed loop: the vehicle against its reference, b̂, and e of shape (4, 3)."""

    z1: Vec3
    z1_dot: Vec3
    attitude: Any
    thrust: float
    b_hat: Vec3
    e: Array


class Loop(NamedTuple):
    """The law, its adaptation and the observer on the plant they are made for, with b constant."""

    law: Gains
    observer: Observer
    b: Vec3
    reference: Reference
    by_observer: bool
    """The law is fed the observer's p̂ and v̂; else the true ones."""

    def fed(self, s: State) -> tuple[Vec3, Vec3]:
        if not self.by_observer:
            return s.z1, s.z1_dot
        return vec3(np.subtract(s.z1, s.e[0])), vec3(np.subtract(s.z1_dot, s.e[1]))

    def step(self, s: State, time: float = 0.0) -> LawOutput:
        acceleration, jerk = self.reference(time)
        z1, z1_dot = self.fed(s)
        state = LawState(z1, z1_dot, z1_dot, s.attitude, s.thrust, s.b_hat, acceleration, jerk)
        return backstep(
            FLOATS, self.law, state, mass=MASS, composite_term=vec3(self.law.kappa * self.w(s))
        )

    def b_tilde(self, s: State) -> Array:
        return np.subtract(self.b, s.b_hat)

    def w(self, s: State) -> Array:
        """w = d̂ - b̂ = b̃ - d̃."""
        return np.asarray(self.b_tilde(s) - s.e[2])

    def b_hat_dot(self, s: State, step: LawOutput) -> Array:
        """kb Proj(ξ + κ w) + ν, ν = d̂˙, without what would leave the ball."""
        rate = np.asarray(step.b_hat_dot) - self.nu_negative(s)
        b_hat = np.asarray(s.b_hat)
        outward = float(b_hat @ rate)
        if float(b_hat @ b_hat) < radius(self.law) ** 2 * (1.0 - 1e-12) or outward <= 0.0:
            return rate
        return np.asarray(rate - outward / float(b_hat @ b_hat) * b_hat)

    def nu_negative(self, s: State) -> Array:
        """-ν = d̃˙ = N e."""
        return np.asarray(s.e[3] - self.observer.l.d * s.e[0])

    def flow(self, s: State, time: float = 0.0) -> State:
        """d/dt of the state; the plant turns with the law's ω and an arbitrary yaw rate."""
        step = self.step(s, time)
        acceleration, _ = self.reference(time)
        lift = -s.thrust / MASS * np.asarray(so3.third_column(s.attitude))
        accel = lift + np.array([0.0, 0.0, GRAVITY]) + np.asarray(self.b) - np.asarray(acceleration)
        spin = (0.0, 0.5 * step.rate_x, 0.5 * step.rate_y, 0.2)
        turn, e_dot = so3.multiply(s.attitude, spin), self.observer.a @ s.e
        b_hat_dot = vec3(self.b_hat_dot(s, step))
        return State(s.z1_dot, vec3(accel), turn, step.thrust_rate, b_hat_dot, e_dot)

    def v(self, s: State, time: float = 0.0) -> float:
        """V_DI + ½|z3|² + |b̃|²/(2 kb), at what the law is fed."""
        b_tilde = self.b_tilde(s)
        return self.step(s, time).v_known + 0.5 / self.law.kb * float(b_tilde @ b_tilde)


def moved(s: State, rate: State, h: float) -> State:
    """s + h s˙."""
    q = so3.normalize(tuple(a + h * b for a, b in zip(s.attitude, rate.attitude, strict=True)))
    z1, z1_dot, b_hat = (
        vec3(np.add(x, h * np.asarray(dx)))
        for x, dx in ((s.z1, rate.z1), (s.z1_dot, rate.z1_dot), (s.b_hat, rate.b_hat))
    )
    return State(z1, z1_dot, q, s.thrust + h * rate.thrust, b_hat, s.e + h * rate.e)


class Parts(NamedTuple):
    """The terms of V˙ (section 5.2), each from its formula."""

    w0: float
    z3: Array
    b_tilde: Array
    adaptation: float
    """b̃ᵀ(ξ - b̂˙/kb) + z3ᵀ(b̂˙ - kb Proj(ξ))."""
    observation: float
    """What p̂˙ ≠ v̂ and v̂˙ ≠ û + b̃ add where the law is fed by the observer."""


def parts(loop: Loop, s: State, time: float = 0.0) -> Parts:
    law, step = loop.law, loop.step(s, time)
    z1, z1_dot = loop.fed(s)
    axes = [evaluate_axis(FLOATS, law.shape, z1[i], z1_dot[i]) for i in range(3)]
    z3 = np.asarray(step.z3)
    xi = np.array([a.dv_dz2 - a.du_dz2 * z for a, z in zip(axes, step.z3, strict=True)])
    b_dot = loop.b_hat_dot(s, step)
    proj = project(FLOATS, vec3(xi), s.b_hat, order=law.projection_order, **ball(law))
    b_tilde = loop.b_tilde(s)
    adaptation = float(b_tilde @ (xi - b_dot / law.kb) + z3 @ (b_dot - law.kb * np.asarray(proj)))
    observation = 0.0
    if loop.by_observer:
        l, e = loop.observer.l, s.e  # noqa: E741  # the law document's letter
        for i, a in enumerate(axes):
            g1, g2 = slopes(law, a, z1_dot[i], float(z3[i]))
            observation += g1 * l.p * e[0, i] + g2 * (l.v * e[0, i] - e[2, i])
    return Parts(step.w - damped(law, z3), z3, b_tilde, adaptation, observation)


def slopes(law: Gains, a: BacksteppingAxis, z1_dot: float, z3: float) -> tuple[float, float]:
    """g: the partial derivatives of V_DI + ½ z3² by position and by velocity."""
    excess, _, _ = evaluate_growth(FLOATS, z1_dot, law.sigma_bound, law.velocity_scale)
    by_x1 = a.sigma + a.sigma_prime * (a.z2 + excess) - z3 * (a.du_dz1 + a.sigma_prime * a.du_dz2)
    return by_x1, a.dv_dz2 - z3 * a.du_dz2


def v_dot(p: Parts, law: Gains) -> float:
    return -p.w0 - damped(law, p.z3) + p.adaptation + p.observation


def margins(loop: Loop) -> tuple[float, float, float]:
    """Of section 5.3: the factors a and c before |b̃||e| and |z3||e|, and the weight μ of eᵀPe."""
    law, n = loop.law, loop.observer.n
    a = law.kappa + n / law.kb
    c = law.kb * law.kappa * lipschitz(law) + n
    share = 2.0 * (1.0 - theta(law))
    mu = 1.0 + (a * a / law.kappa + c * c / min(law.k3, law.k3_down)) / share
    return a, c, mu


@st.composite
def loops(draw: st.DrawFn) -> tuple[Loop, State]:
    """A closed loop in a random state: b within B, b̂ within B + ε, its surface included."""
    law = draw(laws())
    b = clamp_length(FLOATS, vec3(2.0 * np.asarray(draw(vec))), law.b_bound)
    b_hat = clamp_length(FLOATS, vec3(4.0 * np.asarray(draw(vec))), radius(law))
    acceleration, jerk = draw(vec), draw(vec)
    attitude = so3.from_euler_zyx(
        draw(st.floats(-1.2, 1.2)), draw(st.floats(-1.2, 1.2)), draw(small)
    )

    def reference(time: float) -> tuple[Vec3, Vec3]:
        return vec3(np.add(acceleration, time * np.asarray(jerk))), jerk

    loop = Loop(law, draw(st.sampled_from(OBSERVERS)), b, reference, draw(st.booleans()))
    thrust = draw(st.floats(0.3, 3.0)) * MASS * GRAVITY
    s = State(draw(vec), draw(vec), attitude, thrust, b_hat, np.zeros((4, 3)))
    e = np.array([draw(vec) for _ in range(4)]) * np.array([[0.03], [0.3], [1.0], [3.0]])
    if draw(st.booleans()):
        # Where ν works against both b̃ and z3 with all its weight.
        worst = loop.b_tilde(s) / law.kb - np.asarray(loop.step(s).z3)
        e = np.outer([-loop.observer.l.d, 0.0, 0.0, 1.0], worst) / (
            loop.observer.n * (1.0 + np.linalg.norm(worst))
        )
    return loop, s._replace(e=draw(st.sampled_from([0.0, 1e-4, 1e-2, 1.0])) * e)


@pytest.mark.parametrize("one", OBSERVERS)
def test_the_observers_error_dynamics_are_hurwitz_and_have_a_lyapunov_function(
    one: Observer,
) -> None:
    assert max(np.linalg.eigvals(one.a).real) < 0.0
    assert min(np.linalg.eigvalsh(one.p)) > 0.0
    assert np.allclose(one.a.T @ one.p + one.p @ one.a, -np.eye(4), atol=1e-6)


@given(loops())
def test_the_derivative_of_v_has_the_stated_terms(case: tuple[Loop, State]) -> None:
    """V˙ along plant, law, adaptation and observer, by differences, against its formula."""
    loop, s = case
    rate = loop.flow(s)
    speed = 1.0 + sum(float(np.max(np.abs(np.asarray(x, dtype=float)))) for x in rate)
    h = 1e-4 / speed
    slope = (loop.v(moved(s, rate, h), h) - loop.v(moved(s, rate, -h), -h)) / (2.0 * h)
    p = parts(loop, s)
    size = abs(p.adaptation) + abs(p.observation) + p.w0 + damped(loop.law, p.z3)
    rounding = 1e-4 * (1.0 + size) + 1e-9 * speed * loop.v(s)
    assert slope == pytest.approx(v_dot(p, loop.law), abs=rounding)


@given(loops())
def test_v_and_the_observers_error_together_fall_by_a_share_of_w(case: tuple[Loop, State]) -> None:
    loop, s = case
    law, share = loop.law, 1.0 - theta(loop.law)
    p = parts(loop, s)
    e = float(np.linalg.norm(s.e))
    z3, b_tilde = float(np.linalg.norm(p.z3)), float(np.linalg.norm(p.b_tilde))
    a, c, mu = margins(loop)
    damping = damped(law, p.z3) + law.kappa * b_tilde * b_tilde
    rounding = 1e-9 * (1.0 + damping + abs(p.adaptation) + (a * b_tilde + c * z3) * e)
    # Before Young's inequality, and after it with μ eᵀPe added, whose derivative is -μ|e|².
    cross = (a * b_tilde + c * z3) * e
    assert p.adaptation - damped(law, p.z3) <= -share * damping + cross + rounding
    composite = v_dot(p, law) - p.observation - mu * e * e
    assert composite <= -p.w0 - 0.5 * share * damping - e * e + rounding + 1e-9 * mu * e * e


@given(laws(), vec, vec, vec)
def test_projection_stretches_no_difference_beyond_its_lipschitz_constant(
    law: Gains, one: Vec3, other: Vec3, direction: Vec3
) -> None:
    b_hat = clamp_length(FLOATS, vec3(4.0 * np.asarray(direction)), radius(law))
    first, second = (
        project(FLOATS, x, b_hat, order=law.projection_order, **ball(law)) for x in (one, other)
    )
    assert math.dist(first, second) <= lipschitz(law) * math.dist(one, other) * (1.0 + 1e-9) + 1e-9


def size_in(covariance: Covariance, e: Array) -> float:
    """eᵀ Σ⁻¹ e, solved in units of the standard deviations."""
    sigma = dense(covariance)
    scale = np.sqrt(np.diag(sigma))
    return float((e / scale) @ np.linalg.solve(sigma / np.outer(scale, scale), e / scale))


POSE = st.tuples(st.floats(0.004, 0.25), st.floats(1e-4, 1e-2), st.booleans())
"""Interval to the one before [s], noise [m], and whether it has a velocity."""


@given(st.lists(POSE, min_size=1, max_size=20), st.tuples(small, small, small, small))
def test_the_inverse_covariance_is_a_lyapunov_function_for_any_intervals_and_any_noise(
    poses: list[tuple[float, float, bool]], error: tuple[float, ...]
) -> None:
    """Neither gaps nor a gain that follows the noise nor measured velocity break the argument."""
    e = np.array(error) * np.array([0.01, 0.3, 1.0, 0.1])
    covariance = initial_covariance(0.0003**2)
    for h, noise, moving in poses:
        before = size_in(covariance, e)
        densities = DEFAULT._replace(position=0.04 if moving else 0.0)
        covariance = predict_covariance(covariance, h, densities)
        e = transition(h)[:4, :4] @ e
        gain, covariance = update_covariance(covariance, noise * noise)
        e = e - np.array(gain) * e[0]
        if moving:
            gain, covariance = update_covariance(covariance, 0.01, 1)
            e = e - np.array(gain) * e[1]
        assert size_in(covariance, e) <= before * (1.0 + 1e-6) + 1e-12


FIGURE_EIGHT = LemniscateConfig().build()


def on_the_figure_eight(time: float) -> tuple[Vec3, Vec3]:
    here = FIGURE_EIGHT.at(time)
    return here.acceleration_ned, here.jerk_ned


def flown(loop: Loop, s: State, duration: float, h: float = 0.005) -> list[tuple[float, State]]:
    """The closed loop by Runge and Kutta's method, b̂ kept in its ball as the code does."""
    states = [(0.0, s)]
    for i in range(round(duration / h)):
        t = i * h
        k1 = loop.flow(s, t)
        k2 = loop.flow(moved(s, k1, 0.5 * h), t + 0.5 * h)
        k3 = loop.flow(moved(s, k2, 0.5 * h), t + 0.5 * h)
        k4 = loop.flow(moved(s, k3, h), t + h)
        for k, share in ((k1, 1.0), (k2, 2.0), (k3, 2.0), (k4, 1.0)):
            s = moved(s, k, h * share / 6.0)
        s = s._replace(b_hat=clamp_length(FLOATS, s.b_hat, radius(loop.law)))
        states.append((t + h, s))
    return states


@pytest.mark.tried(2)  # disturbances, known and not
@pytest.mark.parametrize("by_observer", [False, True])
@pytest.mark.parametrize("b", [(0.1, -0.05, 0.2), (3.0, -3.0, 2.6)])
def test_a_flight_on_the_ideal_plant_keeps_the_inequality(b: Vec3, by_observer: bool) -> None:
    law = Gains()
    loop = Loop(law, OBSERVERS[0], b, on_the_figure_eight, by_observer)
    unknown = np.array([(0.0, 0.0, 0.0), (0.1, 0.0, -0.1), b, (0.0, 0.0, 0.0)])
    z1, z1_dot, zero = (0.1, -1.5, 1.0), (-0.3, 0.3, 0.0), (0.0, 0.0, 0.0)
    start = State(z1, z1_dot, so3.IDENTITY, 0.6 * MASS * GRAVITY, zero, unknown)
    states = flown(loop, start, 8.0)
    share, (_, _, mu) = 1.0 - theta(law), margins(loop)
    values = []
    for t, s in states:
        assert math.hypot(*s.b_hat) <= radius(law) * (1.0 + 1e-12)
        p = parts(loop, s, t)
        e2 = float(np.sum(s.e * s.e))
        damping = damped(law, p.z3) + law.kappa * float(p.b_tilde @ p.b_tilde)
        falls = v_dot(p, law) - mu * e2
        assert falls <= -p.w0 - 0.5 * share * damping - e2 + p.observation + 1e-9 * (1.0 + mu * e2)
        values.append(loop.v(s, t) + mu * float(np.sum(s.e * (loop.observer.p @ s.e))))
    if not by_observer:
        pairs = zip(values, values[1:], strict=False)
        assert all(b <= a * (1.0 + 1e-9) + 1e-14 * values[0] for a, b in pairs)
    _, end = states[-1]
    assert math.hypot(*end.z1) < 1e-4
    assert float(np.linalg.norm(loop.b_tilde(end))) < 1e-3
    assert values[-1] < 1e-6 * values[0]
