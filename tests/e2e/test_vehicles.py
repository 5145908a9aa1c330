"""Two vehicles as a user flies them: a core process each; one that dies takes nothing with it."""

import os
import re
import signal
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from tests.e2e.stations import beside, children_of, free_udp_port, program, serving, wait_until

LAB: dict[str, Any] = {
    "pose": {"kind": "vicon"},
    "trajectory": {"kind": "hold", "position_ned": [0.0, 0.0, 0.5]},
    "takeoff": {"height_m": 0.4, "hold_s": 1.0, "climb_m_s": 1.0, "spool_s": 0.3},
    "flight": {"floor_z_m": 1.0, "descent_m_s": 1.0},
}


def fleet_file(folder: Path, names: Sequence[str] = ("ant", "bee")) -> Path:
    pose = {**LAB["pose"], "listen": f"127.0.0.1:{free_udp_port()}"}
    lab = {**LAB, "pose": pose, "recording": {"folder": str(folder / "flights")}}
    (folder / "lab.toml").write_text(tomli_w.dumps(lab), "utf-8")
    vehicles = [
        {
            "name": name,
            "link": {"listen": f"127.0.0.1:{free_udp_port()}"},
            "status": {"path": str(folder / f"{name}.sock")},
            "trajectory": {"position_ned": [0.0, 2.0 * number, 0.5]},
        }
        for number, name in enumerate(names)
    ]
    relay_port = 20000 + free_udp_port() % 10000
    plan = {"config": "lab.toml", "relay_port": relay_port, "vehicles": vehicles}
    (folder / "fleet.toml").write_text(tomli_w.dumps(plan), "utf-8")
    return folder / "fleet.toml"


def find_core(supervisor: int, name: str) -> int | None:
    """The process that flies ``name``, by the file that it was given, once there is one."""
    for child in children_of(supervisor):
        if f"/{name}.toml".encode() in Path(f"/proc/{child}/cmdline").read_bytes():
            return child
    return None


def core_of(supervisor: int, name: str) -> int:
    core = find_core(supervisor, name)
    assert core is not None, f"{name} has no core"
    return core


def passes_on(process: int) -> bool:
    """Whether it passes signals on to its cores yet: SIGHUP is the last that it takes."""
    status = Path(f"/proc/{process}/status").read_text("utf-8")
    caught = re.search(r"^SigCgt:\s*(\w+)$", status, re.M)
    return caught is not None and bool(int(caught[1], 16) >> (signal.SIGHUP - 1) & 1)


def until(log: Path, pattern: str) -> None:
    wait_until(lambda: re.search(pattern, log.read_text("utf-8")), log.read_text)


@contextmanager
def rehearsal(
    folder: Path, *options: str, names: Sequence[str] = ("ant", "bee")
) -> Iterator[tuple["subprocess.Popen[str]", Path]]:
    """A simulated fleet, and the station that flies it: its process, and its log."""
    file, log = fleet_file(folder, names), folder / "log"
    words = program("groundstation", "fleet", "--rehearse", file, *options)
    with pytest.MonkeyPatch.context() as patched:
        for place in ("XDG_RUNTIME_DIR", "XDG_STATE_HOME"):
            patched.setenv(place, str(folder))
        with serving("--config", file, "--duration", "110"), started(words, log) as station:
            yield station, log


@contextmanager
def started(words: Sequence[str], log: Path) -> Iterator["subprocess.Popen[str]"]:
    """A process that writes its output to ``log``."""
    with (
        log.open("w") as said,
        beside(words, stdin=subprocess.DEVNULL, stdout=said, stderr=said) as station,
    ):
        yield station


def test_a_killed_core_takes_nothing_with_it_and_a_signal_lands_the_other(short_path: Path) -> None:
    with rehearsal(short_path, "--arm", "rehearsal") as (station, log):
        for name in ("ant", "bee"):
            until(log, rf"{name} +\| .* tracking: ")
        os.kill(core_of(station.pid, "rehearsal-ant"), signal.SIGKILL)
        until(log, r"ant: WARNING: its core has died \(SIGKILL\)")
        time.sleep(1.0)  # the other flies on meanwhile
        assert not re.search(r"bee +\| .* (landing|descent|aborted): ", log.read_text("utf-8"))
        station.send_signal(signal.SIGTERM)
        until(log, "SIGTERM: passed on to rehearsal-bee\n")
        until(log, r"bee +\| .* landed: landed and disarmed")
        assert station.wait(60) == 1  # one of them has died
        text = log.read_text("utf-8")
        assert "bee: its core has ended (0)" in text
        assert re.search(r"relay +\| relay: \d+ datagrams handed on to 2 cores", text)
        assert "relay has ended" not in text
        assert not list(short_path.rglob("rehearsal-bee.sock"))


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_fleet_that_is_ended_while_its_cores_start_ends_well(
    tmp_path: Path, number: signal.Signals
) -> None:
    log, words = tmp_path / "log", program("groundstation", "fleet", fleet_file(tmp_path))
    with started(words, log) as station:
        # From when its cores were started on, which takes them a while.
        wait_until(lambda: passes_on(station.pid))
        station.send_signal(number)
        code = station.wait(60)
    text = log.read_text("utf-8")
    assert code == 0 and text.count("its core has ended") == 2 and "died" not in text, text


def test_cores_and_relay_end_with_a_supervisor_that_is_killed(short_path: Path) -> None:
    """In the air each lands by the same signal: it is that of a terminal that closes."""
    with rehearsal(short_path) as (station, log):
        for name in ("ant", "bee"):
            until(log, rf"{name} +\| .* ready, and waiting on the ground")
        children = children_of(station.pid)
        assert len(children) == 3
        station.kill()
        station.wait(60)
        wait_until(lambda: not any(Path(f"/proc/{child}").exists() for child in children))
    assert not list(short_path.rglob("*.sock"))


def test_where_a_core_does_not_get_ready_the_others_tell_who_it_is(tmp_path: Path) -> None:
    file, log = fleet_file(tmp_path), tmp_path / "log"
    (tmp_path / "bee.sock").mkdir()  # so bee's core has no socket, and ends
    words = program("groundstation", "fleet", file, "--arm", "ant", "--arm", "bee")
    why = "nobody is armed: bee did not get ready"
    with started(words, log) as station:
        wait_until(lambda: find_core(station.pid, "ant"))
        ant = core_of(station.pid, "ant")
        os.kill(ant, signal.SIGSTOP)  # it starts more slowly than the other takes to fail
        until(log, why)
        os.kill(ant, signal.SIGCONT)
        assert station.wait(60) == 1
    assert re.search(rf"ant +\| .* aborted: ended before take-off: {why}", log.read_text())
