"""Softly mounted markers swing, most at the tones that ask the poses: they are no lie."""

import math

import pytest

from groundstation.core.geometry import Quat, Vec3, so3
from tests.flight.flights import fly_fault
from tests.proving.faults.fault import Fault
from tests.proving.faults.faults import shows
from tests.proving.faults.pictures import Picture, Struck, _ours

DAMPING = 0.05
"""Damping of the markers' swinging, as a share of the critical one [-]."""
STEP_S = 0.002
"""Step of its integration [s]."""


def hang(struck: Struck, swings_hz: float) -> Picture:
    """The markers hang on the vehicle by a spring."""
    stiffness = (2.0 * math.pi * swings_hz) ** 2
    damping = 4.0 * math.pi * DAMPING * swings_hz
    markers, seen_s, rates = struck.attitude, struck.time_s, (0.0, 0.0, 0.0)

    def change(time_s: float, position: Vec3, attitude: Quat) -> tuple[Vec3, Quat]:
        nonlocal markers, seen_s, rates
        steps = max(round((time_s - seen_s) / STEP_S), 1)
        h, seen_s = (time_s - seen_s) / steps, time_s
        for _ in range(steps):
            off = so3.rotation_vector(so3.multiply(so3.conjugate(markers), attitude))
            p, q, r = (
                w + h * (stiffness * o - damping * w) for w, o in zip(rates, off, strict=True)
            )
            rates = p, q, r
            markers = so3.rotate(markers, (h * p, h * q, h * r))
        return position, markers

    return _ours(change)


@pytest.mark.tried(1)  # the slowest swing, which is the nearest to a lie
@pytest.mark.parametrize(("swings_hz", "state"), [(7.0, "hold"), (8.0, "tracking"), (12.0, "hold")])
def test_markers_that_swing_at_seven_hertz_or_faster_are_not_accused(
    swings_hz: float, state: str
) -> None:
    soft = Fault(shows(hang, swings_hz), obeys=True)
    row = fly_fault("soft markers", soft, state)
    assert row.safe, row.why
    assert row.reaction == "flies on"
