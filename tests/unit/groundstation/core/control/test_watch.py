"""The certificate in flight: what is told, when, and how often."""

import math

import pytest

from groundstation.core.control import LASTING_S, CertificateMonitor, Gains, noise_power
from groundstation.core.control.certificate import (
    COVERED_RATE_M_S3,
    LIMITS,
    POSES,
    RATES,
    REST_S,
    SIDEWAYS,
    THRUST,
    VERTICAL,
    WITNESSES,
    decrease,
    terms,
)
from groundstation.core.control.controllers import Pid
from groundstation.core.geometry import Vec3
from groundstation.core.messages import Decision, Diagnostics
from groundstation.core.vehicle import ActuatorCommand, Motion, Vehicle

ZERO: Vec3 = (0.0, 0.0, 0.0)
VEHICLE = Vehicle()
HOVER = Motion(ZERO, ZERO, (1.0, 0.0, 0.0, 0.0), 0.785, ZERO)
PERIOD_S = 0.02


def said(
    v: float = 0.0, w: float = 0.0, b_hat: Vec3 = ZERO, disturbance: Vec3 | None = None, **more: Vec3
) -> Diagnostics:
    """What the law says of itself, all zero but for the arguments."""
    return Diagnostics(
        z1=ZERO,
        z2=ZERO,
        z3=more.pop("z3", ZERO),
        u_star=ZERO,
        b_hat=b_hat,
        b_hat_dot=ZERO,
        disturbance=b_hat if disturbance is None else disturbance,
        v_terms=(v, 0.0, 0.0),
        w_terms=(w, 0.0, 0.0),
        v_known=v,
        w=w,
        certificate="composite",
        rates_wanted=more.pop("rates_wanted", ZERO),
    )


def decided(diagnostics: Diagnostics, *, saturated: bool = False, thrust: float = 0.785) -> Decision:
    return Decision(ActuatorCommand(thrust, ZERO), saturated, diagnostics)


def flown(watch: CertificateMonitor, decision: Decision, seconds: float, start_s: float = 0.0) -> list[str]:
    """The warnings of ``seconds`` of the same decision."""
    looks = (watch.look(start_s + k * PERIOD_S, HOVER, decision) for k in range(round(seconds / PERIOD_S) + 1))
    return [warning.text for seen in looks for warning in seen.warnings]


def test_a_v_that_only_stands_still_although_it_must_fall_is_told_once() -> None:
    watch = CertificateMonitor(VEHICLE, Gains())
    swinging = decided(said(v=4.0, w=60.0))
    (warning,) = flown(watch, swinging, 4.0)
    assert warning.startswith("Lyapunov: V has been above its bound for 0.5 s; largest term: poses contradict")
    assert warning.endswith("60 m²/s³")
    assert watch.look(4.1, HOVER, swinging).state == "violated"


def test_a_v_within_its_bound_is_not_told() -> None:
    watch = CertificateMonitor(VEHICLE, Gains())
    calm = decided(said(v=0.03, w=0.99 * decrease(Gains()).power / decrease(Gains()).share))
    assert flown(watch, calm, 10.0) == []
    assert watch.look(10.1, HOVER, calm).state == "holds"


def test_more_noise_allows_more() -> None:
    rough = decided(said(v=0.1, w=60.0))
    quiet, noisy = CertificateMonitor(VEHICLE, Gains()), CertificateMonitor(VEHICLE, Gains())
    noisy.noise(0.01, 0.02)
    assert len(flown(quiet, rough, 2.0)) == 1
    assert flown(noisy, rough, 2.0) == []


def test_a_short_excess_is_not_told_and_one_that_comes_back_at_once_is_told_once() -> None:
    watch = CertificateMonitor(VEHICLE, Gains())
    calm, rough = decided(said()), decided(said(v=0.1, w=100.0))
    time, told = 0.0, []
    for seconds in (0.8 * LASTING_S, 2.0 * LASTING_S, 2.0 * LASTING_S):
        told.append(len(flown(watch, rough, seconds, time)))
        flown(watch, calm, 0.5 * REST_S, time + seconds + PERIOD_S)
        time += seconds + 0.5 * REST_S + 2.0 * PERIOD_S
    flown(watch, calm, 2.0 * REST_S, time)
    told.append(len(flown(watch, rough, 1.0, time + 2.0 * REST_S + PERIOD_S)))
    assert told == [0, 1, 0, 1]


def test_time_at_a_limit_is_suspended_and_does_not_count() -> None:
    watch = CertificateMonitor(VEHICLE, Gains())
    clamped = decided(said(v=4.0, w=60.0), saturated=True)
    (warning,) = flown(watch, clamped, 3.0)
    assert warning.startswith("Lyapunov: the bound is suspended most of the time")
    assert watch.look(3.1, HOVER, clamped).state == "suspended"
    reading = watch.reading()
    assert reading is not None
    assert reading.suspended_fraction == pytest.approx(1.0)
    assert reading.excess == 0.0


def test_a_disturbance_beyond_b_is_told_with_its_size() -> None:
    watch = CertificateMonitor(VEHICLE, Gains(b_bound=5.0))
    (warning,) = flown(watch, decided(said(b_hat=(3.0, 0.0, 4.2))), 2.0)
    assert warning.startswith(
        "Lyapunov: the disturbance estimate has been above controller.b_bound for 0.5 s: 5.2 m/s², limit 5 m/s²"
    )
    reading = watch.reading()
    assert reading is not None
    assert reading.b_hat_fraction == pytest.approx(math.hypot(3.0, 4.2) / 5.5)


