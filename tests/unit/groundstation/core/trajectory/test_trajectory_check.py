"""The look at a trajectory before take-off: its figures by hand, and what it refuses."""

import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given, strategies as st

from groundstation.__main__ import main
from groundstation.config import from_dict
from groundstation.core.geometry import ZERO, Quat, Vec3, add_scaled, scale, so3
from groundstation.core.trajectory import (
    Demand,
    FeasibilityReport,
    Reference,
    Trajectory,
    check_feasibility,
)
from groundstation.core.trajectory.feasibility import PathMotion, compute_demand
from groundstation.core.trajectory.shapes import CircleConfig, HoldConfig
from groundstation.core.vehicle import LimitsConfig, Vehicle
from groundstation.flight.preflight import (
    describe_trajectory,
    examine_trajectory,
    explain_fence,
    explain_refusal,
)
from groundstation.settings import Config
from tests.e2e.stations import run_here

G = 9.81
pushes = st.tuples(*[st.floats(-6.0, 6.0)] * 3)


def report(trajectory: Trajectory, floor_z_m: float = 1.0) -> FeasibilityReport:
    return check_feasibility(trajectory, Vehicle(), LimitsConfig(), gravity=G, floor_z_m=floor_z_m)


def demanded(trajectory: Trajectory) -> tuple[FeasibilityReport, dict[str, Demand]]:
    found = report(trajectory, floor_z_m=0.0)
    return found, {("least " if d.least else "") + d.name: d for d in found.demands}


def test_a_hold_needs_its_weight_and_nothing_else() -> None:
    found, by_name = demanded(HoldConfig(position_ned=(1.0, 2.0, -1.5)).build())
    assert found.ok
    assert (found.duration_s, found.span_s) == (None, 0.0)
    assert (found.length_m, found.share) == (0.0, 1.0)
    assert by_name["least height above the floor"].value == 1.5
    assert by_name["thrust"].value == by_name["least thrust"].value == pytest.approx(0.08 * G)
    assert by_name["tilt"].value == by_name["roll rate"].value == by_name["yaw rate"].value == 0.0


def test_a_level_circle_needs_what_a_circle_needs() -> None:
    found, by_name = demanded(CircleConfig(radius_m=2.0, speed_m_s=3.0).build())
    inward = 9.0 / 2.0
    assert found.span_s == pytest.approx(2.0 * math.pi * 2.0 / 3.0)
    assert found.length_m == pytest.approx(4.0 * math.pi)
    assert found.lowest_ned == pytest.approx((-2.0, -2.0, -1.0), abs=1e-3)
    assert found.highest_ned == pytest.approx((2.0, 2.0, -1.0), abs=1e-3)
    assert found.start_speed_m_s == pytest.approx(3.0)
    assert by_name["acceleration"].value == pytest.approx(inward)
    assert by_name["tilt"].value == pytest.approx(math.degrees(math.atan2(inward, G)))
    assert by_name["thrust"].value == pytest.approx(0.08 * math.hypot(inward, G))
    # The lean goes round once a turn, so it turns at V/r times the sine of the tilt.
    turn = math.degrees(1.5 * inward / math.hypot(inward, G))
    assert by_name["roll rate"].value == pytest.approx(turn, rel=1e-3)
    assert by_name["pitch rate"].value == pytest.approx(turn, rel=1e-2)


def test_an_upright_circle_is_lightest_at_its_top_and_heaviest_at_its_bottom() -> None:
    upright = CircleConfig(radius_m=1.0, speed_m_s=2.0, altitude_m=2.0, tilt_deg=90.0)
    _, by_name = demanded(upright.build())
    assert by_name["thrust"].value == pytest.approx(0.08 * (G + 4.0), rel=1e-4)
    assert by_name["least thrust"].value == pytest.approx(0.08 * (G - 4.0), rel=1e-4)
    # It starts at the top, north being uphill.
    assert by_name["least thrust"].time_s == pytest.approx(0.0)
    assert by_name["least height above the floor"].value == pytest.approx(1.0, abs=1e-4)


