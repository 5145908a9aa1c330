"""Rehearsal at the desk: ``serve --config`` plays a file's other side, ``--rehearse`` flies."""

import json
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from groundstation.config import from_dict
from groundstation.settings import Config, rehearse
from sim.__main__ import main
from tests.e2e.stations import EXAMPLE, beside, line_of, program, run_command, run_here, serving

ROOM: dict[str, Any] = {
    "vehicle": {"name": "quad"},
    "trajectory": {"kind": "hold", "position_ned": [0.0, 0.0, -0.4]},
    "takeoff": {"height_m": 0.4, "hold_s": 1.0, "climb_m_s": 1.0, "spool_s": 0.3},
    "flight": {"descent_m_s": 1.0, "duration_s": 1.0},
    "fence": {"kind": "box", "north_m": [-2, 2], "east_m": [-2, 2], "height_m": 2.5},
    "limits": {"max_speed_m_s": 1.0},
}
VICON = {"kind": "vicon", "listen": "192.0.2.2:51001"}
UDP = {"pose": VICON, "link": {"listen": "192.0.2.3:14540"}}
SERVER = {"server": "192.0.2.1:1510", "interface": "192.0.2.2", "multicast": True}
PORT = {"serial": "/dev/serial/by-id/usb-telemetry", "baud": 57600, "period_s": 0.04}
SERIAL = {"pose": {"kind": "natnet", **SERVER}, "link": {"kind": "mavlink", **PORT}}
TCP = {
    "pose": {"kind": "qualisys", "server": "192.0.2.1:22223"},
    "link": {"kind": "mavlink", "tcp": "192.0.2.3:5760"},
}
RADIO = {"pose": VICON, "link": {"kind": "dsm", "port": "/dev/ttyUSB0"}}


def environment(folder: Path) -> dict[str, str]:
    """Sockets, pseudo-terminals and recordings of this test alone."""
    run = folder / "run"
    run.mkdir(mode=0o700, exist_ok=True)
    return {**os.environ, "XDG_RUNTIME_DIR": str(run), "XDG_STATE_HOME": str(folder / "state")}


def write_room(folder: Path, ends: dict[str, Any]) -> Path:
    file = folder / "my_room.toml"
    file.write_text(tomli_w.dumps({**ROOM, **ends}), "utf-8")
    return file


@contextmanager
def played(file: Path) -> Iterator[str]:
    """The other side of ``file``, for as long as this lasts; gives what it says."""
    with serving("--config", file, "--duration", "100", env=environment(file.parent)) as says:
        yield says


def station(file: Path, command: str, *more: str) -> "subprocess.CompletedProcess[str]":
    words = program("groundstation", command, "--rehearse", file, *more)
    return run_command(words, env=environment(file.parent))


@pytest.mark.tried(1)  # wires
@pytest.mark.parametrize("ends", [SERIAL, TCP, RADIO], ids=["serial", "tcp", "radio"])
def test_the_checks_of_a_room_pass_at_the_desk_by_each_kind_of_wire(
    tmp_path: Path, ends: dict[str, Any]
) -> None:
    file = write_room(tmp_path, ends)
    with played(file) as says:
        assert "for --rehearse" in says
        done = station(file, "check", "--json")
    assert done.stderr.startswith("REHEARSAL of quad: nothing real is reached or moves")
    facts = json.loads(done.stdout)
    bad = [check for check in facts["checks"] if check["verdict"] == "FAIL"]
    assert facts["pass"] and not bad and done.returncode == 0
    (proof,) = (check for check in facts["checks"] if check["name"] == "props-off test")
    assert proof["verdict"] == "OFF"  # there are no propellers, whatever the wire is
    # Nobody wrote `link.simulated`.
    assert "simulated" not in {check["name"] for check in facts["checks"]}


def test_every_line_of_a_rehearsed_fleet_says_that_it_is_one(short_path: Path) -> None:
    file = short_path / "fleet.toml"
    for name in ("fleet.toml", "fleet-lab.toml"):
        (short_path / name).write_bytes((EXAMPLE.parent / name).read_bytes())
    words = program("groundstation", "fleet", "--rehearse", file)
    said: list[str] = []
    with (
        played(file),
        beside(words, stderr=subprocess.STDOUT, env=environment(short_path)) as flying,
    ):
        while line := line_of(flying):
            said.append(line)
            if "waiting on the ground" in line and "waiting on the ground" in "".join(said[:-1]):
                flying.terminate()  # both cores have spoken
        assert flying.wait(60) == 0, "".join(said)
    for name in ("ant", "bee"):
        assert any(f"rehearsal-{name} | " in line for line in said)
    assert [line for line in said if not line.startswith("REHEARSAL ")] == []


def test_what_the_other_side_plays_is_what_the_station_looks_for(tmp_path: Path) -> None:
    file = write_room(tmp_path, UDP)
    config = rehearse(from_dict({**ROOM, **UDP}, Config), file)
    with played(file) as says:
        assert f"udp {getattr(config.link, 'address', '')}" in says
        assert f"poses to udp {getattr(config.pose, 'listen', '')}" in says
        words = program("sim", "serve", "--config", file, "--duration", "5")
        twice = run_command(words, env=environment(tmp_path))
    assert twice.returncode == 2 and "another `groundstation-sim serve`" in twice.stderr


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--wrong", "yaw=5"], "`--set sim.tracker_yaw_deg=5` turns the tracker's north"),
        (["--gcs"], "unrecognized arguments: --gcs"),
        (["--floor"], "--floor: it has no effect beside --config"),
        (["--source", "natnet"], "--source: it has no effect beside --config"),
        (["--fleet", "fleet.toml"], "`serve --config FLEET.toml` plays the fleet"),
    ],
)
def test_what_can_not_be_rehearsed_is_a_sentence(
    tmp_path: Path, words: list[str], says: str
) -> None:
    done = run_here(main, "serve", "--config", write_room(tmp_path, UDP), "--duration", "1", *words)
    assert done.returncode == 2 and says in done.stderr
