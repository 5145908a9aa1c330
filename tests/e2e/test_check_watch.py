"""``groundstation check --watch`` as a user starts it, on real sockets."""

import json
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.e2e.stations import free_udp_port


@pytest.fixture
def silent(tmp_path: Path) -> list[str]:
    """The command on an address that nobody sends to."""
    config = tmp_path / "lab.toml"
    config.write_text(f'[pose]\nlisten = "127.0.0.1:{free_udp_port()}"\n')
    return [sys.executable, "-m", "groundstation", "check", str(config), "--watch"]


def test_the_exit_code_says_that_no_pose_came(silent: list[str]) -> None:
    done = subprocess.run([*silent, "--seconds", "0.3", "--json"], capture_output=True, text=True, check=False)
    assert done.returncode == 1, done.stderr
    assert json.loads(done.stdout)["ok"] is False


def test_a_taken_port_makes_one_object_too(tmp_path: Path) -> None:
    config = tmp_path / "lab.toml"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        config.write_text(f'[pose]\nlisten = "127.0.0.1:{other.getsockname()[1]}"\n')
        done = subprocess.run(
            [sys.executable, "-m", "groundstation", "check", str(config), "--watch", "--json"],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
    assert done.returncode == 3, done.stderr
    facts = json.loads(done.stdout)
    assert (facts["ok"], facts["source"]) == (False, "vicon")
    assert facts["error"] in done.stderr


def await_listening(port: int) -> None:
    """Wait until a program on this machine has that UDP port (proc(5))."""
    until = time.monotonic() + 60.0
    while f":{port:04X} " not in Path("/proc/net/udp").read_text():
        assert time.monotonic() < until
        time.sleep(0.05)


def test_ctrl_c_ends_it_with_what_was_seen(silent: list[str]) -> None:
    process = subprocess.Popen(silent, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    await_listening(int(Path(silent[-2]).read_text().rpartition(":")[2].strip().strip('"')))
    process.send_signal(signal.SIGINT)
    out, errors = process.communicate(timeout=60)
    assert process.returncode == 1, errors
    assert "no pose yet" in out