CIRCLE = "trajectory.kind=circle"
UPRIGHT = f"{CIRCLE} trajectory.altitude_m=3 trajectory.tilt_deg=90"
REFUSED = [
    ("trajectory.speed_m_s=1.5 limits.max_tilt_deg=25",
     "at 0.00 s it needs 34.5 deg of tilt, limit 25 deg (limits.max_tilt_deg): "
     "slow it down to about 1.234 m/s (trajectory.speed_m_s)"),
    (f"{CIRCLE} trajectory.speed_m_s=2 limits.max_speed_m_s=1",
     "m/s of speed, limit 1 m/s (limits.max_speed_m_s): slow it down to about 0.999 m/s "),
    (f"{CIRCLE} trajectory.speed_m_s=2 limits.max_acceleration_m_s2=1",
     "m/s² of acceleration, limit 1 m/s² (limits.max_acceleration_m_s2): slow it down to "
     "about 0.999 m/s"),
    (f"{UPRIGHT} trajectory.speed_m_s=2.5 limits.reserve=0.2 vehicle.thrust_max_n=1.5 "
     "vehicle.thrust_min_n=0.2",
     "N of thrust, limit 1.24 N (vehicle.thrust_max_n and limits.reserve): slow it down to"),
    (f"{UPRIGHT} trajectory.speed_m_s=2.8 limits.max_tilt_deg=60 vehicle.thrust_max_n=3",
     "N of thrust, at least 0.318 N (vehicle.thrust_min_n and limits.reserve): slow it down to"),
    ("trajectory.speed_m_s=1.5 vehicle.rate_limits_deg_s=[100,300,300]",
     "deg/s of roll rate, limit 90 deg/s (vehicle.rate_limits_deg_s and limits.reserve): slow it"),
    ("trajectory.kind=hold vehicle.thrust_max_n=0.7",
     "at 0.00 s it needs 0.785 N of thrust, limit 0.632 N (vehicle.thrust_max_n and "
     "limits.reserve): flying it slower does not help"),
    ("trajectory.kind=hold trajectory.position_ned=[0,0,1]",
     "at 0.00 s it is 1.00 m below the floor (flight.floor_z_m): in NED z counts down, so 1 m up"),
]  # fmt: skip


@pytest.mark.parametrize(("overrides", "words"), REFUSED, ids=[words for _, words in REFUSED])
def test_what_asks_too_much_is_refused_with_the_time_the_limit_and_a_way_out(
    overrides: str, words: str
) -> None:
    config = from_dict({}, Config, ["flight.floor_z_m=0", *overrides.split()])
    report = examine_trajectory(config)
    assert not report.ok
    assert words in str(explain_refusal(config, report))


def test_the_command_says_pass_or_fail_and_by_its_exit_code_too(tmp_path: Path) -> None:
    done = run_here(main, "trajectory")
    assert done.returncode == 0 and done.stdout.endswith("PASS\n")
    slow = ("trajectory", "--set", "limits.max_speed_m_s=0.4")
    done, told = run_here(main, *slow), run_here(main, *slow, "--json")
    assert (done.returncode, told.returncode) == (1, 1)
    assert "FAIL: at " in done.stdout
    facts = json.loads(told.stdout)
    assert (facts["kind"], facts["vehicle"]) == ("lemniscate", "mqx")
    assert (facts["pass"], facts["duration_s"]) == (False, None)
    assert [d["name"] for d in facts["demands"] if not d["ok"]] == ["speed"]
    path = tmp_path / "fast.toml"
    path.write_text("[trajectory]\nkind = 'lemniscate'\nspeed_m_s = 3.0\n")
    for command in ("fly", "daemon"):
        done = run_here(main, command, path)
        assert done.returncode == 2 and "groundstation: trajectory: at " in done.stderr


RADIUS_M = 2.0


