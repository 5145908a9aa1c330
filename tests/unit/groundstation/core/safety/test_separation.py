"""Other vehicles: how they are seen, what room is left, and what follows where it is too little."""

import math
from typing import Any

import msgspec
import pytest
from hypothesis import assume, given, strategies as st

from groundstation.config import from_dict
from groundstation.core.geometry import Vec3
from groundstation.core.messages import Others, PoseStatus, Sentence
from groundstation.core.messages.pose import BodySighting
from groundstation.core.mission import State
from groundstation.core.safety import (
    Escalation,
    GuardAction,
    GuardFinding,
    Guards,
    Separation,
    SeparationConfig,
)
from groundstation.core.safety.geofence import Near
from groundstation.flight.preflight import Checks
from groundstation.settings import Config
from tests.unit.groundstation.core.safety.test_guards import CONFIG, PERIOD_S, VEHICLE, shown
from tests.unit.groundstation.flight.test_preflight import BASE, LINK, standing

# By their numbers: a limit that the test took from the code would bear out any value.
GAP_S = 0.5

PLACE = SeparationConfig(others=("bee",), distance_m=0.5, braking_m_s2=1.0, reaction_s=0.3)
HERE, REST = (0.0, 0.0, -1.0), (0.0, 0.0, 0.0)


class Placed(Others):
    """Others of whom one is where it is told to be."""

    sight: BodySighting | None = None

    def sighting(self, name: str) -> BodySighting | None:
        return self.sight


places = st.tuples(*[st.floats(-5.0, 5.0)] * 3)
speeds = st.tuples(*[st.floats(-3.0, 3.0)] * 3)


def seen(
    place: Vec3, velocity: Vec3 = REST, *, until_s: float = 1.0, names: tuple[str, ...] = ("bee",)
) -> Others:
    """The others, each at ``place`` at ``until_s``, watched at 100 Hz for a quarter of a second."""
    others = Others(names)
    for i in range(-25, 1):
        x, y, z = (p + 0.01 * i * v for p, v in zip(place, velocity, strict=True))
        for name in names:
            others.see(name, until_s + 0.01 * i, (x, y, z))
    return others


def nearest(others: Others, place: Vec3, velocity: Vec3, config: SeparationConfig = PLACE) -> Near:
    found = Separation(config, others).nearest(place, velocity, 1.0)
    assert found is not None
    return found


def test_speed_is_measured_and_a_body_that_is_not_seen_for_a_moment_goes_on_as_it_went() -> None:
    sight = seen((1.0, 2.0, -3.0), (0.5, -1.0, 0.25)).sighting("bee")
    assert sight is not None and sight.velocity_ned == pytest.approx((0.5, -1.0, 0.25))
    assert sight.at(1.2) == pytest.approx((1.1, 1.8, -2.95))


def test_a_body_that_was_seen_once_or_is_seen_again_after_long_has_no_speed() -> None:
    others = Others(("bee",))
    assert others.sighting("bee") is None
    others.see("bee", 1.0, (0.0, 0.0, 0.0))
    others.see("bee", 1.0 + 2.0 * GAP_S, (9.0, 0.0, 0.0))
    sight = others.sighting("bee")
    assert sight is not None and sight.position_ned == (9.0, 0.0, 0.0)
    assert sight.velocity_ned == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("place", "reason"),
    [
        ((math.nan, 0.0, 0.0), "not_finite"),
        ((0.0, math.inf, 0.0), "not_finite"),
        ((0.0, 0.0, 2e6), "absurd"),
    ],
)
def test_a_place_that_is_none_is_counted_and_not_believed(place: Vec3, reason: str) -> None:
    others = seen((1.0, 0.0, 0.0))
    others.see("bee", 1.01, place)
    sight = others.sighting("bee")
    assert sight is not None and sight.time_s == 1.0
    assert others.dropped == {reason: 1}


@given(places, speeds, places, speeds)
def test_speed_never_makes_room_and_leaving_takes_none(a: Vec3, u: Vec3, b: Vec3, v: Vec3) -> None:
    assume(math.dist(a, b) > 0.01)
    still = nearest(seen(b), a, REST).room_m
    assert still == pytest.approx(math.dist(a, b) - PLACE.distance_m)
    assert nearest(seen(b, v), a, u).room_m <= still + 1e-6
    x, y, z = (0.5 * (p - q) for p, q in zip(a, b, strict=True))
    assert nearest(seen(b), a, (x, y, z)).room_m == pytest.approx(still, abs=1e-6)


@given(
    st.floats(0.0, 2.0),
    st.floats(0.0, 2.0),
    st.floats(0.3, 3.0),
    st.floats(0.0, 1.0),
    st.floats(0.2, 1.0),
)
def test_who_brakes_as_counted_on_once_there_is_no_room_keeps_the_distance(
    u: float, v: float, braking: float, reaction_s: float, distance_m: float
) -> None:
    assume(u + v > 0.1)
    config = SeparationConfig(
        others=("bee",), distance_m=distance_m, braking_m_s2=braking, reaction_s=reaction_s
    )
    bee, dt = Placed(("bee",)), 0.01
    gap = 20.0
    while True:
        bee.sight = BodySighting(1.0, (gap, 0.0, 0.0), (-v, 0.0, 0.0))
        if nearest(bee, REST, (u, 0.0, 0.0), config).room_m < 0.0:
            break
        gap -= (u + v) * dt
    gap -= (u + v) * reaction_s + 0.5 * (u * u + v * v) / braking
    assert distance_m - (u + v) * dt - 1e-9 <= gap <= distance_m


