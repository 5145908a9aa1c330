"""links/core/deadman.py."""

import pytest
from hypothesis import given, strategies as st

from links.core import full_thrust_n, signal, thrust

share = st.floats(0.0, 1.0)


@given(share, share)
def test_the_signal_gives_the_thrust_that_was_asked_for(wanted: float, factor: float) -> None:
    assert thrust(signal(wanted, factor), factor) == pytest.approx(wanted, abs=1e-12)


@given(st.floats(0.05, 0.95), share)
def test_the_signal_that_carries_the_vehicle_tells_the_full_thrust(
    weight_share: float, factor: float
) -> None:
    hover = signal(weight_share, factor)
    assert full_thrust_n(20.0 * weight_share, hover, factor) == pytest.approx(20.0)


@pytest.mark.parametrize(("thrust", "curve", "half"), [
    (0.37, 0.0, 0.37),  # no curve
    (0.25, 1.0, 0.5),  # thrust is the square of the signal
    (0.3375, 0.65, 0.5),  # MOT_THST_EXPO 0.65: 0.65 * 0.25 + 0.35 * 0.5
])  # fmt: skip
def test_the_signal_is_the_inverse_of_the_curve(thrust: float, curve: float, half: float) -> None:
    assert signal(thrust, curve) == pytest.approx(half)


@pytest.mark.parametrize("factor", [0.0, 0.65, 1.0])
def test_thrust_beyond_the_range_is_clamped(factor: float) -> None:
    assert signal(-0.1, factor) == 0.0
    assert signal(1.5, factor) == 1.0
