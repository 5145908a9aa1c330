"""The look at a trajectory before take-off: its figures by hand, and in which words it refuses."""

import json
import math
import sys
from pathlib import Path
from typing import Any

import msgspec
import pytest

from groundstation.__main__ import main
from groundstation.config import ConfigError, from_dict
from groundstation.core.trajectory import (
    Demand,
    FeasibilityReport,
    LemniscateConfig,
    TrajectoryConfig,
    check_feasibility,
)
from groundstation.core.trajectory.shapes import CircleConfig, HoldConfig
from groundstation.core.vehicle import LimitsConfig, Vehicle
from groundstation.flight.preflight import ensure_flyable
from groundstation.flight.preflight.configuration import explain_infeasibility
from groundstation.settings import Config

G = 9.81


def seen(
    trajectory: TrajectoryConfig, limits: LimitsConfig | None = None, vehicle: Vehicle | None = None
) -> tuple[FeasibilityReport, dict[str, Demand]]:
    report = check_feasibility(
        trajectory.build(), vehicle or Vehicle(), limits or LimitsConfig(), gravity=G, floor_z_m=0.0
    )
    return report, {("least " if d.least else "") + d.name: d for d in report.demands}


def test_a_hold_needs_its_weight_and_nothing_else() -> None:
    report, by_name = seen(HoldConfig(position_ned=(1.0, 2.0, -1.5)))
    assert report.ok
    assert (report.duration_s, report.span_s, report.length_m, report.share) == (None, 0.0, 0.0, 1.0)
    assert by_name["least height above the floor"].value == 1.5
    assert by_name["thrust"].value == by_name["least thrust"].value == pytest.approx(0.08 * G)
    assert by_name["tilt"].value == by_name["roll rate"].value == by_name["yaw rate"].value == 0.0


def test_a_level_circle_needs_what_a_circle_needs() -> None:
    report, by_name = seen(CircleConfig(radius_m=2.0, speed_m_s=3.0))
    inward = 9.0 / 2.0
    assert report.span_s == pytest.approx(2.0 * math.pi * 2.0 / 3.0)
    assert report.length_m == pytest.approx(4.0 * math.pi)
    assert report.lowest_ned == pytest.approx((-2.0, -2.0, -1.0), abs=1e-3)
    assert report.highest_ned == pytest.approx((2.0, 2.0, -1.0), abs=1e-3)
    assert report.start_speed_m_s == pytest.approx(3.0)
    assert by_name["acceleration"].value == pytest.approx(inward)
    assert by_name["tilt"].value == pytest.approx(math.degrees(math.atan2(inward, G)))
    assert by_name["thrust"].value == pytest.approx(0.08 * math.hypot(inward, G))
    # The lean goes round once a turn, so it turns at V/r times the sine of the tilt.
    turn = math.degrees(1.5 * inward / math.hypot(inward, G))
    assert by_name["roll rate"].value == pytest.approx(turn, rel=1e-3)
    assert by_name["pitch rate"].value == pytest.approx(turn, rel=1e-2)


def test_an_upright_circle_is_lightest_at_its_top_and_heaviest_at_its_bottom() -> None:
    _, by_name = seen(CircleConfig(radius_m=1.0, speed_m_s=2.0, altitude_m=2.0, tilt_deg=90.0))
    assert by_name["thrust"].value == pytest.approx(0.08 * (G + 4.0), rel=1e-4)
    assert by_name["least thrust"].value == pytest.approx(0.08 * (G - 4.0), rel=1e-4)
    # It starts at the top, north being uphill.
    assert by_name["least thrust"].time_s == pytest.approx(0.0)
    assert by_name["least height above the floor"].value == pytest.approx(1.0, abs=1e-4)


def limited(**values: Any) -> LimitsConfig:
    return msgspec.convert(values, LimitsConfig)


