"""The certificate: thrust bound, bound on V_m, its terms, and what is told of it in flight."""

import math
from typing import Any

import numpy as np
import pytest

from groundstation.core.control import (
    CertificateMonitor,
    Gains,
    Law,
    bound_decrease,
    certificate,
    thrust_bound,
)
from groundstation.core.control.certificate import EnergySources, Lasting, decrease
from groundstation.core.control.controllers import Pid
from groundstation.core.geometry import IDENTITY, ZERO, Vec3, so3
from groundstation.core.messages import Decision, Diagnostics
from groundstation.core.vehicle import ActuatorCommand, Motion, Vehicle

LAW = Law(sigma_slope=3.0, rho_slope=1.0, sigma_bound=1.5, rho_bound=1.0, b_bound=5.0)
SUP = certificate.virtual_control_sup(LAW)


def test_the_virtual_control_of_the_papers_gains_reaches_7_03_m_s2_per_axis() -> None:
    assert pytest.approx(7.03, abs=0.005) == SUP
    assert certificate.virtual_control_sup(Law()) == pytest.approx(38.96, abs=0.005)


def test_the_bound_is_its_terms_and_negative_for_the_papers_gains() -> None:
    bound = thrust_bound(LAW, acceleration_sup=0.75, v_start=2.0)
    assert bound == pytest.approx(9.81 - 5.5 - 0.75 - math.sqrt(3.0) * SUP - 2.0)
    assert bound < 0.0


@pytest.mark.parametrize(
    ("gains", "expected"),
    [
        (Gains(), "composite"),
        (Gains(composite="off"), "paper"),
        (Gains(composite="raw"), "none: the raw form"),
        (Gains(kb=2.0), "none: the proof needs"),
        (Gains(kappa=130.0), "none: the proof needs"),
        (Gains(kb=0.0), "none: adaptation is off"),
    ],
)
def test_the_certificate_names_the_bound_that_holds_for_the_gains_that_fly(
    gains: Gains, expected: str
) -> None:
    assert str(bound_decrease(gains)).startswith(expected)


VECTORS = (
    "z1", "z2", "z3", "u_star", "b_hat", "b_hat_dot", "disturbance", "rates_wanted", "v_terms",
    "w_terms",
)  # fmt: skip


def values(**some: Any) -> Diagnostics:
    """Values of the law, zero but for ``some``."""
    vectors = dict.fromkeys(VECTORS, ZERO)
    scalars = {"v_known": 0.0, "w": 0.0, "certificate": "", "thrust_rate": 0.0}
    return Diagnostics(**{**vectors, **scalars, **some})


def decided(
    diagnostics: Diagnostics, *, saturated: bool = False, thrust: float = 0.785
) -> Decision:
    return Decision(ActuatorCommand(thrust, ZERO), saturated, diagnostics)


BASE: dict[str, Any] = {"kb": 0.8, "k3": 4.0, "k3_down": 3.0, "b_bound": 5.0, "epsilon": 0.5}
PROVABLE = Gains(**BASE, kappa=2.0)
STRETCHED = Gains(kb=0.8, kappa=0.5, k3=3.0, k3_down=4.0, b_bound=1.0, epsilon=1.0)


@pytest.mark.parametrize(
    ("gains", "share", "power", "spare"),
    [
        # 1 - kb/2 √(κ/k3) = 1 - 0.4 √(2/3) of W; 8²/(2 left k3)
        (PROVABLE, 0.33670, 15.8401, 0.0),
        # B + ε = 2 B: the projection stretches by 3
        (STRETCHED, 0.25505, 20.9109, 0.0),
        # the paper's: all of W, but V may swing by (2 B + ε)²/(2 kb)
        (Gains(**BASE, composite="off"), 0.5, 10.6667, 68.9063),
        (Gains(kb=0.8, k3=4.0, k3_down=3.0, composite="raw"), 0.0, 10.6667, 0.0),
    ],
)
def test_the_bound_on_the_decrease_in_flight(
    gains: Gains, share: float, power: float, spare: float
) -> None:
    found = certificate.decrease(gains)
    assert found[1:] == pytest.approx((share, power, spare), rel=1e-4)


