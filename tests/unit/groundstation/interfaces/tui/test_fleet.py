"""What a fleet view knows of each vehicle, and how it says so."""

import msgspec
import pytest

from groundstation.interfaces.tui.fleet import (
    SILENCE_S,
    FleetMonitor,
    VehicleView,
    fleet_headline,
    fleet_row,
    fleet_rows,
)
from tests.sample_flight import sample


def heard(
    fleet: FleetMonitor, name: str, *, state: str = "tracking", now_s: float = 0.0, station_s: float = 0.0
) -> VehicleView:
    snapshot = msgspec.structs.replace(sample(station_s, vehicle=name), state=state)
    fleet.hear(f"lab/{name}/state", state.encode(), now_s)
    fleet.hear(f"lab/{name}/snapshot", msgspec.json.encode(snapshot), now_s)
    return next(seen for seen in fleet if seen.name == name)


def test_a_vehicle_appears_with_its_first_word_and_its_snapshot_follows() -> None:
    fleet = FleetMonitor("lab")
    fleet.hear("lab/mqx/state", b"ready", 0.0)
    (seen,) = fleet
    assert fleet_row(seen, 0.0).cells[:3] == ("mqx", "!!NO DATA", "-")
    heard(fleet, "mqx")
    assert fleet_row(seen, 0.5).cells == (
        "mqx", "▲ TRACKING", "0.01s", f"{sample(0.0).error_m:.2f}m", "0.62m", "-", "armed", "0.50s",
        "tracking: following the trajectory",
    )  # fmt: skip


def word(seen: VehicleView, now_s: float) -> str:
    return seen.headline(now_s).big.upper()


def test_silence_is_an_alarm_unless_the_flight_has_ended_or_its_station_has_said_goodbye() -> None:
    fleet = FleetMonitor("lab")
    silent, landed, away = (heard(fleet, name, state=state) for name, state in
                            (("a", "hold"), ("b", "landed"), ("c", "landed")))  # fmt: skip
    fleet.hear("lab/c/state", b"offline", 0.1)
    late_s = SILENCE_S + 0.1
    assert [word(one, late_s) for one in (silent, landed, away)] == ["NO DATA", "LANDED", "OFFLINE"]
    assert [fleet_row(one, late_s).urgency for one in (silent, landed, away)] == [0, 2, 3]
    assert fleet_row(silent, 0.0).urgency == 1


def test_a_vehicle_whose_snapshots_come_is_not_offline() -> None:
    """The last will of an earlier connection says so, until the station publishes its state again."""
    fleet = FleetMonitor("lab")
    seen = heard(fleet, "mqx")
    fleet.hear("lab/mqx/state", b"offline", 0.5)
    assert word(seen, 0.5) == "OFFLINE"
    fleet.hear("lab/mqx/snapshot", msgspec.json.encode(sample(1.0)), 1.0)
    assert word(seen, 1.0) == "TRACKING"


@pytest.mark.parametrize(
    ("topic", "payload"),
    [
        ("lab/mqx/snapshot", b"{}"),
        ("lab/mqx/snapshot", b"\xff"),
        ("lab/mqx/snapshot", b'{}, "hello": {}'),
        ("lab/mqx/event", b"[]"),
        ("lab/mqx/state", b"\xff"),
        ("lab/mqx/other", b""),
        ("lab/m q x/state", b"ready"),
        ("other/mqx/state", b"ready"),
        ("lab", b""),
    ],
)
def test_what_is_not_understood_is_dropped(topic: str, payload: bytes) -> None:
    fleet = FleetMonitor("lab")
    fleet.hear(topic, payload, 0.0)
    assert all(seen.snapshot is None and seen.events == [] and not seen.offline for seen in fleet)


def test_what_needs_somebody_comes_first() -> None:
    fleet = FleetMonitor("lab")
    for name, state in (("a", "ready"), ("b", "ready"), ("c", "tracking"), ("d", "aborted"), ("e", "hold")):
        heard(fleet, name, state=state)
    fleet.hear("lab/a/state", b"offline", 0.0)
    shown = fleet_rows(fleet, 0.0)
    assert [one.name for one in shown] == ["d", "c", "e", "b", "a"]
    assert fleet_headline(shown, "").big == "1 ALARM"
    assert fleet_headline(shown, "").detail == "1 alarm, 2 flying, 1 on ground, 1 offline"
    assert fleet_headline(shown, "refused").big == "NO BROKER"
    assert fleet_headline([], "").big == "NO VEHICLE"
