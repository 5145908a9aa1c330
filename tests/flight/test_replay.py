"""Replays: a recorded flight flown again to the last bit, and differences told."""

import itertools
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from groundstation.analysis import replay_command
from groundstation.analysis.replay import replay_facts
from groundstation.recording import Entry
from tests.recordings import recorded, rewrite


def edited(
    path: Path, target: Path, edit: Callable[[str, dict[str, Any]], dict[str, Any] | None]
) -> Path:
    """A copy of the recording, each message as ``edit`` returns it; None leaves it out."""

    def changed(entry: Entry) -> list[tuple[str, bytes]]:
        value = edit(entry.topic, entry.value())
        return [] if value is None else [(entry.topic, json.dumps(value).encode())]

    return rewrite(path, target, edit=changed)


@pytest.mark.tried(3)  # sources and links
@pytest.mark.parametrize(
    ("scenario", "overrides", "source"),
    [
        ("paper", (), "vicon"),
        ("storm", ("link.pace=poses",), "vicon"),
        ("paper", (), "odometry"),
        ("adverse", ("controller.composite=raw",), "vicon"),
        ("paper", ("controller.kind=pid",), "odometry"),
        ("paper", (), "natnet"),
        ("paper", (), "qualisys"),
        ("paper", ("sim.swap_s=0.1", "sim.mishap_period_s=2", "sim.other_bodies=2"), "json"),
    ],
)
def test_a_simulated_flight_is_flown_again_to_the_last_bit(
    scenario: str, overrides: tuple[str, ...], source: str
) -> None:
    path, _, _ = recorded(scenario, *overrides, source=source)
    facts = replay_facts(path)
    assert facts["first_difference"] is None
    assert facts["identical"] is True
    assert facts["commands"] > 300
    assert facts["poses"] > 300
    assert facts["idle_commands"] > 10
    assert facts["differing"] == {"pose": 0, "idle": 0, "command": 0}


def test_another_gain_shows_what_it_would_have_changed(capsys: pytest.CaptureFixture[str]) -> None:
    path, _, _ = recorded()
    assert replay_command(path, ["controller.k2=3"], as_json=True) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["identical"] is False
    assert facts["first_difference"]["what"] == "command"
    assert facts["first_difference"]["number"] == 0
    assert facts["differing"]["pose"] == 0, "the poses are as they were seen"
    thrust = facts["changes"]["thrust_n"]
    assert 0.001 < thrust["rms"] < 0.2
    # The vehicle obeyed what was recorded, and the estimator knows: the change does not pile up.
    assert thrust["replayed_mean"] == pytest.approx(thrust["recorded_mean"], abs=0.05)
    assert replay_command(path, ["controller.k2=3"], as_json=False) == 0
    assert "with controller.k2=3" in capsys.readouterr().out


def test_one_last_bit_of_one_command_is_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, _, _ = recorded()
    count = 0

    def edit(topic: str, value: dict[str, Any]) -> dict[str, Any]:
        nonlocal count
        if topic == "/command":
            if count == 123:
                value["rates_rad_s"]["y"] = math.nextafter(value["rates_rad_s"]["y"], 9.0)
            count += 1
        return value

    bad = edited(path, tmp_path / "bad.mcap", edit)
    facts = replay_facts(bad)
    assert facts["identical"] is False
    first = facts["first_difference"]
    assert (first["what"], first["number"], first["field"]) == ("command", 123, "rates_rad_s")
    assert facts["commands"] == count
    assert replay_command(bad, [], as_json=False) == 1
    assert "not identical" in capsys.readouterr().out


def test_a_datagram_that_is_missing_is_missed(tmp_path: Path) -> None:
    datagrams = itertools.count(1)

    def edit(topic: str, value: dict[str, Any]) -> dict[str, Any] | None:
        is_pose = topic == "/raw/received" and len(value["data"]) > 90
        return None if is_pose and next(datagrams) == 200 else value

    facts = replay_facts(edited(recorded()[0], tmp_path / "gap.mcap", edit))
    assert facts["identical"] is False
    assert facts["first_difference"]["what"] == "pose"


def test_records_that_the_recorder_left_out_are_never_called_identical(tmp_path: Path) -> None:
    path, _, _ = recorded()
    losses = iter([[("/lost", b'{"time_s": 1.0, "count": 7}')]])

    def with_loss(entry: Entry) -> list[tuple[str, bytes]]:
        lost = next(losses, []) if entry.topic == "/command" else []
        return [*lost, (entry.topic, entry.data)]

    assert replay_facts(rewrite(path, tmp_path / "same.mcap"))["identical"] is True
    facts = replay_facts(rewrite(path, tmp_path / "lacking.mcap", edit=with_loss))
    assert (facts["identical"], facts["lost"]) == (False, 7)


def test_a_recording_that_was_cut_off_is_flown_again_up_to_there(tmp_path: Path) -> None:
    path, _, _ = recorded()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[:-200_000])
    facts = replay_facts(cut)
    assert (facts["identical"], facts["whole"]) == (True, False)
    assert 0 < facts["commands"] < replay_facts(path)["commands"]


def test_a_change_that_a_replay_does_not_ask_for_is_told_of(
    capsys: pytest.CaptureFixture[str],
) -> None:
    path, _, _ = recorded()
    told = ["trajectory.altitude_m=2.5", "controller.k2=3"]
    assert replay_command(path, told, as_json=True) == 0
    assert json.loads(capsys.readouterr().out)["without_effect"] == told[:1]
    assert replay_command(path, told, as_json=False) == 0
    said = "trajectory.altitude_m=2.5: changes nothing here. The reference is the recorded"
    assert said in capsys.readouterr().out


def test_a_replay_opens_no_port_of_a_real_vehicle(monkeypatch: pytest.MonkeyPatch) -> None:
    path, _, _ = recorded(source="odometry")
    opened: list[str] = []
    monkeypatch.setattr("links.io.wires.open_port", lambda port, _: opened.append(port))
    facts = replay_facts(path, ["link.serial=/dev/ttyACM0"])
    assert opened == []
    assert facts["identical"] is False
    assert facts["first_difference"]["what"] == "pose"
    assert facts["unheard_wires"] == ["udp 127.0.0.1:14540"]
