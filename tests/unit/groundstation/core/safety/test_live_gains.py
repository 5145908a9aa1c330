"""Gains in flight: what is refused, how they move, and when they go back by themselves."""

import math
from itertools import pairwise

import msgspec
import pytest

from groundstation.core.control import Gains
from groundstation.core.messages import Estimate, Severity
from groundstation.core.safety import LIVE, LiveGains
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import Motion

# By their numbers: a limit that the test took from the code would bear out any value.
RAMP_S = 2.0
BACK_S = 0.5
JUDGED_S = 10.0

PERIOD_S = 0.02
HERE = Reference((0.0, 0.0, -1.0))


class Flown:
    """A flight whose error and V are as told."""

    def __init__(self) -> None:
        self.live = LiveGains(Gains())
        self.time_s = 100.0
        self.steps: list[tuple[str, float]] = []
        self.told: list[str] = []

    def on(self, for_s: float, error_m: float = 0.01, v: float = 0.01) -> "Flown":
        rest = (0.0, 0.0, 0.0)
        motion = Motion((error_m, 0.0, -1.0), rest, (1.0, 0.0, 0.0, 0.0), 1.0, rest)
        estimate = Estimate(self.time_s, motion, rest, rest, 1.0)
        for _ in range(round(for_s / PERIOD_S)):
            self.time_s += PERIOD_S
            step, told = self.live.update(self.time_s, estimate, HERE, v, counts=True)
            if step is not None:
                self.steps.append(step)
            if told is not None:
                self.told.append(told.text)
                assert (told.severity is Severity.WARNING) == told.text.startswith("warning")
        return self

    def ask(self, key: str, value: float) -> tuple[bool, str]:
        reply = self.live.set(key, value, self.time_s)
        return reply.done, reply.says

    @property
    def k2(self) -> float:
        assert self.live.gains is not None
        return self.live.gains.k2


def test_a_gain_moves_in_small_steps_and_stays_where_the_flight_is_as_good() -> None:
    flight = Flown().on(11.0)
    assert flight.ask("controller.k2", 3.0) == (True, "controller.k2 goes from 2 to 3 within 2 s")
    flight.on(RAMP_S + JUDGED_S + 0.1, error_m=0.014)
    values = [2.0, *(value for _, value in flight.steps)]
    assert values[-1] == flight.k2 == 3.0
    assert max(b - a for a, b in pairwise(values)) < 1.1 * PERIOD_S / RAMP_S
    assert len(flight.steps) <= RAMP_S / PERIOD_S + 1
    assert flight.told == ["controller.k2 stays at 3: the flight is as good as before"]


@pytest.mark.parametrize(
    ("error_m", "v", "words"),
    [(0.016, 0.01, "RMS"), (0.01, 0.042, "V has"), (math.nan, 0.01, "RMS"), (0.01, math.nan, "V")],
)
def test_a_gain_goes_back_by_itself_where_error_or_v_rises_too_far(
    error_m: float, v: float, words: str
) -> None:
    flight = Flown().on(11.0)
    assert flight.ask("controller.k2", 3.0)[0]
    flight.on(RAMP_S + JUDGED_S + BACK_S + 0.1, error_m=error_m, v=v)
    assert flight.k2 == 2.0
    assert len(flight.told) == 1
    assert flight.told[0].startswith("warning: controller.k2 goes back to 2: ")
    assert words in flight.told[0]


def test_a_very_bad_change_does_not_get_its_full_time() -> None:
    flight = Flown().on(11.0)
    assert flight.ask("controller.k2", 1.0)[0]
    flight.on(0.5, error_m=0.2)
    assert flight.told
    flight.on(BACK_S + 0.1, error_m=0.2)
    assert flight.k2 == 2.0


def test_a_change_can_be_taken_back_and_no_other_made_while_it_is_judged() -> None:
    flight = Flown().on(11.0)
    assert flight.ask("controller.k2", 3.0)[0]
    flight.on(1.0)
    assert "still being compared" in flight.ask("controller.k3", 5.0)[1]
    assert "still being compared" in flight.ask("controller.k2", 3.1)[1]
    assert flight.ask("controller.k2", 2.0) == (True, "controller.k2 goes back to 2")
    flight.on(1.0)
    assert flight.k2 == 2.0


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("controller.k2", 4.1, "one change goes to 1 at least and 4 at most"),
        ("controller.k2", 0.9, "one change"),
        ("controller.k2", -1.0, ">= 0.01"),
        ("controller.k2", math.nan, ">= 0.01"),
        ("controller.k2", math.inf, "<= 200"),
        ("controller.sigma_bound", 1.6, "expected one of controller.k2"),
        ("controller.kind", 1.0, "can't be changed"),
        ("vehicle.mass_kg", 0.1, "can't be changed"),
        ("k2", 2.1, "can't be changed"),
    ],
)
def test_what_is_out_of_bounds_or_no_gain_is_refused_in_words(
    key: str, value: float, words: str
) -> None:
    flight = Flown().on(11.0)
    done, says = flight.ask(key, value)
    assert not done
    assert words in says
    assert flight.on(3.0).steps == []


def test_every_live_gain_is_one_of_the_law() -> None:
    assert set(LIVE) <= set(msgspec.structs.asdict(Gains()))
