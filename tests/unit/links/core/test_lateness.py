"""The histogram of lateness: what is counted where, and what its percentiles are."""

import pytest

from links.core import Lateness


@pytest.mark.parametrize(
    ("late_s", "octave", "shown_us"),
    [
        (-1.0, 0, 0),  # early counts as in time
        (0.9e-6, 0, 0),
        (1.5e-6, 1, 1),
        (0.0005111, 9, 511),  # exact below 512 µs
        (0.0005121, 10, 513),  # bins of 2 µs above, by their last
        (0.0010001, 10, 1001),
        (0.0010241, 11, 1027),
        (0.01, 14, 10015),
        (1.0, 20, 1001471),
        (100.0, 23, 8388607),  # the latest that is told apart
    ],
)
def test_a_lateness_is_counted_in_its_octave_and_shown_to_a_256th(
    late_s: float, octave: int, shown_us: int
) -> None:
    lateness = Lateness()
    lateness.add(late_s)
    assert (lateness.count, lateness.octaves.index(1), sum(lateness.octaves)) == (1, octave, 1)
    assert lateness.percentiles_us() == (shown_us,) * 3


def test_percentiles_are_what_so_many_did_not_exceed() -> None:
    lateness = Lateness()
    assert lateness.percentiles_us() == (0, 0, 0)
    for late_us in range(1000):
        lateness.add(1e-6 * (0.5 + 0.4 * late_us))
    assert lateness.percentiles_us() == (200, 396, 399)
    assert lateness.count == 1000
