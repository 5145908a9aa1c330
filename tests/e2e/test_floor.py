"""From the floor and back in real time, over real sockets: the checks alone, then the flight."""

import json
import subprocess
import sys
from pathlib import Path

from tests.e2e.stations import Room

CONFIG = """
[link]
kind = "mavlink"
[fence]
kind = "box"
north_m = [-2.5, 2.5]
east_m = [-2.5, 2.5]
height_m = 2.6
[limits]
max_speed_m_s = 1.5
[takeoff]
height_m = 0.5
hold_s = 1.0
[trajectory]
kind = "hold"
position_ned = [0.7, -0.7, 0.4]
[flight]
floor_z_m = 1.0
duration_s = 0.5
"""


def groundstation(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "groundstation", *words],
        capture_output=True, text=True, timeout=60, check=False, stdin=subprocess.DEVNULL,
    )  # fmt: skip


def test_check_says_what_is_found_and_fly_takes_off_from_the_floor_and_lands_there(tmp_path: Path) -> None:
    room, config = Room(tmp_path), tmp_path / "floor.toml"
    config.write_text(CONFIG)
    words = [str(config), *room.wires, "--set", f"status.path={room.status_socket}"]
    server = subprocess.Popen(
        [sys.executable, "-m", "sim", "serve", "--floor", *room.wires, "--duration", "90"],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert server.stdout is not None
        assert "serving" in server.stdout.readline()
        checked = groundstation("check", *words, "--json")
        assert checked.returncode == 0, checked.stdout
        facts = json.loads(checked.stdout)
        assert facts["pass"] is True
        assert {one["verdict"] for one in facts["checks"]} <= {"OFF", "PASS", "WARN"}
        refused = groundstation("check", *words, "--set", "fence.height_m=0.4")
        assert refused.returncode == 1
        assert "FAIL ways in the fence" in refused.stdout
        assert refused.stdout.splitlines()[-1].startswith("NOT ready to fly")
        flown = groundstation("fly", *words, "--arm", "mqx")
        assert flown.returncode == 0, flown.stdout + flown.stderr
        for word in ("takeoff", "hold", "tracking", "returning", "landing", "landed and disarmed"):
            assert word in flown.stdout
    finally:
        server.terminate()
        server.wait(60)
        assert server.stdout is not None
        server.stdout.close()
