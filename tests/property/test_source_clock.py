"""Streams of every kind against the source's clock: what is late is never young for long, what is
honest never old.

Errors are against the instant at which each message left, which the synthetic stream knows.
"""

import random
from collections.abc import Callable
from typing import NamedTuple

from hypothesis import Phase, given, settings, strategies as st

from groundstation.pose.sources.intake import SourceClock

Delay = Callable[[float], float]
"""What a message that leaves at a time [s] waits on its way [s], beside jitter."""


class Source(NamedTuple):
    """A tracker and the network behind it."""

    numbers: bool
    """Whether it numbers its frames, and has no clock."""
    rate_hz: float
    told: float
    """By how much the rate that we were told is off, as a share."""
    drift: float
    """How much slower its clock runs than ours."""
    jitter_s: float
    """Mean of what each message waits by chance [s]."""
    seed: int

    def errors(self, lasts_s: float, delay: Delay) -> list[tuple[float, float]]:
        """Instant of leaving, and lateness of our time for it, for each message taken [s]."""
        chance = random.Random(self.seed)
        period = (1.0 + self.drift) / self.rate_hz
        sent = []
        for n in range(int(lasts_s / period)):
            left = n * period
            stamp = float(n) if self.numbers else 500.0 + n / self.rate_hz
            sent.append((left + delay(left) + chance.expovariate(1.0 / self.jitter_s), left, stamp))
        clock = SourceClock(1.0 / (self.rate_hz * (1.0 + self.told)) if self.numbers else None)
        taken = (one for one in sorted(sent) if not clock.stale(one[2], one[0]))
        return [(left, clock.time_s(stamp, arrival) - left) for arrival, left, stamp in taken]

    def fastest_drift(self, errors: list[tuple[float, float]], at_s: float) -> float:
        """Largest error beyond jitter and rounding, by the time since ``at_s`` [s/s]."""
        free_s = self.jitter_s + ROUNDING_S
        late = [(left - at_s, error - free_s) for left, error in errors if left >= at_s]
        return max(error / (since or 1e-9) for since, error in late)


SOURCES = st.builds(
    Source,
    numbers=st.booleans(),
    rate_hz=st.sampled_from([30.0, 50.0]),
    told=st.floats(-0.02, 0.02),
    drift=st.floats(-1e-3, 1e-3),
    jitter_s=st.floats(1e-5, 5e-3),
    seed=st.integers(0, 2**32 - 1),
)
SEARCHES = (Phase.explicit, Phase.reuse, Phase.generate, Phase.shrink)
SOME = settings(max_examples=15, deadline=None, phases=SEARCHES)
LASTS_S = 45.0
KNOWN_S = 15.0
"""The slope of the source's clock is known by then [s]."""
ROUNDING_S = 1e-3
"""What is not looked into: which message of a block was the least delayed [s]."""


@SOME
@given(SOURCES, st.floats(KNOWN_S, 30.0), st.floats(0.05, 0.5))
def test_after_a_step_poses_are_as_late_for_ever_as_the_step_was(
    source: Source, at_s: float, step_s: float
) -> None:
    errors = source.errors(LASTS_S, lambda t: step_s if t >= at_s else 0.0)
    assert max(error for left, error in errors if left >= at_s) < source.jitter_s + ROUNDING_S


@SOME
@given(SOURCES, st.floats(1.0, KNOWN_S), st.floats(0.05, 0.5))
def test_a_step_in_the_first_seconds_is_forgotten_no_faster_than_clocks_drift(
    source: Source, at_s: float, step_s: float
) -> None:
    # A rate of frames is what they have come with.
    at_s = max(at_s, 10.0 if source.numbers else 0.0)
    errors = source.errors(LASTS_S, lambda t: step_s if t >= at_s else 0.0)
    assert source.fastest_drift(errors, at_s) < 0.0015 + abs(source.drift)


@SOME
@given(SOURCES, st.floats(KNOWN_S, 30.0), st.floats(0.005, 0.2))
def test_a_queue_that_fills_is_forgotten_no_faster_than_clocks_drift(
    source: Source, at_s: float, share: float
) -> None:
    errors = source.errors(at_s + 15.0, lambda t: share * max(0.0, t - at_s))
    assert source.fastest_drift(errors, at_s) < 0.0015 + abs(source.drift)


@SOME
@given(SOURCES, st.lists(st.tuples(st.floats(0.0, LASTS_S), st.floats(0.0, 2.0)), max_size=8))
def test_of_an_honest_source_nothing_is_called_older_than_it_is(
    source: Source, stalls: list[tuple[float, float]]
) -> None:
    """Jitter, drift, a rate told wrongly, and a network that holds everything back."""
    errors = source.errors(
        LASTS_S,
        lambda t: max((at + long - t for at, long in stalls if at <= t < at + long), default=0.0),
    )
    assert min(error for left, error in errors if left >= KNOWN_S) > -5.0 * ROUNDING_S
    if not source.numbers:
        assert min(error for _, error in errors) > -8.0 * ROUNDING_S