def test_gains_of_the_law_alone_prove_nothing() -> None:
    assert certificate.decrease(LAW)[:2] == ("none: the gains of the law alone", 0.0)


@pytest.mark.parametrize(
    ("config", "v", "fall", "pull"),
    [
        (PROVABLE, 3.0 + 0.625 * 50.0, 7.0 + 2.0 * 50.0, 1.6),
        (Gains(kb=0.8, composite="off", b_bound=5.0), 3.0, 7.0, 0.0),
        (Gains(kb=0.0, b_bound=5.0), 3.0, 7.0, 0.0),
        (Pid(), 3.0, 7.0, 0.0),
    ],
)
def test_v_and_its_decrease_are_with_what_observer_and_law_disagree_in(
    config: Any, v: float, fall: float, pull: float
) -> None:
    found = certificate.measure(config)
    law = values(v_known=3.0, w=7.0, b_hat=(1.0, -2.0, 3.0), disturbance=(4.0, 2.0, -2.0))
    assert found.of(law) == pytest.approx((v, fall))
    assert found.pull == pytest.approx(pull)


def test_what_noise_adds_follows_its_intensity() -> None:
    """A Butterworth filter's steady gains, w = (q²/i)^(1/8): three axes, half the curvature."""
    law = Gains(sigma_slope=2.0, k2=1.5, rho_slope=0.5, wind_rate_noise=3.0)
    intensity = 0.002**2 * 0.01
    w = (3.0**2 / intensity) ** 0.125
    l1, l2, l3 = 2.613 * w, 3.414 * w**2, 2.613 * w**3
    z2 = l2 + 2.0 * l1
    expected = 1.5 * intensity * (2.0 * l1**2 + z2**2 + (l3 + 0.75 * z2 + 2.0 * (l1 + l2)) ** 2)
    assert certificate.noise_power(law, 0.002, 0.01) == pytest.approx(expected)
    without = Gains(sigma_slope=2.0, k2=1.5, rho_slope=0.5, wind_rate_noise=3.0, composite="off")
    expected = 1.5 * intensity * (2.0 * l1**2 + z2**2 + (0.75 * z2 + 2.0 * (l1 + l2)) ** 2)
    assert certificate.noise_power(without, 0.002, 0.01) == pytest.approx(expected)


@pytest.mark.parametrize("saturated", [False, True])
def test_what_v_gains_in_a_frame_is_shared_among_its_sources(saturated: bool) -> None:
    """Each is a gradient at mid-frame times a change within the frame.

    What is left is the poses'.
    """
    mass, pull, dt, total = 0.5, 1.6, 0.02, 0.3
    attitude = so3.from_euler_zyx(0.2, -0.3, 0.5)
    before = Motion(ZERO, ZERO, attitude, 5.0, (0.3, -0.2, 0.1))
    after = Motion(ZERO, ZERO, attitude, 5.3, (0.5, 0.4, 0.1))
    then = values(
        z3=(1.0, -2.0, 0.5), rates_wanted=(0.1, 0.7, 0.0), thrust_rate=4.0, b_hat=(0.1, 0.2, 0.3),
        disturbance=(1.0, 2.0, 3.0),
    )  # fmt: skip
    now = values(z3=(2.0, 1.0, -1.5), disturbance=(1.5, 1.0, 3.2))
    z3 = np.array([1.5, -0.5, -0.5])
    body = np.array(so3.matrix(attitude)).T @ z3
    too_fast = np.array([0.4 - 0.1, 0.1 - 0.7, 0.0])  # mean of the rates less the wanted ones
    turning = -5.0 / mass * dt * float(body @ np.cross(too_fast, [0.0, 0.0, 1.0]))
    pushing = (4.0 * dt - 0.3) / mass * float(body[2])
    expected = {
        certificate.SIDEWAYS: 1.5 * 0.5 - 0.5 * -1.0,
        certificate.VERTICAL: -0.5 * 0.2,
        certificate.WITNESSES: 0.0 if saturated else pull * dt * float(z3 @ [0.9, 1.8, 2.7]),
        **(
            {certificate.LIMITS: turning + pushing}
            if saturated
            else {certificate.RATES: turning, certificate.THRUST: pushing}
        ),
    }
    expected[certificate.POSES] = total - sum(expected.values())
    found = certificate.terms(
        before, then, saturated, after, now, dt, total=total, mass=mass, pull=pull
    )
    assert found == pytest.approx(expected)


