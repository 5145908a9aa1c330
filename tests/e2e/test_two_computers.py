"""Station, bridge and vehicle as three programs: the paper's two computers, here on one."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.e2e.stations import QUICK_LANDING, free_udp_port

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


@contextmanager
def program(*words: str) -> Iterator[subprocess.Popen[str]]:
    """A program that is ended when it is done with."""
    process = subprocess.Popen([sys.executable, "-m", *words], stdout=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def groundstation(*words: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-m", "groundstation", *words],
        capture_output=True,
        check=False,
        text=True,
        timeout=60,
        stdin=subprocess.DEVNULL,
    )


def test_a_station_flies_the_vehicle_by_the_module_of_a_bridge(tmp_path: Path) -> None:
    port, poses = free_udp_port(), f"pose.listen=127.0.0.1:{free_udp_port()}"
    for name, text in (("station.toml", STATION), ("bridge.toml", BRIDGE)):
        (tmp_path / name).write_text(text.format(port=port, folder=tmp_path))
    made = groundstation("radio", "bridge", "--make-key", str(tmp_path / "bridge.key"))
    assert made.returncode == 0, made.stderr
    with program("sim", "serve", "--link", "dsm", "--set", poses, "--duration", "60") as vehicle:
        assert vehicle.stdout is not None
        module = vehicle.stdout.readline().split(" receiver on ")[1].split(",")[0]
        simulated = ("--set", f"link.port={module}", "--set", "link.simulated=true")
        words = ("radio", "bridge", str(tmp_path / "bridge.toml"), *simulated)
        with program("groundstation", *words) as bridge:
            assert bridge.stdout is not None
            assert f"dsm module on {module}" in bridge.stdout.readline()
            flown = groundstation(
                *("fly", str(tmp_path / "station.toml"), "--arm", "mqx", "--set", poses, *QUICK_LANDING)
            )
            assert flown.returncode == 0, flown.stdout + flown.stderr
            assert "landed and disarmed" in flown.stdout
            bridge.send_signal(signal.SIGINT)
            out, _ = bridge.communicate(timeout=60)
            assert bridge.returncode == 0
    for words_ in ("commands", "the vehicle is armed", "the vehicle is disarmed", "leaves", "ending"):
        assert words_ in out


def test_without_its_key_nothing_starts(tmp_path: Path) -> None:
    for name, text in (("station.toml", STATION), ("bridge.toml", BRIDGE)):
        (tmp_path / name).write_text(text.format(port=14600, folder=tmp_path))
    bridge = groundstation("radio", "bridge", str(tmp_path / "bridge.toml"), "--set", "link.port=/dev/pts/0")
    assert (bridge.returncode, "key_file: cannot read" in bridge.stderr) == (2, True)
    station = groundstation("fly", str(tmp_path / "station.toml"), "--arm", "mqx")
    assert (station.returncode, "link.key_file: cannot read" in station.stderr) == (2, True)
    nothing = groundstation("radio", "bridge")
    assert (nothing.returncode, "expected a configuration" in nothing.stderr) == (2, True)