class Curve:
    """A circle at a speed, of which something is changed."""

    duration_s: float | None = None

    def __init__(self, change: "Change", speed_m_s: float = 1.5) -> None:
        self._change = change
        self._rad_s = speed_m_s / RADIUS_M
        self.joints_s: Sequence[float] = (0.0, math.tau / self._rad_s)

    def at(self, time_s: float) -> Reference:
        w = self._rad_s
        c, s = RADIUS_M * math.cos(w * time_s), RADIUS_M * math.sin(w * time_s)
        exact = Reference(
            (c, s, -1.5),
            (-w * s, w * c, 0.0),
            (-w * w * c, -w * w * s, 0.0),
            (w**3 * s, -(w**3) * c, 0.0),
            yaw_rad=w * time_s,
            yaw_rate_rad_s=w,
        )
        return self._change(exact, time_s)

    def position_at(self, time_s: float) -> Vec3:
        return self.at(time_s).position_ned


Change = Callable[[Reference, float], Reference]


def replace(**changes: Any) -> Change:
    return lambda exact, time_s: msgspec.structs.replace(exact, **changes)


def scaled(name: str, share: float) -> Change:
    def change(exact: Reference, time_s: float) -> Reference:
        x, y, z = getattr(exact, name)
        return msgspec.structs.replace(exact, **{name: (share * x, share * y, share * z)})

    return change


def rest_for_a_moment(exact: Reference, time_s: float) -> Reference:
    return replace(velocity_ned=ZERO)(exact, time_s) if 3.0 < time_s < 3.5 else exact


LIES: dict[str, tuple[Change, str]] = {
    "too slow": (scaled("velocity_ned", 0.86), "velocity"),
    "twice": (scaled("acceleration_ned", 2.0), "acceleration"),
    "for half a second": (rest_for_a_moment, "velocity"),
}

AT_REST = Reference((0.0, 0.0, -1.5))
# By so much it differs at rest: from when on [s], by how much, and the name of the fault.
LARGEST = [
    ("velocity_ned", 0.0, 0.05 / 0.9, "velocity"),
    ("acceleration_ned", 0.0, 0.3 / 0.9, "acceleration"),
    ("jerk_ned", 0.0, 5.0 / 0.9, "jerk"),
    ("yaw_rate_rad_s", 0.0, 0.1 / 0.9, "yaw rate"),
    ("position_ned", 0.5, 0.01 + 1.1 * 0.01**2, "velocity"),
    ("velocity_ned", 0.5, 0.05, "acceleration"),
    ("yaw_rad", 0.5, 0.02 + 1.1 * 0.01**2, "yaw rate"),
    ("position_ned", 2.0, 0.05, "period"),  # after its first turn
]


@pytest.mark.parametrize(("changed", "since_s", "most", "name"), LARGEST)
def test_no_more_than_rounding_is_taken_for_rounding(
    changed: str, since_s: float, most: float, name: str
) -> None:
    def fault(size: float) -> str:
        at_rest = getattr(AT_REST, changed)
        value = (size, *at_rest[1:]) if changed.endswith("ned") else size
        moved = msgspec.structs.replace(AT_REST, **{changed: value})
        curve = Curve(lambda exact, time_s: moved if time_s >= since_s else AT_REST, 12.0)
        odd = report(curve).inconsistency
        return "" if odd is None else odd.name

    assert (fault(0.997 * most), fault(1.003 * most)) == ("", name)


@pytest.mark.parametrize(("change", "name"), LIES.values(), ids=LIES)
def test_derivatives_that_positions_do_not_have_are_found(change: Change, name: str) -> None:
    found = report(Curve(change))
    assert found.inconsistency is not None
    assert found.inconsistency.name == name
    assert not found.ok


@pytest.mark.parametrize("speed_m_s", [0.2, 1.5, 6.0])
def test_exact_derivatives_are_found_to_be_so(speed_m_s: float) -> None:
    assert report(Curve(lambda exact, t: exact, speed_m_s)).inconsistency is None


def test_what_is_not_what_it_declares_in_a_later_turn_is_found() -> None:
    def later(exact: Reference, t: float) -> Reference:
        return replace(velocity_ned=ZERO)(exact, t) if t > 40.0 else exact

    odd = report(Curve(later)).inconsistency
    assert odd is not None
    assert (odd.name, odd.of) == ("velocity", "position")
    assert odd.time_s == pytest.approx(40.0, abs=0.4)


