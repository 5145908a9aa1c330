"""groundstation/shadow on made-up flights, of which everything is known."""

import math
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.analysis.evidence.shadow import ShadowReport, report
from groundstation.core.geometry import Vec3
from tests.shadow_flight import Flight

UNKNOWN: Vec3 = (math.nan, math.nan, math.nan)
NO_LAG = ("vehicle.thrust_lag_s=0.0", "vehicle.rate_lag_s=0.0")


def replayed(flight: Flight, folder: Path, *overrides: str) -> ShadowReport:
    file = folder / "flight.tlog"
    file.write_bytes(flight.tlog())
    return report(file, None, [*NO_LAG, *overrides])


def levels(found: ShadowReport) -> dict[str, str]:
    """The worst level of each thing looked at."""
    order = ["fine", "care", "bad"]
    worst: dict[str, str] = {}
    for check in found.checks:
        worst[check.about] = max(worst.get(check.about, "fine"), check.level, key=order.index)
    return worst


@pytest.mark.parametrize("error", [UNKNOWN, (0.0, 0.0, 0.0)], ids=["positions only", "velocity too"])
def test_along_a_path_flown_perfectly_the_shadow_asks_for_what_was_sent(tmp_path: Path, error: Vec3) -> None:
    found = replayed(Flight(velocity_error=error), tmp_path)
    assert found.verdict == "fit"
    assert (found.velocity_rms_m_s is None) == (error is UNKNOWN)
    assert found.velocity_path_rms_m_s is not None and found.velocity_path_rms_m_s < 0.03
    commands = found.commands
    assert commands is not None and commands.saturated_fraction == 0.0
    assert commands.thrust_n.difference_rms < 0.06  # it stood on the ground before, which held most of it
    for rate in (commands.roll_rate_rad_s, commands.pitch_rate_rad_s):
        assert rate.correlation is not None and rate.correlation > 0.99
        assert rate.difference_rms < 0.03


@pytest.mark.parametrize(("length_s", "level"), [(0.05, "fine"), (0.15, "care"), (0.35, "bad")])
def test_an_outage_is_judged_by_how_long_commands_may_rest_on_one_pose(
    tmp_path: Path, length_s: float, level: str
) -> None:
    found = replayed(Flight(poses=lambda t: not 4.0 < t < 4.0 + length_s), tmp_path)
    assert levels(found)["gaps"] == level
    assert found.gaps.count == (1 if length_s > 0.05 else 0)
    assert found.gaps.longest_s == pytest.approx(length_s, abs=0.021)
    assert found.gaps.limit_s == 0.25


def test_stamps_that_repeat_or_run_back_are_counted_and_judged(tmp_path: Path) -> None:
    found = replayed(Flight(stamp_us=lambda us: us - 40_000 if us and us % 100_000 == 0 else us), tmp_path)
    assert found.dropped == {"out_of_order": 109}
    assert levels(found)["stamps"] == "bad"
    again = replayed(Flight(stamp_us=lambda us: us - 20_000 if us == 4_000_000 else us), tmp_path)
    assert again.dropped == {"same_stamp": 1}
    assert levels(again)["stamps"] == "care"


@pytest.mark.parametrize(("metres", "level"), [(0.02, "care"), (0.5, "bad")])
def test_a_reset_in_flight_is_judged_by_how_far_it_moves_the_vehicle(tmp_path: Path, metres: float, level: str) -> None:
    found = replayed(Flight(moved=lambda t: (metres, 7) if t >= 5.0 else (0.0, 6)), tmp_path)
    assert found.resets == 1
    assert found.resets_in_flight[0].moved_m == pytest.approx(metres, abs=0.01)
    assert found.resets_in_flight[0].time_s == pytest.approx(5.0, abs=0.03)
    assert levels(found)["resets"] == level


@pytest.mark.parametrize("error", [UNKNOWN, (0.0, 0.0, 0.0)], ids=["positions only", "velocity too"])
def test_a_jump_with_a_reset_is_not_taken_for_motion(tmp_path: Path, error: Vec3) -> None:
    told = replayed(Flight(velocity_error=error, moved=lambda t: (3.0, 7) if t >= 5.0 else (0.0, 6)), tmp_path)
    not_told = replayed(Flight(velocity_error=error, moved=lambda t: (3.0, 6) if t >= 5.0 else (0.0, 6)), tmp_path)
    assert told.velocity_path_rms_m_s is not None and not_told.velocity_path_rms_m_s is not None
    assert told.velocity_path_rms_m_s < 0.1
    assert not_told.velocity_path_rms_m_s > 1.0
    assert told.commands is not None and told.commands.pitch_rate_rad_s.correlation is not None
    assert told.commands.pitch_rate_rad_s.correlation > 0.65  # an estimate that slides there turns the vehicle


@pytest.mark.parametrize(("error", "level"), [(0.05, "fine"), (0.2, "care"), (0.5, "bad")])
def test_an_autopilot_whose_velocity_is_not_that_of_its_positions_is_found_out(
    tmp_path: Path, error: float, level: str
) -> None:
    found = replayed(Flight(velocity_error=(0.0, error, 0.0)), tmp_path)
    assert found.own_velocity_path_rms_m_s == pytest.approx(error, abs=0.01)
    assert levels(found)["wander"] == level
    wander = next(check for check in found.checks if check.about == "wander")
    assert f"disagree by {error:.3f} m/s" in wander.text
    assert ("looks good on screen" in wander.text) == (level != "fine")
    # The estimate and the reference are of its velocity, whatever its positions do.
    assert found.velocity_rms_m_s is not None and found.velocity_rms_m_s < 0.1
    assert levels(found)["velocity"] == levels(found)["commands"] == "fine"


SHORT = Flight(duration_s=0.6).tlog()


@given(st.data())
def test_no_damage_to_a_file_makes_a_replay_fail(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    damaged = bytearray(SHORT)
    for _ in range(data.draw(st.integers(1, 20))):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    file = tmp_path_factory.mktemp("damaged") / "flight.tlog"
    file.write_bytes(damaged[: data.draw(st.integers(len(damaged) // 2, len(damaged)))])
    found = report(file)
    assert found.poses > 50
    assert all(math.isfinite(v) for v in (found.rate_hz or 0.0, found.innovation_rms_m or 0.0, found.flight_s))
    msgspec.json.encode(found)
