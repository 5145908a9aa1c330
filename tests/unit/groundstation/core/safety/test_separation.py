"""Other vehicles: how they are seen, what room is left to them, and what follows where it is too
little.
"""

import math
from typing import Any

import msgspec
import pytest
from hypothesis import assume, given, strategies as st

from groundstation.config import from_dict
from groundstation.core.geometry import Vec3
from groundstation.core.messages import Check, Others, PoseStatus, Sentence, Verdict
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
from tests.unit.groundstation.flight.test_checks import BASE, LINK, standing

# By their numbers: a limit that the test took from the code would bear out any value.
GAP_S = 0.5

PLACE = SeparationConfig(others=("bee",), distance_m=0.5, braking_m_s2=1.0, reaction_s=0.3)


class Placed(Others):
    """Others of whom one is where it is told to be."""

    sight: BodySighting | None = None

    def sighting(self, name: str) -> BodySighting | None:
        return self.sight


places = st.tuples(*[st.floats(-5.0, 5.0)] * 3)
speeds = st.tuples(*[st.floats(-3.0, 3.0)] * 3)


def seen(
    place: Vec3,
    velocity: Vec3 = (0.0, 0.0, 0.0),
    *,
    until_s: float = 1.0,
    names: tuple[str, ...] = ("bee",),
) -> Others:
    """The others, each at ``place`` at ``until_s``, watched at 100 Hz for a quarter of a second."""
    others = Others(names)
    for i in range(-25, 1):
        x, y, z = (p + 0.01 * i * v for p, v in zip(place, velocity, strict=True))
        for name in names:
            others.see(name, until_s + 0.01 * i, (x, y, z))
    return others


def near(
    place: Vec3,
    velocity: Vec3,
    other: Vec3,
    others_velocity: Vec3,
    config: SeparationConfig = PLACE,
) -> Near:
    found = Separation(config, seen(other, others_velocity)).nearest(place, velocity, 1.0)
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
    rest = (0.0, 0.0, 0.0)
    still = near(a, rest, b, rest)
    assert still.room_m == pytest.approx(math.dist(a, b) - PLACE.distance_m)
    assert near(a, u, b, v).room_m <= still.room_m + 1e-6
    away = tuple(0.5 * (p - q) for p, q in zip(a, b, strict=True))
    assert near(a, (away[0], away[1], away[2]), b, rest).room_m == pytest.approx(
        still.room_m, abs=1e-6
    )


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
    separation, gap = Separation(config, bee), 20.0
    while True:
        bee.sight = BodySighting(0.0, (gap, 0.0, 0.0), (-v, 0.0, 0.0))
        found = separation.nearest((0.0, 0.0, 0.0), (u, 0.0, 0.0), 0.0)
        assert found is not None
        if found.room_m < 0.0:
            break
        gap -= (u + v) * dt
    gap -= (u + v) * reaction_s + 0.5 * (u * u + v * v) / braking
    assert distance_m - (u + v) * dt - 1e-9 <= gap <= distance_m


