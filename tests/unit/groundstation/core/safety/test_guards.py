"""Every guard: quiet within its limit, heard beyond it for long enough, and what follows."""

import math
from collections.abc import Iterable
from typing import Any

import msgspec
import pytest

from groundstation.config import from_dict
from groundstation.core.control.attitude import make_decision
from groundstation.core.geometry import Vec3, so3
from groundstation.core.messages import NOTICES, CertificateReading, Estimate, Pose, Tick, notice
from groundstation.core.mission import State
from groundstation.core.safety import (
    GUARDS,
    Escalation,
    Fence,
    GuardAction,
    GuardFinding,
    Guards,
    GuardsConfig,
    list_limits,
)
from groundstation.core.safety.geofence import BoxFence
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import Motion, Vehicle
from groundstation.settings import Config
from links.core import Command, LinkStatus

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
    motion = motion._replace(**changed(*Motion._fields))
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