@pytest.mark.parametrize(("thrust", "which"), [(VEHICLE.thrust_max_n, "upper"), (VEHICLE.thrust_min_n, "lower")])
def test_a_thrust_that_stays_at_its_limit_is_told_under_every_controller(thrust: float, which: str) -> None:
    for config in (Gains(), Pid()):
        (warning,) = flown(CertificateMonitor(VEHICLE, config), decided(said(), saturated=True, thrust=thrust), 2.0)
        assert f"at its {which} limit" in warning


@pytest.mark.parametrize(
    ("gains", "why"),
    [
        (Gains(kb=2.0), "the proof needs kb² κ < 4 k3"),
        (Gains(composite="raw"), "the raw form"),
        (Gains(kb=0.0), "adaptation is off"),
    ],
)
def test_gains_without_a_proof_are_told_at_the_first_command_and_promise_nothing(gains: Gains, why: str) -> None:
    watch = CertificateMonitor(VEHICLE, gains)
    first = watch.look(0.0, HOVER, decided(said(v=0.1, w=100.0)))
    assert why in first.warnings[0].text
    assert flown(watch, decided(said(v=0.1, w=100.0)), 3.0, PERIOD_S) == []
    assert watch.look(3.1, HOVER, decided(said())).state == "none"


def test_without_a_proof_a_lasting_rise_of_v_is_told_still() -> None:
    watch = CertificateMonitor(VEHICLE, Gains(kb=2.0))
    looks = (watch.look(0.02 * k, HOVER, decided(said(v=0.2 * k))) for k in range(50))
    assert [said.id for look in looks for said in look.warnings] == ["certificate.no_proof", "certificate.above"]


def test_the_papers_own_adaptation_may_borrow_what_the_wind_owes() -> None:
    gains = Gains(composite="off", kb=1.0, b_bound=5.0)
    assert decrease(gains).spare == pytest.approx(0.5 * 10.5**2)
    assert flown(CertificateMonitor(VEHICLE, gains), decided(said(v=1.0, w=60.0)), 1.5) == []
    assert len(flown(CertificateMonitor(VEHICLE, gains), decided(said(v=1.0, w=60.0)), 5.0)) == 1


def test_a_new_reference_begins_a_new_bound() -> None:
    watch = CertificateMonitor(VEHICLE, Gains())
    flown(watch, decided(said(v=1.0, w=60.0)), 0.4)
    watch.restart()
    seen = watch.look(0.42, HOVER, decided(said(v=50.0, w=60.0)))
    assert (seen.state, seen.excess) == ("none", 0.0)


def test_another_controller_has_no_bound() -> None:
    watch = CertificateMonitor(VEHICLE, Pid())
    assert flown(watch, decided(said(b_hat=(9.0, 0.0, 0.0))), 2.0) == []
    assert watch.look(3.0, HOVER, decided(said())).state == "none"


def test_d_is_noise_and_what_moves() -> None:
    gains = Gains()
    left = 1.0 - 0.5 * 0.4 * math.sqrt(28.0 / 5.0)
    assert decrease(gains).share == pytest.approx(0.5 * left)
    assert decrease(gains).power == pytest.approx(COVERED_RATE_M_S3**2 / (2.0 * left * 5.0))
    assert noise_power(gains, 0.0003, 0.02) == pytest.approx(0.44, abs=0.01)
    assert noise_power(gains, 0.001, 0.02) > 2.0 * noise_power(gains, 0.0003, 0.02)


def fed(
    before: Diagnostics, after: Diagnostics, motion: Motion = HOVER, *, saturated: bool = False
) -> dict[str, float]:
    found = terms(HOVER, before, saturated, motion, after, 0.1, total=1.0, mass=0.08, pull=7.0)
    assert sum(found.values()) == pytest.approx(1.0)
    return {name: round(energy, 9) for name, energy in found.items() if abs(energy) > 1e-9 and name != POSES}


def test_each_source_feeds_its_own_term() -> None:
    east = said(z3=(0.0, 2.0, 0.0))
    # z3 wants a roll to the left of 0.5 rad/s that does not come: û keeps T/m · 0.5 m/s³ too much to the east.
    rolling = said(z3=(0.0, 2.0, 0.0), rates_wanted=(-0.5, 0.0, 0.0))
    assert fed(rolling, east) == {RATES: pytest.approx(0.785 / 0.08 * 0.5 * 2.0 * 0.1, rel=1e-6)}
    assert list(fed(rolling, east, saturated=True)) == [LIMITS]
    assert fed(east, said(z3=(0.0, 2.0, 0.0), disturbance=(0.0, 0.3, 0.0), b_hat=(0.0, 0.3, 0.0))) == {SIDEWAYS: 0.6}
    down = said(z3=(0.0, 0.0, 1.0))
    assert fed(down, said(z3=(0.0, 0.0, 1.0), b_hat=(0.0, 0.0, 0.2))) == {VERTICAL: 0.2}
    assert fed(down, down, HOVER._replace(thrust=0.785 - 0.008)) == {THRUST: 0.1}
    doubtful = said(z3=(0.0, 0.0, 1.0), disturbance=(0.0, 0.0, 0.5))
    assert fed(doubtful, doubtful) == {WITNESSES: 0.35}
