"""The watch in whole flights: silent where the theory holds, and right about what breaks it."""

import pytest

from groundstation.core.control import Gains
from groundstation.core.control.certificate import LIMITS, POSES, VERTICAL, noise_power, terms
from groundstation.core.messages import Diagnostics, Tick
from sim.runs import fly
from sim.scenarios import SCENARIOS, prepare
from tests.flight.flights import flown, flown_ideal, ticks_to

GAINS = Gains()
LAG_2X = 2.0 * SCENARIOS["paper"].world.thrust_lag_s


@pytest.mark.tried(1)  # scenarios
@pytest.mark.parametrize("scenario", ["ideal", "paper", "fast", "gust_front", "quad1kg"])
def test_flights_that_go_well_are_never_warned_of(scenario: str) -> None:
    verdict = (flown_ideal("provable")[0] if scenario == "ideal" else flown(scenario)).verdict
    assert verdict.certificate_warnings == ()
    assert verdict.certificate_violated == 0.0


@pytest.mark.tried(1)  # disturbances
@pytest.mark.parametrize("seed", range(5))
def test_neither_are_lost_poses_gusts_and_wrong_lags(seed: int) -> None:
    assert flown("adverse", seed=seed, duration_s=20.0).verdict.certificate_warnings == ()


NOISY = ("sim.pose_noise_m=0.003", "sim.attitude_noise_rad=0.02")


@pytest.mark.parametrize(
    ("overrides", "source"),
    [(NOISY, "vicon"), (("sim.pose_rate_hz=25",), "vicon"), ((), "odometry")],
)
def test_nor_are_noisy_or_rare_poses_or_an_autopilots(
    overrides: tuple[str, ...], source: str
) -> None:
    verdict = flown("paper", *overrides, source=source, duration_s=20.0).verdict
    assert verdict.certificate_warnings == ()


@pytest.mark.parametrize(("overrides", "words"), [
    ([f"sim.thrust_lag_s={LAG_2X}"], VERTICAL),
    (["sim.thrust_gain=0.6"], "thrust margin: the command has been at its upper limit, 1.37 N"),
    (["controller.sigma_slope=9", "controller.delay_prediction=false"], LIMITS),  # a limit cycle
    (["controller.kb=2"], "the proof needs kb² κ < 4 k3"),
    (["sim.pose_latency_s=0.045"], "the bound is suspended most of the time, with commands at"),
])  # fmt: skip
def test_what_breaks_the_theory_is_told_within_seconds_by_its_name(
    overrides: list[str], words: str
) -> None:
    warnings = flown("paper", *overrides, duration_s=8.0).verdict.certificate_warnings
    assert words in warnings[0]
    assert float(warnings[0].split()[0]) < 5.0


def decrease(d: Diagnostics) -> float:
    """W + κ|w|²."""
    pairs = zip(d.disturbance, d.b_hat, strict=True)
    return d.w + GAINS.kappa * sum((a - b) ** 2 for a, b in pairs)


def v_m(d: Diagnostics) -> float:
    pairs = zip(d.disturbance, d.b_hat, strict=True)
    return d.v_known + 0.5 / GAINS.kb * sum((a - b) ** 2 for a, b in pairs)


def ticks(scenario: str, *overrides: str, duration_s: float) -> list[Tick]:
    kept: list[Tick] = []
    world, config = prepare(SCENARIOS[scenario], list(overrides))
    fly(world, config, seed=0, duration_s=duration_s, watch=ticks_to(kept.append))
    return kept


def test_where_the_model_is_right_the_terms_are_all_there_is() -> None:
    # (F) of law.md, from 1.8 m away until it has arrived; the first moments have speeds at which V
    # is not quadratic.
    kept = ticks("ideal", "sim.wind_mean=[0,0,0]", duration_s=4.0)
    flight = [t for t in kept if t.flight_time_s > 0.3]
    fed: dict[str, float] = {}
    fallen = 0.0
    for a, b in zip(flight, flight[1:], strict=False):
        told, now, dt = a.decision.diagnostics, b.decision.diagnostics, b.time_s - a.time_s
        fall = 0.5 * (decrease(told) + decrease(now)) * dt
        fallen += fall
        a_motion, b_motion = a.estimate.motion, b.estimate.motion
        rise = {"total": v_m(now) - v_m(told) + fall, "mass": 0.08, "pull": GAINS.kb * GAINS.kappa}
        for name, energy in terms(a_motion, told, False, b_motion, now, dt, **rise).items():
            fed[name] = fed.get(name, 0.0) + energy
    assert fallen > 3.0
    assert abs(fed[POSES]) < 0.005 * fallen


@pytest.mark.tried(1)  # levels of noise
@pytest.mark.parametrize(
    ("noise_m", "overrides"),
    [(0.0003, ()), (0.001, ("sim.pose_noise_m=0.001", "sim.attitude_noise_rad=0.006"))],
)
def test_noise_alone_feeds_v_with_about_what_the_theory_says(
    noise_m: float, overrides: tuple[str, ...]
) -> None:
    steady = [t for t in ticks("paper", *overrides, duration_s=20.0) if t.flight_time_s > 10.0]
    mean = sum(decrease(t.decision.diagnostics) for t in steady) / len(steady)
    assert 0.5 < mean / noise_power(GAINS, noise_m, 0.02) < 2.0