def look(time_s: float, disturbance: Vec3) -> certificate.Look:
    motion = Motion(ZERO, ZERO, so3.IDENTITY, 5.0, ZERO)
    law = values(z3=(1.0, 0.0, 1.0), disturbance=disturbance)
    return certificate.Look(time_s, 0.0, 0.0, motion, decided(law))


@pytest.mark.parametrize(
    ("sideways", "ends"), [(0.3, f"; then {certificate.SIDEWAYS}, 3"), (0.1, "m²/s³")]
)
def test_the_largest_source_is_named_and_the_next_where_it_is_half_as_large(
    sideways: float, ends: str
) -> None:
    sources = EnergySources(1.0)
    frame = certificate.Frame(look(0.0, ZERO), look(0.1, (sideways, 0.0, 0.4)), sideways + 0.4)
    sources.add(frame, 0.0)
    said = sources.name_largest(sources.for_s)
    assert said.startswith(f"{certificate.VERTICAL}, 4 m²/s³")
    assert said.endswith(ends)


def lasting(watch: Lasting, from_s: float, for_s: float) -> list[float]:
    """When a condition that holds ``for_s`` from ``from_s`` on is reported [s]; it ends then."""
    times = [from_s + 0.01 * n for n in range(round(for_s / 0.01))]
    told = [round(now, 3) for now in times if watch.extend(now, 0.01)]
    watch.end(from_s + for_s)
    return told


def test_a_condition_is_reported_once_it_has_lasted_and_again_only_after_a_rest() -> None:
    watch = Lasting()
    assert lasting(watch, 0.0, 0.45) == []
    assert lasting(watch, 1.0, 2.0) == [1.49]
    assert lasting(watch, 7.9, 2.0) == [], "4.9 s after its end it is the same"
    assert lasting(watch, 14.95, 1.0) == [15.44], "5.05 s after its end it is another"
    assert lasting(Lasting(1.0), 0.0, 2.0) == [0.99]


VEHICLE = Vehicle()


# ---- in flight

HOVER = Motion(ZERO, ZERO, IDENTITY, 0.785, ZERO)
PERIOD_S = 0.02
SWINGS = values(v_known=4.0, w=60.0)
"""V stands still, although it must fall."""


def flown(
    watch: CertificateMonitor, decision: Decision, seconds: float, start_s: float = 0.0
) -> list[str]:
    """The warnings of ``seconds`` of the same decision."""
    looks = (
        watch.evaluate(start_s + k * PERIOD_S, HOVER, decision)
        for k in range(round(seconds / PERIOD_S) + 1)
    )
    return [warning.text for seen in looks for warning in seen.warnings]


def test_a_v_that_only_stands_still_although_it_must_fall_is_told_once() -> None:
    watch = CertificateMonitor(VEHICLE, Gains())
    swinging = decided(SWINGS)
    (warning,) = flown(watch, swinging, 4.0)
    assert warning.startswith(
        "Lyapunov: V has been above its bound for 0.5 s; largest term: poses contradict"
    )
    assert warning.endswith("60 m²/s³")
    assert watch.evaluate(4.1, HOVER, swinging).state == "violated"
    reading = watch.reading()
    assert reading is not None and reading.violated_fraction == pytest.approx(
        1.0 - 0.48 / 4.1, abs=0.01
    )


