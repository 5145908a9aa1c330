"""Every guard: quiet within its limit, heard beyond it for long enough, and what follows."""

import math
from collections.abc import Iterable
from typing import Any

import msgspec
import pytest
from hypothesis import assume, given, strategies as st

from groundstation.config import from_dict
from groundstation.core.control.attitude import make_decision
from groundstation.core.geometry import Vec3, so3
from groundstation.core.messages import (
    NOTICES,
    CertificateReading,
    Estimate,
    Others,
    Pose,
    PoseStatus,
    Sentence,
    Tick,
    notice,
)
from groundstation.core.messages.pose import BodySighting
from groundstation.core.mission import State
from groundstation.core.safety import (
    GUARDS,
    Escalation,
    Fence,
    GuardAction,
    GuardFinding,
    Guards,
    GuardsConfig,
    Separation,
    SeparationConfig,
    list_limits,
)
from groundstation.core.safety.geofence import BoxFence, Near
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import Motion, Vehicle
from groundstation.flight.preflight import Checks
from groundstation.settings import Config
from links.core import Command, LinkStatus
from tests.unit.groundstation.flight.test_preflight import BASE, LINK, standing

VEHICLE = Vehicle()
CONFIG = GuardsConfig()
PERIOD_S = 0.02
STATUS = LinkStatus(state="armed", sent=0, expired=0, received=0, dropped={}, text="")
FENCE = Fence(BoxFence(north_m=(-2.0, 2.0), east_m=(-2.0, 2.0), height_m=2.0), 0.0)
NEAR_FENCE = notice("guard.braking", room_m=0.1, speed_m_s=2.0)
TILTED = notice("guard.tilt", tilt_deg=50.0, limit_deg=40.0)
EMPTY = notice("guard.charge", charge=9.0, limit=10.0)


REST, LEVEL = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)


def leaning(degrees: float) -> tuple[float, float, float, float]:
    half = math.radians(0.5 * degrees)
    return (math.cos(half), math.sin(half), 0.0, 0.0)


def shown(time_s: float, **changes: Any) -> Tick:
    """A tick of a vehicle at its reference, with ``changes`` of fields of any of its parts."""

    def changed(*fields: str) -> dict[str, Any]:
        return {name: changes[name] for name in fields if name in changes}

    motion = Motion((0.0, 0.0, -1.0), REST, LEVEL, 0.8, REST)
    motion = msgspec.structs.replace(motion, **changed(*Motion.__struct_fields__))
    estimate = Estimate(time_s, motion, REST, REST, 1.0)
    estimate = estimate._replace(**changed("disturbance", "effectiveness"))
    command = Command(0.8, REST, 0, 0.0, 1.0)
    command = msgspec.structs.replace(command, **changed("thrust_n", "rates_rad_s"))
    seen = changes.get("seen", (0.0, 0.0, -1.0))
    pose = Pose(0, time_s - changes.get("age_s", 0.0), time_s, seen, LEVEL)
    pose = msgspec.structs.replace(pose, **changed("reset_count"))
    reference = Reference((0.0, 0.0, -1.0))
    decision = make_decision(VEHICLE, estimate, reference, command.thrust_n, command.rates_rad_s)
    certificate = CertificateReading("none", 0.0, ())
    return Tick(time_s, 0.0, pose, estimate, reference, decision, command, certificate)


def first(
    limit: dict[str, Any], state: State = State.TRACKING, *, period_s: float = PERIOD_S
) -> tuple[float, GuardFinding] | None:
    """When the first finding comes where ``limit`` lasts from 1 s on, and it."""
    guards = Guards(CONFIG, FENCE, VEHICLE, lambda: PERIOD_S, coast_s=0.25)
    time_s = 0.0
    while time_s < 5.0:
        beyond = time_s >= 1.0
        found = guards.check_command(shown(time_s, **(limit if beyond else {})), state)
        if found is not None:
            return time_s - 1.0, found
        time_s += period_s if beyond else PERIOD_S
    return None


def findings(
    ticks: Iterable[Tick], fence: Fence | None = None, vehicle: Vehicle = VEHICLE
) -> list[GuardFinding | None]:
    """Return the finding at each tick of a flight along its trajectory."""
    guards = Guards(CONFIG, fence, vehicle, lambda: PERIOD_S)
    return [guards.check_command(tick, State.TRACKING) for tick in ticks]