REFUSED: list[tuple[TrajectoryConfig, LimitsConfig, Vehicle, str]] = [
    (
        LemniscateConfig(speed_m_s=1.5),
        limited(max_tilt_deg=25.0),
        Vehicle(),
        "at 0.00 s it needs 34.5 deg of tilt, limit 25 deg (limits.max_tilt_deg): "
        "slow it down to about 1.234 m/s (trajectory.speed_m_s)",
    ),
    (
        CircleConfig(speed_m_s=2.0),
        limited(max_speed_m_s=1.0),
        Vehicle(),
        "m/s of speed, limit 1 m/s (limits.max_speed_m_s): slow it down to about 0.999 m/s (trajectory.speed_m_s)",
    ),
    (
        CircleConfig(speed_m_s=2.0),
        limited(max_acceleration_m_s2=1.0),
        Vehicle(),
        "m/s² of acceleration, limit 1 m/s² (limits.max_acceleration_m_s2): slow it down to about 0.999 m/s",
    ),
    (
        CircleConfig(speed_m_s=2.5, altitude_m=3.0, tilt_deg=90.0),
        limited(reserve=0.2),
        Vehicle(thrust_max_n=1.5, thrust_min_n=0.2),
        "N of thrust, limit 1.24 N (vehicle.thrust_max_n and limits.reserve): slow it down to",
    ),
    (
        CircleConfig(speed_m_s=2.8, altitude_m=3.0, tilt_deg=90.0),
        limited(max_tilt_deg=60.0),
        Vehicle(thrust_max_n=3.0),
        "N of thrust, at least 0.318 N (vehicle.thrust_min_n and limits.reserve): slow it down to",
    ),
    (
        LemniscateConfig(speed_m_s=1.5),
        limited(),
        Vehicle(rate_limits_deg_s=(100.0, 300.0, 300.0)),
        "deg/s of roll rate, limit 90 deg/s (vehicle.rate_limits_deg_s and limits.reserve): slow it down to",
    ),
    (
        HoldConfig(),
        limited(),
        Vehicle(thrust_max_n=0.7),
        "at 0.00 s it needs 0.785 N of thrust, limit 0.632 N (vehicle.thrust_max_n and limits.reserve): "
        "flying it slower does not help",
    ),
    (
        HoldConfig(position_ned=(0.0, 0.0, 1.0)),
        limited(),
        Vehicle(),
        "at 0.00 s it is 1.00 m below the floor (flight.floor_z_m): in NED z counts down, so 1 m up is -1",
    ),
]


@pytest.mark.parametrize(("trajectory", "limits", "vehicle", "words"), REFUSED, ids=[words for *_, words in REFUSED])
def test_what_asks_too_much_is_refused_with_the_time_the_limit_and_a_way_out(
    trajectory: TrajectoryConfig, limits: LimitsConfig, vehicle: Vehicle, words: str
) -> None:
    report, _ = seen(trajectory, limits, vehicle)
    assert not report.ok
    assert words in str(explain_infeasibility(report, getattr(trajectory, "speed_m_s", None)))


def test_no_flight_begins_with_what_is_refused() -> None:
    config = from_dict({"limits": {"max_speed_m_s": 0.4}}, Config)
    with pytest.raises(ConfigError, match=r"^trajectory: at .* s it needs 0\.5 m/s of speed, limit 0\.4 m/s"):
        ensure_flyable(config)


def run(monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    monkeypatch.setattr(sys, "argv", ["groundstation", *words])
    return main()


def test_the_command_says_pass_or_fail_and_by_its_exit_code_too(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert run(monkeypatch, "trajectory") == 0
    assert capsys.readouterr().out.endswith("PASS\n")
    assert run(monkeypatch, "trajectory", "--set", "limits.max_speed_m_s=0.4") == 1
    assert "FAIL: at " in capsys.readouterr().out
    assert run(monkeypatch, "trajectory", "--json", "--set", "limits.max_speed_m_s=0.4") == 1
    facts = json.loads(capsys.readouterr().out)
    assert (facts["kind"], facts["vehicle"], facts["pass"], facts["duration_s"]) == ("lemniscate", "mqx", False, None)
    assert [d["name"] for d in facts["demands"] if not d["ok"]] == ["speed"]
    path = tmp_path / "fast.toml"
    path.write_text("[trajectory]\nkind = 'lemniscate'\nspeed_m_s = 3.0\n")
    for command in (("fly", str(path)), ("daemon", str(path))):
        assert run(monkeypatch, *command) == 2
        assert "groundstation: trajectory: at " in capsys.readouterr().err