def test_what_never_ends_and_turns_in_more_than_a_minute_is_looked_at_beyond_it() -> None:
    def away(exact: Reference, t: float) -> Reference:
        return msgspec.structs.replace(exact, position_ned=(5.0, 0.0, -1.5)) if t > 75.1 else exact

    slow = Curve(away, 0.25)
    slow.joints_s = (0.0, 60.0)
    odd = report(slow).inconsistency
    assert odd is not None
    assert odd.name == "period"
    assert odd.time_s == pytest.approx(75.0, abs=0.4)


def test_a_fast_circle_at_rest_by_its_own_word_is_told_with_both_speeds() -> None:
    config = from_dict({"trajectory": {"kind": f"{__name__}:lie"}}, Config)
    told = explain_refusal(config, examine_trajectory(config))
    assert told is not None
    assert "its velocity is declared as 0 m/s, and by its position is 15 m/s" in told.text


def lie(options: dict[str, Any]) -> Curve:
    return Curve(replace(velocity_ned=ZERO, acceleration_ned=ZERO, jerk_ned=ZERO), 15.0)


POINTS = {"kind": "waypoints", "points_ned": [[0, 0, -1], [1, 0, -1], [1, 1, -1.5], [0, 0, -1]]}


@pytest.mark.parametrize(
    "trajectory",
    [
        {"kind": "lemniscate"},
        {"kind": "lemniscate", "ramp_s": 2.0, "laps": 3},
        {"kind": "circle"},
        {"kind": "hold"},
        {"kind": "excitation"},
        POINTS,
        {**POINTS, "times_s": [0, 4, 8, 12]},
    ],
)
def test_every_kind_that_comes_along_is_what_it_declares(trajectory: dict[str, Any]) -> None:
    config = from_dict({"trajectory": trajectory}, Config)
    assert examine_trajectory(config).inconsistency is None


def test_the_fence_counts_too() -> None:
    box = {"kind": "box", "north_m": [-3.0, 3.0], "east_m": [-3.0, 3.0], "height_m": 4.0}
    for half_m, fits in ((3.0, True), (1.0, False)):
        box |= {"north_m": [-half_m, half_m], "east_m": [-half_m, half_m]}
        config = from_dict({"trajectory": {"kind": "circle"}, "fence": box}, Config)
        told = explain_fence(config)
        assert (told is None) == fits
        assert fits or "could not brake within the fence" in str(told)
        assert ("PASS" in describe_trajectory(config, examine_trajectory(config))) == fits


def test_a_stop_at_the_end_of_a_straight_way_is_no_corner() -> None:
    straight = Curve(lambda exact, t: Reference((0.5 * t, 0.0, -1.5), (0.5, 0.0, 0.0)))
    straight.duration_s = straight.joints_s[-1]
    assert report(straight).inconsistency is None


@given(pushes, pushes, st.floats(-3.0, 3.0), st.floats(-2.0, 2.0))
def test_the_body_rates_are_those_of_the_attitude_that_the_motion_needs(
    acceleration: Vec3, jerk: Vec3, yaw: float, yaw_rate: float
) -> None:
    def attitude(time_s: float) -> Quat:
        x, y, z = add_scaled(acceleration, time_s, jerk)
        a, b, c = scale(1.0 / math.hypot(x, y, G - z), (-x, -y, G - z))
        heading = yaw + time_s * yaw_rate
        across = b * math.cos(heading) - a * math.sin(heading)
        pitch = math.atan2(a * math.cos(heading) + b * math.sin(heading), c)
        return so3.from_euler_zyx(-math.asin(across), pitch, heading)

    h = 1e-4
    turn = so3.turn_between(attitude(-h), attitude(h))
    found = compute_demand(PathMotion(ZERO, acceleration, jerk, yaw, yaw_rate), G)
    assert found.rates == pytest.approx(scale(math.degrees(0.5 / h), turn), abs=0.05)