FULL = math.radians(VEHICLE.rate_limits_deg_s[0])


def moving(position: Vec3, velocity: Vec3) -> dict[str, Vec3]:
    return {"position": position, "velocity": velocity}


CASES: list[tuple[dict[str, Any], float, str, str]] = [
    ({"attitude": leaning(81.0)}, CONFIG.tilt_s, "DESCEND", "tilt 81°, limit 80°"),
    ({"attitude": (math.nan,) * 4}, CONFIG.tilt_s, "DESCEND", "tilt 180°"),
    ({"attitude": leaning(41.0)}, CONFIG.oscillation_s, "LAND", "oscillation: tilt 41°"),
    ({"disturbance": (9.0, 0.0, 0.0)}, CONFIG.oscillation_s, "LAND", "oscillation: tilt"),
    ({"disturbance": (math.nan, 0.0, 0.0)}, CONFIG.oscillation_s, "LAND", "oscillation: tilt 180°"),
    ({"position": (1.1, 0.0, -1.0)}, CONFIG.error_s, "LAND", "1.10 m from the reference"),
    ({"position": (math.nan, 0.0, -1.0)}, CONFIG.error_s, "LAND", "nan m from the reference"),
    (moving((0.0, -1.0, -1.0), (0.0, 2.6, 0.0)), 0.0, "HOLD", "before the fence"),
    (moving((1.9, 0.0, -1.0), (1.0, 0.0, 0.0)), 0.0, "HOLD", "before the fence"),
    ({"velocity": (0.0, 0.0, 2.6)}, CONFIG.speed_s, "LAND", "2.6 m/s relative to the reference"),
    ({"position": (2.1, 0.0, -1.0)}, 0.0, "LAND", "0.10 m outside the fence"),
    ({"position": (0.0, 0.0, -2.1)}, 0.0, "LAND", "outside the fence"),
    ({"thrust_n": VEHICLE.thrust_max_n}, CONFIG.thrust_limit_s, "LAND", "thrust at its limit"),
    ({"rates_rad_s": (0.0, -FULL, 0.0)}, CONFIG.rate_limit_s, "DESCEND", "a body rate at its"),
    ({"effectiveness": 0.69}, 1.0, "LAND", "thrust is 69 % of what is commanded"),
    ({"effectiveness": math.nan}, 1.0, "LAND", "thrust is nan % of what is commanded"),
    ({"age_s": 0.16}, 0.3, "LAND", "pose age 160 ms on arrival, limit 150 ms"),
    ({"seen": (0.0, 0.0, 0.6)}, 0.06, "DESCEND", "0.60 m under the floor"),
]


@pytest.mark.parametrize(("limit", "for_s", "step", "says"), CASES)
def test_beyond_its_limit_a_guard_is_heard_after_its_time(
    limit: dict[str, Any], for_s: float, step: str, says: str
) -> None:
    found = first(limit)
    assert found is not None
    after_s, finding = found
    assert after_s == pytest.approx(for_s, abs=1.01 * PERIOD_S)
    assert finding.step is GuardAction[step]
    assert says in finding.reason.text


@pytest.mark.parametrize(
    "limit",
    [
        {"attitude": leaning(39.0)},
        {"position": (0.99, 0.0, -1.0)},
        {"position": (0.4, 0.0, -1.0), "velocity": (1.0, 0.0, 0.0)},
        {"velocity": (0.0, 0.0, 2.4)},
        {"thrust_n": 0.99 * VEHICLE.thrust_max_n},
        {"thrust_n": VEHICLE.thrust_min_n},
        {"rates_rad_s": (0.0, 0.99 * FULL, 0.0)},
        {"effectiveness": 0.71},
        {"age_s": 0.14},
        {"seen": (0.0, 0.0, 0.4)},
    ],
)
def test_within_its_limit_a_guard_is_quiet(limit: dict[str, Any]) -> None:
    assert first(limit) is None


def test_every_row_of_the_table_has_a_sentence_and_a_key_and_there_are_few() -> None:
    assert len(GUARDS) <= 20
    assert all(guard.id in NOTICES for guard in GUARDS)
    keys = {guard.key for guard in GUARDS if guard.key.startswith("guards.")}
    assert keys <= {f"guards.{name}" for name in GuardsConfig.__struct_fields__}