@pytest.mark.parametrize("gains", [Gains(k2=1.0), None])
def test_other_gains_and_another_reference_begin_without_the_violation(gains: Gains | None) -> None:
    watch = CertificateMonitor(VEHICLE, Gains())
    flown(watch, decided(SWINGS), 2.0)
    calm = decided(values())
    if gains is None:
        watch.restart()
    else:
        watch.set_gains(gains)
    assert flown(watch, calm, 2.0, start_s=2.1) == []
    assert watch.evaluate(4.2, HOVER, calm).state == "holds"
    reading = watch.reading()
    assert reading is not None and reading.state == "holds"


def test_a_v_within_its_bound_is_not_told() -> None:
    watch = CertificateMonitor(VEHICLE, Gains())
    calm = decided(values(v_known=0.03, w=0.99 * decrease(Gains()).power / decrease(Gains()).share))
    assert flown(watch, calm, 10.0) == []
    assert watch.evaluate(10.1, HOVER, calm).state == "holds"


def test_time_at_a_limit_is_suspended_and_does_not_count() -> None:
    watch = CertificateMonitor(VEHICLE, Gains())
    clamped = decided(SWINGS, saturated=True)
    (warning,) = flown(watch, clamped, 3.0)
    assert warning.startswith("Lyapunov: the bound is suspended most of the time")
    assert watch.evaluate(3.1, HOVER, clamped).state == "suspended"
    reading = watch.reading()
    assert reading is not None and reading.suspended_fraction == pytest.approx(1.0)
    assert reading.excess == 0.0


def test_a_disturbance_beyond_b_is_told_with_its_size() -> None:
    watch = CertificateMonitor(VEHICLE, Gains(b_bound=5.0))
    estimated = (3.0, 0.0, 4.2)
    (warning,) = flown(watch, decided(values(b_hat=estimated, disturbance=estimated)), 2.0)
    assert warning.startswith(
        "Lyapunov: the disturbance estimate has been above controller.b_bound for 0.5 s: 5.2 m/s², "
        "limit 5 m/s²"
    )
    reading = watch.reading()
    assert reading is not None
    assert reading.b_hat_fraction == pytest.approx(math.hypot(3.0, 4.2) / 5.5)


@pytest.mark.parametrize(
    ("kb", "down_m_s2", "thrust_n"),
    [
        (0.8, 4.0, HOVER.thrust),
        (0.0, 9.0, HOVER.thrust),  # b̂ is not fed back
        (0.8, 0.0, VEHICLE.thrust_min_n + 1e-6),
        (0.8, 0.0, VEHICLE.thrust_max_n - 1e-6),
    ],
)
def test_within_their_limits_neither_disturbance_nor_thrust_is_told(
    kb: float, down_m_s2: float, thrust_n: float
) -> None:
    estimated = (3.0, 0.0, down_m_s2)
    calm = decided(values(b_hat=estimated, disturbance=estimated), thrust=thrust_n)
    told = flown(CertificateMonitor(VEHICLE, Gains(b_bound=5.0, kb=kb)), calm, 2.0)
    assert not any("b_bound" in one or "thrust margin" in one for one in told)


@pytest.mark.parametrize(
    ("thrust", "which"), [(VEHICLE.thrust_max_n, "upper"), (VEHICLE.thrust_min_n, "lower")]
)
def test_a_thrust_that_stays_at_its_limit_is_told_under_every_controller(
    thrust: float, which: str
) -> None:
    for config in (Gains(), Pid()):
        (warning,) = flown(
            CertificateMonitor(VEHICLE, config),
            decided(values(), saturated=True, thrust=thrust),
            2.0,
        )
        assert f"at its {which} limit" in warning