def test_the_one_that_leaves_least_room_counts_but_one_that_is_too_near_comes_first() -> None:
    others = Others(("far", "fast", "close"))
    for i in range(-25, 1):
        others.see("far", 1.0 + 0.01 * i, (3.0, 0.0, 0.0))
        others.see("fast", 1.0 + 0.01 * i, (4.0 - 0.03 * i, 0.0, 0.0))
    assert nearest(others, REST, REST).name == "fast"
    others.see("close", 1.0, (0.4, 0.0, 0.0))
    assert nearest(others, REST, REST).name == "close"


# ---- in flight


def guarded(others: Others, config: SeparationConfig = PLACE) -> Guards:
    return Guards(CONFIG, None, VEHICLE, lambda: PERIOD_S, Separation(config, others))


@pytest.mark.parametrize(
    ("velocity", "other", "others_velocity", "answer"),
    [
        ((1.0, 0.0, 0.0), (1.2, 0.0, -1.0), REST, "HOLD, at most LAND"),
        (REST, (1.2, 0.0, -1.0), (-1.0, 0.0, 0.0), "HOLD, at most LAND"),
        (REST, (0.4, 0.0, -1.0), REST, "LAND, at most LAND"),
        (REST, (0.1, 0.0, -1.4), REST, "LAND, at most LAND"),  # it is above: land
        (REST, (0.1, 0.0, -0.6), REST, "HOLD, at most HOLD"),  # it is beneath: stay
        ((0.0, 0.0, 1.0), (0.1, 0.0, 0.2), REST, "HOLD, at most HOLD"),  # and do not go there
        (REST, HERE, REST, "LAND, at most LAND"),
        (REST, (0.6, 0.0, -1.0), REST, ""),  # who keeps away is left alone
        ((-1.0, 0.0, 0.0), (0.6, 0.0, -1.0), REST, ""),
        ((1.0, 0.0, 0.0), (1.6, 0.0, -1.0), REST, ""),
    ],
)
def test_too_near_is_answered_once_it_lasts(
    velocity: Vec3, other: Vec3, others_velocity: Vec3, answer: str
) -> None:
    guards = guarded(seen(other, others_velocity))
    ticks = [shown(1.0 + 0.02 * i, position=HERE, velocity=velocity) for i in range(6)]
    found = [guards.check_command(tick, State.TRACKING) for tick in ticks]
    assert found[0] is None, "one pose alone may be another body's"
    last = found[-1]
    assert answer == ("" if last is None else f"{last.step.name}, at most {last.most.name}")
    assert last is None or "bee" in last.reason.text


@pytest.mark.parametrize("unknown", ["warn", "hold", "land"])
def test_one_that_is_not_seen_is_a_warning_and_then_as_configured(unknown: Any) -> None:
    config = msgspec.structs.replace(PLACE, unknown=unknown)
    guards, step = guarded(seen((3.0, 0.0, 0.0)), config), GuardAction[unknown.upper()]
    said: dict[float, GuardAction] = {}
    for i in range(150):
        time_s = 1.0 + 0.02 * i
        finding = guards.check_command(shown(time_s), State.TRACKING)
        if finding is not None:
            said[time_s] = finding.step
    begun = min(said)
    assert begun == pytest.approx(1.0 + config.stale_s, abs=0.021)
    assert said[begun] is GuardAction.WARN
    if step is not GuardAction.WARN:
        answered = min(time_s for time_s, one in said.items() if one is step)
        assert answered == pytest.approx(begun + config.unknown_s, abs=0.021)
    assert said[1.0 + 0.02 * 149] is step


def test_nearness_is_never_answered_by_a_descent_that_knows_no_place() -> None:
    near = Sentence("guard.separation", "near")
    finding = GuardFinding(GuardAction.HOLD, near, most=GuardAction.LAND)
    escalation = Escalation(2.0)
    answers = [escalation.escalate(finding, 0.02 * i) for i in range(1000)]
    steps = [answer.step for answer in answers if answer is not None]
    assert steps == [GuardAction.HOLD, GuardAction.LAND]


# ---- before it


@pytest.mark.parametrize(
    ("others", "unknown", "verdict", "says"),
    [
        (seen((1.0, 0.0, 0.0)), "hold", "PASS", "1.00 m away"),
        (seen((0.5, 0.0, 0.0)), "hold", "FAIL", "0.50 m from bee, limit 0.6 m"),
        (seen((1.0, 0.0, 0.0), until_s=0.5), "hold", "FAIL", "no sighting of bee"),
        (seen((1.0, 0.0, 0.0), until_s=0.5), "warn", "WARN", "no sighting of bee"),
        (Others(("bee", "cat")), "hold", "FAIL", "no sighting of bee, cat"),
    ],
)
def test_before_take_off_every_other_must_be_seen_and_far_enough_away(
    others: Others, unknown: str, verdict: str, says: str
) -> None:
    config = {**BASE, "separation": {"others": list(others.names), "unknown": unknown}}
    checks = Checks(from_dict(config, Config), others)
    seen = checks(standing(), 0.0005, LINK, 1.03, None, PoseStatus(50, {}))
    (found,) = [one for one in seen if one.name == "other vehicles"]
    assert found.verdict == verdict
    assert says in found.says
