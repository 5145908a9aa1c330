"""Station, bridge and vehicle as three programs: the paper's two computers, here on one."""

import re
import signal
import socket
from pathlib import Path

import pytest

from groundstation.__main__ import main
from tests.e2e.stations import (
    QUICK_LANDING,
    beside,
    free_udp_port,
    line_of,
    program,
    run_command,
    run_here,
    serving,
)

STATION = """
[link]
kind = "rf_bridge"
remote = "127.0.0.1:{port}"
key_file = "{folder}/bridge.key"
connect_timeout_s = 10.0
[flight]
start = "air"
idle_thrust = 0.6
floor_z_m = 1.0
duration_s = 0.5
[status]
path = "{folder}/status.sock"
"""
BRIDGE = """
listen = "127.0.0.1:{port}"
key_file = "{folder}/bridge.key"
[link]
kind = "dsm"
map = {{ arm = {{ channel = 5 }} }}
"""


def write_both(folder: Path, port: int) -> None:
    for name, text in (("station.toml", STATION), ("bridge.toml", BRIDGE)):
        (folder / name).write_text(text.format(port=port, folder=folder))


def test_a_station_flies_the_vehicle_by_the_module_of_a_bridge(tmp_path: Path) -> None:
    port, poses = free_udp_port(), f"--set=pose.listen=127.0.0.1:{free_udp_port()}"
    write_both(tmp_path, port)
    assert run_here(main, "radio", "bridge", "--make-key", tmp_path / "bridge.key").returncode == 0
    with serving("--link", "dsm", poses, "--duration", "60") as says:
        module = says.split(" receiver on ")[1].split(",")[0]
        simulated = (f"--set=link.port={module}", "--set=link.simulated=true")
        with beside(
            program("groundstation", "radio", "bridge", tmp_path / "bridge.toml", *simulated)
        ) as bridge:
            assert f"dsm module on {module}" in line_of(bridge)
            words = ("fly", f"{tmp_path}/station.toml", "--arm", "mqx", poses, *QUICK_LANDING)
            flown = run_command(program("groundstation", *words))
            assert flown.returncode == 0, flown.stdout + flown.stderr
            assert "landed and disarmed" in flown.stdout
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
                stranger.sendto(b"noise", ("127.0.0.1", port))
            bridge.send_signal(signal.SIGINT)
            out, _ = bridge.communicate(timeout=60)
            assert bridge.returncode == 0
    for told in ("commands", "the vehicle is armed", "the vehicle is disarmed", "leaves", "ending"):
        assert told in out
    assert re.search("datagrams dropped: .*'not_ours': 1", out)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("radio bridge bridge.toml --set link.port=/dev/pts/0", "key_file: cannot read"),
        ("fly station.toml --arm mqx", "link.key_file: cannot read"),
        ("radio bridge", "expected a configuration"),
    ],
)
def test_without_its_key_nothing_starts(
    words: str, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_both(tmp_path, 14600)
    monkeypatch.chdir(tmp_path)
    done = run_here(main, *words.split())
    assert (done.returncode, says in done.stderr) == (2, True), done.stderr