def test_the_one_that_leaves_least_room_counts_but_one_that_is_too_near_comes_first() -> None:
    others = Others(("far", "fast", "close"))
    for i in range(-25, 1):
        others.see("far", 1.0 + 0.01 * i, (3.0, 0.0, 0.0))
        others.see("fast", 1.0 + 0.01 * i, (4.0 - 0.03 * i, 0.0, 0.0))
    found = Separation(PLACE, others).nearest((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0)
    assert found is not None and found.name == "fast"
    others.see("close", 1.0, (0.4, 0.0, 0.0))
    found = Separation(PLACE, others).nearest((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0)
    assert found is not None and found.name == "close"


# ---- in flight


def found_after(
    place: Vec3, velocity: Vec3, other: Vec3, others_velocity: Vec3 = (0.0, 0.0, 0.0)
) -> GuardFinding | None:
    """What a guard says of it once it lasts; time stands still for the other one."""
    guards = Guards(
        CONFIG, None, VEHICLE, lambda: PERIOD_S, Separation(PLACE, seen(other, others_velocity))
    )
    finding = None
    for i in range(6):
        tick = shown(1.0 + 0.02 * i, position=place, velocity=velocity)
        finding = guards.check_command(tick, State.TRACKING)
        if i == 0:
            assert finding is None  # one pose alone may be another body's
    return finding


HERE = (0.0, 0.0, -1.0)
REST = (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("velocity", "other", "others_velocity", "step", "most"),
    [
        ((1.0, 0.0, 0.0), (1.2, 0.0, -1.0), REST, GuardAction.HOLD, GuardAction.LAND),
        (REST, (1.2, 0.0, -1.0), (-1.0, 0.0, 0.0), GuardAction.HOLD, GuardAction.LAND),
        (REST, (0.4, 0.0, -1.0), REST, GuardAction.LAND, GuardAction.LAND),
        (REST, (0.1, 0.0, -1.4), REST, GuardAction.LAND, GuardAction.LAND),  # it is above: land
        (REST, (0.1, 0.0, -0.6), REST, GuardAction.HOLD, GuardAction.HOLD),  # it is beneath: stay
        (REST, HERE, REST, GuardAction.LAND, GuardAction.LAND),
    ],
)
def test_too_near_is_answered(
    velocity: Vec3, other: Vec3, others_velocity: Vec3, step: GuardAction, most: GuardAction
) -> None:
    finding = found_after(HERE, velocity, other, others_velocity)
    assert finding is not None
    assert (finding.step, finding.most) == (step, most)
    assert "bee" in finding.reason.text


@pytest.mark.parametrize(
    ("velocity", "other"),
    [
        (REST, (0.6, 0.0, -1.0)),
        ((-1.0, 0.0, 0.0), (0.6, 0.0, -1.0)),
        ((1.0, 0.0, 0.0), (1.6, 0.0, -1.0)),
    ],
)
def test_who_keeps_away_is_left_alone(velocity: Vec3, other: Vec3) -> None:
    assert found_after(HERE, velocity, other) is None


@pytest.mark.parametrize(
    ("unknown", "step"),
    [("warn", GuardAction.WARN), ("hold", GuardAction.HOLD), ("land", GuardAction.LAND)],
)
def test_one_that_is_not_seen_is_a_warning_and_then_as_configured(
    unknown: Any, step: GuardAction
) -> None:
    config = msgspec.structs.replace(PLACE, unknown=unknown)
    guards = Guards(
        CONFIG, None, VEHICLE, lambda: PERIOD_S, Separation(config, seen((3.0, 0.0, 0.0)))
    )
    said: list[tuple[float, GuardAction | None]] = []
    for i in range(150):
        time_s = 1.0 + 0.02 * i
        finding = guards.check_command(shown(time_s), State.TRACKING)
        said.append((time_s, None if finding is None else finding.step))
    begun = next(time_s for time_s, one in said if one is not None)
    assert begun == pytest.approx(1.0 + config.stale_s, abs=0.021)
    assert dict(said)[begun] is GuardAction.WARN
    if step is not GuardAction.WARN:
        answered = next(time_s for time_s, one in said if one is step)
        assert answered == pytest.approx(begun + config.unknown_s, abs=0.021)
    assert said[-1][1] is step


def test_nearness_is_never_answered_by_a_descent_that_knows_no_place() -> None:
    escalation, steps = Escalation(2.0), []
    for i in range(1000):
        finding = GuardFinding(
            GuardAction.HOLD, Sentence("guard.separation", "near"), most=GuardAction.LAND
        )
        answer = escalation.escalate(finding, 0.02 * i)
        steps += [answer.step] if answer is not None else []
    assert steps == [GuardAction.HOLD, GuardAction.LAND]


# ---- before it


def apart(others: Others, **separation: Any) -> Check:
    config = from_dict({**BASE, "separation": {"others": list(others.names), **separation}}, Config)
    checks = Checks(config, others)(standing(), 0.0005, LINK, 1.03, None, PoseStatus(50, {}))
    return next(one for one in checks if one.name == "other vehicles")


@pytest.mark.parametrize(
    ("others", "separation", "verdict", "says"),
    [
        (seen((1.0, 0.0, 0.0)), {}, Verdict.PASS, "1.00 m away"),
        (seen((0.5, 0.0, 0.0)), {}, Verdict.FAIL, "0.50 m from bee, limit 0.6 m"),
        (seen((1.0, 0.0, 0.0), until_s=0.5), {}, Verdict.FAIL, "no sighting of bee"),
        (
            seen((1.0, 0.0, 0.0), until_s=0.5),
            {"unknown": "warn"},
            Verdict.WARN,
            "no sighting of bee",
        ),
        (Others(("bee", "cat")), {}, Verdict.FAIL, "no sighting of bee, cat"),
    ],
)
def test_before_take_off_every_other_must_be_seen_and_far_enough_away(
    others: Others, separation: dict[str, Any], verdict: Verdict, says: str
) -> None:
    found = apart(others, **separation)
    assert found.verdict is verdict
    assert says in found.says
