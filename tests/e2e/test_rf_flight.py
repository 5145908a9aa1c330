"""The paper's flight over a radio module's port in real time: a pacer and a pty of its own."""

import asyncio
import os
import subprocess
import sys

import pytest

from groundstation.core.geometry import Vec3
from groundstation.core.mission import State
from groundstation.flight import make_flight
from links.rf import Channels, CrsfLinkConfig, DsmLinkConfig, RfFrame, Service
from sim.radio import PtyWire
from sim.runs import Stage, confirm_at
from sim.scenarios import SCENARIOS, prepare
from tests.e2e.stations import free_udp_port, serving


async def flown(duration_s: float) -> list[tuple[float, float]]:
    """The true distance to the reference at every step of the plant [s, m]."""
    loop = asyncio.get_running_loop()
    wire = PtyWire()
    poses = f"pose.listen=127.0.0.1:{free_udp_port()}"
    told = [f"link.port={wire.path}", "link.simulated=true", poses]
    world, config = prepare(SCENARIOS["paper"], told, link="dsm")
    assert isinstance(config.link, DsmLinkConfig)
    path: list[tuple[float, Vec3]] = []

    def step(time_s: float, position: Vec3) -> None:
        path.append((time_s, position))

    stage = Stage(world, config, 0, step, pty=wire)
    stage.plant.advance(loop.time())  # it knows the virtual clock's zero only
    flight = make_flight(config, confirm=confirm_at(0.0))
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


def test_a_served_receiver_tells_the_channel_that_arms_it() -> None:
    """A configuration without it is sent up to full thrust before motors that stand still."""
    poses = f"--set=pose.listen=127.0.0.1:{free_udp_port()}"
    with serving("--link", "dsm", poses, "--duration", "10") as says:
        assert "link.simulated = true and link.map.arm.channel = 5" in says


@pytest.mark.parametrize(
    ("what", "kind", "code", "words"),
    [
        ("bind", "dsm", 0, "bind for 0.3 s, disarmed"),
        ("idle", "crsf", 0, "0 repeated"),
        ("range-check", "crsf", 1, "see its own menu"),
    ],
)
def test_the_radio_command_serves_a_module_and_arms_nothing(
    what: str, kind: str, code: int, words: str
) -> None:
    config = DsmLinkConfig() if kind == "dsm" else CrsfLinkConfig()

    async def main() -> tuple[int, str, list[RfFrame]]:
        wire = PtyWire()
        came: list[bytes] = []
        wire.listen(came.append)
        config_ = (f"--set=link.kind={kind}", f"--set=link.port={wire.path}", "--seconds=0.3")
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
