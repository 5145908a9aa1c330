"""``groundstation stop-all``: real flights in real processes, one of which stands still."""

import asyncio
import os
import signal
import subprocess
from pathlib import Path

import pytest

from groundstation.core.messages import Ask
from groundstation.interfaces.api import stop_all as ask_all
from links.io import make_key
from tests.e2e.stations import (
    EXAMPLE,
    beside,
    free_udp_port,
    line_of,
    program,
    run_command,
    served,
    wait_until,
)
from tests.e2e.test_daemon import running
from tests.e2e.test_real_time import seen
from tests.e2e.test_vehicles import fleet_file, passes_on, started


def stop_all() -> "subprocess.CompletedProcess[str]":
    return run_command(program("groundstation", "stop-all"))


@pytest.fixture(autouse=True)
def _alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Only what this test starts is registered where it looks."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))


@pytest.mark.matrix  # unit/groundstation/interfaces/api/test_stop_all.py has either answer and none
def test_every_flight_lands_and_one_that_stands_still_is_told_in_time_and_lands_as_it_wakes(
    tmp_path: Path,
) -> None:
    # Their sockets are not where sockets are looked for.
    with (
        served() as north,
        served() as south,
        running(
            north, tmp_path / "ant", "--once", "--arm", "ant", "--set", "vehicle.name=ant"
        ) as ant,
        running(
            south, tmp_path / "bee", "--once", "--arm", "bee", "--set", "vehicle.name=bee"
        ) as bee,
    ):
        for room in (north, south):
            asyncio.run(seen(room.status_socket, lambda s: s.state == "tracking"))
        bee.process.send_signal(signal.SIGSTOP)
        stopped = stop_all()
        bee.process.send_signal(signal.SIGCONT)

        assert stopped.returncode == 1
        first, second = f"ant (process {ant.process.pid})", f"bee (process {bee.process.pid})"
        assert stopped.stdout.startswith(f"{first}: landing: stop-all (stop-all ")
        assert f"{second}: NOT ANSWERED: no answer within 1 s; SIGTERM sent" in stopped.stderr
        ant.says("landing: stop-all")
        ant.says("landed: ")
        assert ant.process.wait(60) == 0
        bee.says("SIGTERM: asked to land; once more: failsafe descent")
        bee.process.wait(60)

    nobody = stop_all()
    assert (nobody.returncode, nobody.stdout) == (0, "nothing flies here\n")


def test_a_bridge_goes_on_and_is_told_with_how_to_end_it(tmp_path: Path) -> None:
    config, port = tmp_path / "bridge.toml", tmp_path / "port"
    make_key(tmp_path / "key")
    master, slave = os.openpty()
    # The system's name for it is somebody else's soon.
    port.symlink_to(f"/proc/{os.getpid()}/fd/{slave}")
    link = f'[link]\nkind = "crsf"\nport = "{port}"\nsimulated = true\n'
    config.write_text(f'listen = "127.0.0.1:{free_udp_port()}"\nkey_file = "key"\n{link}')
    try:
        with beside(program("groundstation", "radio", "bridge", config)) as bridge:
            assert "radio bridge at udp" in line_of(bridge)
            told = stop_all()
            assert told.returncode == 0
            assert f"(process {bridge.pid}): goes on" in told.stdout
            assert f"kill -QUIT {bridge.pid} stops its motors" in told.stdout
            assert bridge.poll() is None
    finally:
        os.close(master)
        os.close(slave)


def test_a_fleet_that_only_starts_is_ended_before_it_arms(tmp_path: Path) -> None:
    words, log = program("groundstation", "fleet", fleet_file(tmp_path)), tmp_path / "log"
    with started([*words, "--arm", "ant", "--arm", "bee"], log) as station:
        wait_until(lambda: passes_on(station.pid))
        stopped = stop_all()
        station.wait(60)
    who = f"fleet of ant, bee (process {station.pid})"
    assert f"{who}: it was starting, and is ended before it arms" in stopped.stdout
    assert stopped.returncode == 0, stopped.stderr
    assert "SIGHUP: passed on to ant, bee" in log.read_text("utf-8")
    assert stop_all().stdout == "nothing flies here\n"


def test_a_flight_in_its_first_moments_is_ended_before_it_arms(tmp_path: Path) -> None:
    """A flight that only starts is in no register, so nobody can ask it or send it a signal."""
    words = program("groundstation", "fly", EXAMPLE, "--arm", "mqx")
    with started(words, tmp_path / "log") as flight:
        asyncio.run(ask_all(Ask.LAND))
        assert flight.wait(60) == 1
    said = (tmp_path / "log").read_text("utf-8")
    assert said.startswith("nothing is armed: all flights were ordered to land")