def test_the_limits_of_a_configuration_are_listed_row_by_row_as_the_table_has_them() -> None:
    config = from_dict({"guards": {"tilt_deg": 45.0, "tilt_s": 0.2}}, Config)
    limits = list_limits(config, config.guards)
    assert [limit.key for limit in limits] == [guard.key for guard in GUARDS]
    tilt = limits[0]
    assert (tilt.key, tilt.limit) == ("guards.tilt_deg", 45.0)
    assert (tilt.lasts_s, tilt.step) == (0.2, "failsafe descent")
    without = {limit.key for limit in limits if limit.limit is None}
    assert without == {"fence", "fence.braking_m_s2", "guards.battery_v"}  # none is set up


def test_an_estimate_that_is_reset_again_and_again_lands() -> None:
    found = findings(shown(0.02 * i, reset_count=min(i // 20, 5)) for i in range(300))
    assert all(one is None for one in found[:100])
    assert found[100] is not None and "5 resets" in found[100].reason.text
    assert all(one is None for one in found[270:]), "5 s after the first there were four"


def test_of_several_the_gravest_is_told() -> None:
    outside = {"position": (2.1, 0.0, -1.0), "attitude": leaning(81.0)}
    told = findings((shown(PERIOD_S * i, **outside) for i in range(50)), FENCE)
    steps = [one.step for one in told if one is not None]
    assert steps == [GuardAction.LAND] * 5 + [GuardAction.DESCEND] * 45
    weak = (shown(PERIOD_S * i, effectiveness=0.6, reset_count=i // 20) for i in range(110))
    *_, last = findings(weak)
    assert last is not None and (last.step, last.most) == (GuardAction.LAND, GuardAction.DESCEND)


def test_a_descent_has_no_reference_to_be_far_from() -> None:
    assert first({"position": (1.9, 0.0, -1.0)}, State.DESCENT) is None
    assert first({"attitude": leaning(81.0)}, State.DESCENT) is not None


@pytest.mark.parametrize(("share", "lands"), [(0.3, False), (0.6, True)])
def test_a_limit_cycle_has_breaks_and_lands_it_all_the_same(share: float, lands: bool) -> None:
    rolls = [(FULL if i % 20 < 20 * share else 0.0, 0.0, 0.0) for i in range(250)]
    ticks = (shown(PERIOD_S * i, rates_rad_s=rates) for i, rates in enumerate(rolls))
    found = next(filter(None, findings(ticks)), None)
    assert (found is not None) == lands
    assert found is None or found.step is GuardAction.DESCEND
    assert found is None or "of the last 2 s" in found.reason.text


def swung(degrees: float, period_s: float) -> GuardFinding | None:
    """What is found of a vehicle that leans to one side and the other."""
    leans = [degrees * math.sin(math.tau * PERIOD_S * i / period_s) for i in range(250)]
    ticks = (shown(PERIOD_S * i, attitude=leaning(lean)) for i, lean in enumerate(leans))
    return next(filter(None, findings(ticks)), None)


def test_a_vehicle_that_swings_is_brought_down_though_no_limit_is_passed_for_long() -> None:
    found = swung(58.0, 0.9)
    assert found is not None and found.step is GuardAction.LAND
    assert "oscillation" in found.reason.text
    assert swung(41.0, 0.9) is None


@pytest.mark.parametrize(("share", "lands"), [(0.2, False), (0.4, True)])
def test_time_beyond_the_angle_of_an_oscillation_is_forgotten_within_a_second(
    share: float, lands: bool
) -> None:
    leans = [41.0 if i % 20 < 20 * share else 0.0 for i in range(250)]
    ticks = (shown(PERIOD_S * i, attitude=leaning(lean)) for i, lean in enumerate(leans))
    assert any(findings(ticks)) is lands


def test_frames_that_are_late_again_and_again_land() -> None:
    found = first({}, period_s=2.6 * PERIOD_S)
    assert found is not None
    assert "frames were late" in found[1].reason.text
    assert found[0] == pytest.approx(CONFIG.overruns * 2.6 * PERIOD_S, abs=0.06)
    assert first({}, period_s=2.4 * PERIOD_S) is None


@pytest.mark.parametrize("every", [16, 25])
def test_late_frames_are_counted_among_the_last_hundred(every: int) -> None:
    guards = Guards(CONFIG, FENCE, VEHICLE, lambda: PERIOD_S, coast_s=0.25)
    time_s, found = 0.0, list[GuardFinding | None]()
    for n in range(400):
        time_s += (2.6 if n % every == 0 else 1.0) * PERIOD_S
        found.append(guards.check_command(shown(time_s), State.TRACKING))
    assert any(found) is (100 / every >= CONFIG.overruns)


@pytest.mark.parametrize(
    ("status", "says"),
    [
        ({"rtt_s": 0.25}, "round trip 250 ms, limit 200 ms"),
        ({"battery_share": 0.19}, "battery at 19 %"),
        ({"battery_v": 3.2}, "battery at 3.20 V"),
    ],
)
def test_the_link_tells_of_its_delay_and_of_the_battery(status: dict[str, Any], says: str) -> None:
    guards = Guards(msgspec.structs.replace(CONFIG, battery_v=3.3), None, VEHICLE, lambda: PERIOD_S)
    low = msgspec.structs.replace(STATUS, **status)
    assert guards.check_link(STATUS, 0.0) is None
    assert guards.check_link(low, 0.5) is None
    found = guards.check_link(low, 1.6)
    assert found is not None and found.step is GuardAction.LAND
    assert says in found.reason.text


def test_what_lasts_is_answered_by_one_step_after_the_other_and_never_by_a_gentler_one() -> None:
    escalation = Escalation(2.0)
    brake = GuardFinding(GuardAction.HOLD, NEAR_FENCE)
    tilt = GuardFinding(GuardAction.DESCEND, TILTED)
    assert escalation.escalate(brake, 0.0) == brake
    assert escalation.escalate(brake, 1.9) is None
    second = escalation.escalate(brake, 2.1)
    assert second is not None
    assert (second.step, second.reason) == (GuardAction.LAND, NEAR_FENCE.as_lasting())
    assert escalation.escalate(brake, 3.0) is None
    assert escalation.escalate(tilt, 3.1) == tilt
    assert escalation.escalate(brake, 99.0) is None
    escalation.reset()
    assert escalation.escalate(brake, 100.0) == brake
    assert escalation.escalate(GuardFinding(GuardAction.LAND, EMPTY), 100.1) is not None
    other_limit = escalation.escalate(brake, 103.0)
    assert other_limit is not None and other_limit.step is GuardAction.DESCEND
    assert other_limit.reason == NEAR_FENCE, "it is not the one that lasts"
    escalation.reset()
    assert escalation.escalate(brake, 150.0) == brake, "an operator who sends it on begins anew"
    empty, other = GuardFinding(GuardAction.LAND, EMPTY, most=GuardAction.LAND), Escalation(2.0)
    told = [other.escalate(empty, time_s) for time_s in (0.0, 9.0)]
    assert told == [empty, None], "what no landing could end is answered by a landing and no more"


@pytest.mark.parametrize(
    ("velocity", "disturbance"),
    [
        ((6.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ((0.0, -6.0, 0.0), (0.0, 0.0, 0.0)),
        ((0.0, 0.0, -6.0), (5.0, 0.0, 0.0)),
    ],
)
def test_who_flies_fast_has_to_lean_against_its_drag(velocity: Vec3, disturbance: Vec3) -> None:
    vehicle = msgspec.structs.replace(VEHICLE, drag_per_s=1.0)
    x, y, z = (d - v + g for d, v, g in zip(disturbance, velocity, (0.0, 0.0, 9.81), strict=True))
    attitude = so3.from_euler_zyx(math.atan2(-y, math.hypot(x, z)), math.atan2(x, z), 0.0)
    assert so3.third_column(attitude) == pytest.approx(
        [each / math.hypot(x, y, z) for each in (x, y, z)]
    )
    leans = {"velocity": velocity, "disturbance": disturbance, "attitude": attitude}
    followed = Reference((0.0, 0.0, -1.0), velocity)
    ticks = (shown(PERIOD_S * i, **leans)._replace(reference=followed) for i in range(100))
    assert not any(findings(ticks, vehicle=vehicle))


# ---- other vehicles: how they are seen, and what room is left

# By their numbers: a limit that the test took from the code would bear out any value.
GAP_S = 0.5

PLACE = SeparationConfig(others=("bee",), distance_m=0.5, braking_m_s2=1.0, reaction_s=0.3)
HERE = (0.0, 0.0, -1.0)


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


# ---- other vehicles in flight


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


# ---- other vehicles before a flight


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
