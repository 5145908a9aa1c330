"""The watch of many flights sees in each what the watch of one flight sees there."""

from typing import Any, NamedTuple

import msgspec
import numpy as np
import pytest
from hypothesis import given, strategies as st

from groundstation.core.control import SUSPENDED, VIOLATED, CertificateMonitor, Gains
from groundstation.core.geometry import Vec3
from groundstation.core.messages import Decision, Diagnostics
from groundstation.core.pilot import NOISE_POSES
from groundstation.core.vehicle import ActuatorCommand, Motion, Vehicle
from sim.batch.batch import BatchWatch

ZERO: Vec3 = (0.0, 0.0, 0.0)
HOVER = Motion(ZERO, ZERO, (1.0, 0.0, 0.0, 0.0), 0.785, ZERO)
PERIOD_S = 0.125
"""Half a second is four of them to the last bit, so that nothing is a look early or late by rounding."""
SAID = Diagnostics(ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, 0.0, 0.0, "composite")


class Look(NamedTuple):
    """What matters of one command."""

    v: float
    w: float
    north: float
    """b̂, north."""
    seen: float
    """d̂, north."""
    saturated: bool


LOOKS = st.builds(
    Look,
    v=st.floats(0.0, 8.0),
    w=st.floats(0.0, 20.0),
    north=st.sampled_from([0.0, 4.0, 6.0]),
    seen=st.floats(0.0, 6.0),
    saturated=st.booleans(),
)
SPELLS = st.tuples(LOOKS, st.integers(1, 8))
"""A command that is said again and again: only so does anything last."""
FLIGHTS = st.lists(SPELLS, min_size=4, max_size=12).map(lambda spells: [look for look, n in spells for _ in range(n)])


def decided(look: Look) -> Decision:
    zero = 0.0 * look.v
    said = msgspec.structs.replace(
        SAID, v_known=look.v, w=look.w, b_hat=(look.north, zero, zero), disturbance=(look.seen, zero, zero)
    )
    return Decision(ActuatorCommand(0.785, ZERO), look.saturated, said)


@given(flights=st.lists(FLIGHTS, min_size=1, max_size=4), noise_m=st.sampled_from([None, 0.0003, 0.003]))
def test_each_flight_of_a_batch_is_watched_as_if_it_were_alone(
    flights: list[list[Look]], noise_m: float | None
) -> None:
    gains = Gains()
    length = min(len(flight) for flight in flights)
    batch = BatchWatch(len(flights), gains, PERIOD_S)
    alone = [CertificateMonitor(Vehicle(), gains) for _ in flights]
    if noise_m is not None:
        everyone = np.arange(len(flights))
        for k in range(NOISE_POSES + 1):
            batch.pose(everyone, np.full(len(flights), k / 64), np.full(len(flights), noise_m**2))
        for watch in alone:
            watch.noise(noise_m, 1 / 64)
    states: list[list[str]] = [[] for _ in flights]
    for k in range(length):
        row = [flight[k] for flight in flights]
        columns: Any = [np.array(column) for column in zip(*row, strict=True)]
        batch.look(decided(Look(*columns)))
        for watch, look, told in zip(alone, row, states, strict=True):
            told.append(watch.look(k * PERIOD_S, HOVER, decided(look)).state)
    violated, suspended = batch.shares()
    assert violated == pytest.approx([told.count(VIOLATED) / length for told in states], abs=1e-9)
    assert suspended == pytest.approx([told.count(SUSPENDED) / length for told in states], abs=1e-9)
