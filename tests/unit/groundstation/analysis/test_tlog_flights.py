"""groundstation/analysis/evidence on made-up flights as a .tlog, of which everything is known."""

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, strategies as st

from groundstation.analysis.evidence.evidence import describe_flight, examine_flight
from tests.tlog_flight import Flight

NO_LAG = ("vehicle.thrust_lag_s=0.0", "vehicle.rate_lag_s=0.0")


def examined(flight: Flight, folder: Path) -> dict[str, Any]:
    file = folder / "flight.tlog"
    file.write_bytes(flight.tlog())
    return examine_flight(file, None, NO_LAG)


def test_stamps_that_repeat_or_run_back_are_counted(tmp_path: Path) -> None:
    found = examined(Flight(stamp_us=lambda us: us - 40_000 if us and us % 100_000 == 0 else us), tmp_path)
    assert found["left_out"] == {"out_of_order": 109}
    again = examined(Flight(stamp_us=lambda us: us - 20_000 if us == 4_000_000 else us), tmp_path)
    assert again["left_out"] == {"same_stamp": 1}


def test_an_outage_is_the_longest_gap(tmp_path: Path) -> None:
    found = examined(Flight(poses=lambda t: not 4.0 < t < 4.35), tmp_path)
    assert found["gap_max_ms"] == pytest.approx(350.0, abs=21.0)


def test_a_jump_with_a_reset_is_not_taken_for_motion(tmp_path: Path) -> None:
    usual = examined(Flight(), tmp_path)
    told = examined(Flight(moved=lambda t: (3.0, 7) if t >= 5.0 else (0.0, 6)), tmp_path)
    assert told["prediction"]["60"]["rms_mm"] < 1.5 * usual["prediction"]["60"]["rms_mm"]


@pytest.mark.parametrize("error", [0.05, 0.5])
def test_an_autopilot_whose_velocity_is_not_that_of_its_positions_is_found_out(tmp_path: Path, error: float) -> None:
    found = examined(Flight(velocity_error=(0.0, error, 0.0)), tmp_path)
    assert found["velocity_off_m_s"] == pytest.approx(error, abs=0.01)
    assert f"its own velocity is {found['velocity_off_m_s']:.3f} m/s RMS from" in describe_flight(found)


SHORT = Flight(duration_s=2.0).tlog()


@given(st.data())
def test_no_damage_to_a_file_makes_a_replay_fail(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    damaged = bytearray(SHORT)
    for _ in range(data.draw(st.integers(1, 20))):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    file = tmp_path_factory.mktemp("damaged") / "flight.tlog"
    file.write_bytes(damaged[: data.draw(st.integers(3 * len(damaged) // 4, len(damaged)))])
    found = examine_flight(file)
    json.dumps(found, allow_nan=False)
    assert describe_flight(found)
