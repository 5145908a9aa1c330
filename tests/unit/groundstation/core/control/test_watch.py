"""The certificate in flight: what is told, when, and how often."""

import math

import pytest

from groundstation.core.control import CertificateMonitor, Gains
from groundstation.core.control.certificate import decrease
from groundstation.core.control.controllers import Pid
from groundstation.core.geometry import IDENTITY, ZERO
from groundstation.core.messages import Decision
from groundstation.core.vehicle import Motion, Vehicle
from tests.unit.groundstation.core.control.test_certificate import decided, values

VEHICLE = Vehicle()
HOVER = Motion(ZERO, ZERO, IDENTITY, 0.785, ZERO)
PERIOD_S = 0.02
SWINGS = values(v_known=4.0, w=60.0)
"""V stands still, although it must fall."""


def flown(
    watch: CertificateMonitor, decision: Decision, seconds: float, start_s: float = 0.0
) -> list[str]:
    """The warnings of ``seconds`` of the same decision."""
    looks = (
        watch.look(start_s + k * PERIOD_S, HOVER, decision)
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
    assert watch.look(4.1, HOVER, swinging).state == "violated"
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
        watch.regain(gains)
    assert flown(watch, calm, 2.0, start_s=2.1) == []
    assert watch.look(4.2, HOVER, calm).state == "holds"
    reading = watch.reading()
    assert reading is not None and reading.state == "holds"


def test_a_v_within_its_bound_is_not_told() -> None:
    watch = CertificateMonitor(VEHICLE, Gains())
    calm = decided(values(v_known=0.03, w=0.99 * decrease(Gains()).power / decrease(Gains()).share))
    assert flown(watch, calm, 10.0) == []
    assert watch.look(10.1, HOVER, calm).state == "holds"


def test_time_at_a_limit_is_suspended_and_does_not_count() -> None:
    watch = CertificateMonitor(VEHICLE, Gains())
    clamped = decided(SWINGS, saturated=True)
    (warning,) = flown(watch, clamped, 3.0)
    assert warning.startswith("Lyapunov: the bound is suspended most of the time")
    assert watch.look(3.1, HOVER, clamped).state == "suspended"
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
