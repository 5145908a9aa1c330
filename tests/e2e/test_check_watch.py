"""``groundstation check --watch`` as a user starts it, on real sockets."""

import json
import signal
import socket
import subprocess
from pathlib import Path

import pytest

from groundstation.__main__ import main
from tests.e2e.stations import beside, free_udp_port, program, run_here, wait_until


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    """A lab's file, whose poses come to an address that nobody sends to."""
    config = tmp_path / "lab.toml"
    config.write_text(f'[pose]\nlisten = "127.0.0.1:{free_udp_port()}"\n')
    return config


def port_of(lab: Path) -> int:
    return int(lab.read_text().rpartition(":")[2].strip().strip('"'))


def watch(lab: Path, *more: str) -> list[str | Path]:
    return ["check", lab, "--watch", *more]


def test_the_exit_code_says_that_no_pose_came(lab: Path) -> None:
    done = run_here(main, *watch(lab, "--seconds", "0.3", "--json"))
    assert done.returncode == 1, done.stderr
    assert json.loads(done.stdout)["ok"] is False


def test_a_taken_port_makes_one_object_too(lab: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", port_of(lab)))
        done = run_here(main, *watch(lab, "--json"))
    assert done.returncode == 3, done.stderr
    facts = json.loads(done.stdout)
    assert (facts["ok"], facts["source"]) == (False, "vicon")
    assert facts["error"] in done.stderr


def test_ctrl_c_ends_it_with_what_was_seen(lab: Path) -> None:
    with beside(program("groundstation", *watch(lab)), stderr=subprocess.PIPE) as process:
        listens = f":{port_of(lab):04X} "  # proc(5)
        wait_until(lambda: listens in Path("/proc/net/udp").read_text())
        process.send_signal(signal.SIGINT)
        out, errors = process.communicate(timeout=60)
    assert process.returncode == 1, errors
    assert "no pose yet" in out
