"""The paper's flight over a radio module's port in real time: quantised channels, a pacer of its own, a real pty."""

import asyncio
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from groundstation.core.geometry import Vec3
from groundstation.core.mission import State
from groundstation.flight import make_flight
from links.rf import Channels, CrsfLinkConfig, DsmLinkConfig, RfFrame, Service
from sim.radio import PtyWire
from sim.runs import Stage
from sim.scenarios import SCENARIOS, prepare
from tests.e2e.stations import free_udp_port

EXAMPLE = Path(__file__).parents[2] / "examples" / "rf-dsm.toml"


async def flown(duration_s: float) -> list[tuple[float, float]]:
    """The true distance to the reference at every step of the plant [s, m]."""
    loop = asyncio.get_running_loop()
    wire = PtyWire()
    told = [f"link.port={wire.path}", "link.simulated=true", f"pose.listen=127.0.0.1:{free_udp_port()}"]
    world, config = prepare(SCENARIOS["paper"], told, link="dsm")
    assert isinstance(config.link, DsmLinkConfig)
    path: list[tuple[float, Vec3]] = []

    def step(time_s: float, position: Vec3) -> None:
        path.append((time_s, position))

    async def confirm() -> bool:
        return True

    stage = Stage(world, config, 0, step, pty=wire)
    stage.plant.advance(loop.time())  # it knows the virtual clock's zero only
    flight = make_flight(config, confirm=confirm)
    beside = asyncio.create_task(stage.run())
    flying = asyncio.create_task(flight.run())
    while (begun := flight.started_s) is None or loop.time() < begun + duration_s:
        assert not flying.done(), flying.result().reason
        await asyncio.sleep(0.05)
    assert flight.state is State.TRACKING
    flying.cancel()  # landing is the next test's
    beside.cancel()
    await asyncio.gather(flying, beside, return_exceptions=True)
    wire.close()
    reference = config.trajectory.build()
    errors = []
    for time_s, (x, y, z) in path:
        if begun <= time_s < begun + duration_s:
            a, b, c = reference.at(time_s - begun).position_ned
            errors.append((time_s - begun, ((x - a) ** 2 + (y - b) ** 2 + (z - c) ** 2) ** 0.5))
    return errors


def rms_cm(errors: list[tuple[float, float]], since_s: float) -> float:
    late = [error for time_s, error in errors if time_s >= since_s]
    return float(100.0 * (sum(e * e for e in late) / len(late)) ** 0.5)


def test_a_dsm_module_on_a_port_flies_the_paper_in_real_time() -> None:
    errors = asyncio.run(flown(6.0))
    # A shared machine delays poses and commands; the soak run holds it to the paper.
    assert rms_cm(errors, 4.0) < 5.0


@pytest.mark.soak
def test_a_minute_over_a_dsm_module_stays_within_a_centimetre() -> None:
    errors = asyncio.run(flown(60.0))
    assert rms_cm(errors, 15.0) < 1.0


@pytest.mark.tried(1)  # who dies first; test_pacer_standby.py kills either
@pytest.mark.parametrize("first", ["pacer", "stand-by"])
def test_a_flight_is_told_that_its_stand_by_is_gone_and_what_became_of_the_bring_down(
    first: str, tmp_path: Path
) -> None:
    listen = f"pose.listen=127.0.0.1:{free_udp_port()}"
    serve = (sys.executable, "-m", "sim", "serve", "--link", "dsm", "--set", listen, "--duration", "60")
    with subprocess.Popen(serve, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            port = server.stdout.readline().split(" receiver on ")[1].split(",")[0]
            sets = (listen, f"link.port={port}", "link.simulated=true", f"status.path={tmp_path}/status.sock")
            words = (word for each in sets for word in ("--set", each))
            fly = (sys.executable, "-m", "groundstation", "fly", str(EXAMPLE), "--arm", "mqx", *words)
            with subprocess.Popen(fly, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True) as flight:
                assert flight.stdout is not None
                said = ""
                while "tracking:" not in said:
                    line = flight.stdout.readline()
                    assert line, f"it ended before the figure: {said}"
                    said += line
                standby = next(child for child in _children(flight.pid) if "pacer_standby" in _command(child))
                (pacer,) = _children(standby)
                for process in (pacer, standby) if first == "pacer" else (standby, pacer):
                    os.kill(process, signal.SIGKILL)
                    if process == standby and first == "stand-by":
                        while "stand-by is gone" not in said:
                            line = flight.stdout.readline()
                            assert line, f"nothing was told: {said}"
                            said += line
                        time.sleep(1.0)  # it is told once
                    time.sleep(0.1)
                said += flight.communicate(timeout=60)[0]
                assert flight.returncode == 1
        finally:
            server.terminate()
    told = "warning: the pacer's stand-by is gone: should the pacer end too"
    assert said.count(told) == (1 if first == "stand-by" else 0), said
    assert ("its stand-by has taken over and brings down" in said) == (first == "pacer"), said
    assert "NOT brought down from here: the receiver's failsafe has to act: the pacer and its stand-by ended" in said
    assert "the bring-down is over" not in said


def _children(parent: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{parent}/task/{parent}/children").read_text().split()]


def _command(process: int) -> str:
    return Path(f"/proc/{process}/cmdline").read_text()


def test_fly_refuses_a_port_that_may_be_a_real_module(tmp_path: Path) -> None:
    run = subprocess.run(
        [sys.executable, "-m", "groundstation", "fly", str(EXAMPLE), "--arm", "mqx"],
        capture_output=True,
        check=False,
        text=True,
        timeout=60,
        stdin=subprocess.DEVNULL,
    )
    assert run.returncode == 2
    assert "fence: missing, and a real vehicle may fly here (link.port = /dev/ttyUSB0)" in run.stderr


@pytest.mark.parametrize(
    ("what", "kind", "code", "words"),
    [
        ("bind", "dsm", 0, "bind for 0.3 s, disarmed"),
        ("idle", "crsf", 0, "0 repeated"),
        ("range-check", "crsf", 1, "see its own menu"),
    ],
)
def test_the_radio_command_serves_a_module_and_arms_nothing(what: str, kind: str, code: int, words: str) -> None:
    config = DsmLinkConfig() if kind == "dsm" else CrsfLinkConfig()

    async def main() -> tuple[int, str, list[RfFrame]]:
        wire = PtyWire()
        came: list[bytes] = []
        wire.listen(came.append)
        config_ = ("--set", f"link.kind={kind}", "--set", f"link.port={wire.path}", "--seconds", "0.3")
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "groundstation", "radio", what, os.devnull, *config_),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )
        out, _ = await process.communicate()
        wire.close()
        return process.returncode or 0, out.decode(), config.codec().decoder().feed(b"".join(came))

    returned, out, heard = asyncio.run(main())
    assert (returned, words in out) == (code, True), out
    channels = Channels(config.map, count=config.codec().channels, thrust_max_n=1.0)
    frames = [each.positions for each in heard if each.positions is not None]
    assert not any(channels.read(positions).thrust_n > 0.0 for positions in frames)
    if what == "bind":
        assert sum(each.service is Service.BIND for each in heard) > 5
