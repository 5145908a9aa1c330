"""A killed, frozen or listened-to broker, dashboard or client changes no byte of a flight."""

import asyncio
import math
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import msgspec
import pytest

from groundstation.core.mission import FINAL, State
from groundstation.flight import Flight
from groundstation.interfaces.api import Server
from groundstation.interfaces.service.flights import crew
from groundstation.interfaces.tui.drawing import big
from groundstation.machine import StatusConfig
from sim.runs import Stage, fly_mission, from_floor
from sim.runs.flight import Script
from sim.scenarios import SCENARIOS, prepare
from tests.e2e.lab_broker import Broker, broker
from tests.e2e.test_mqtt import SNAPSHOT, STATE, Listener, config_for
from tests.e2e.test_tui import Terminal, terminal
from tests.e2e.test_tui_flight import processes
from tests.flight.flights import SHORT
from tests.open_loop import OpenLoop

__all__ = ["broker", "terminal"]

FIGURE_S = 20.0
PACE = 1.0
"""Most virtual seconds in a real one while something outside is waited for [-]."""
CLIENT = """
import socket, sys, time
with socket.socket(socket.AF_UNIX) as station:
    station.connect(sys.argv[1])
    station.sendall(b'{"id": 1, "control": "take", "name": "frozen"}\\n')
    while data := station.recv(4096):
        print(len(data), flush=True)
"""
"""A client that holds control and reads."""

Frame = tuple[float, bytes]


WORLD, CONFIG = from_floor(*prepare(SCENARIOS["adverse"], list(SHORT)), FIGURE_S)


def left(script: Script | None) -> list[Frame]:
    """Every datagram of a flight, in order, with its instant; ``script`` runs beside it."""
    sent: list[Frame] = []

    def loop() -> OpenLoop:
        made = OpenLoop()
        made.tap = lambda time_s, _source, _target, data: sent.append((time_s, data))
        return made

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sim.time.virtual_time.VirtualTimeLoop", loop)
        flown = fly_mission(WORLD, CONFIG, seed=5, script=script)
    assert flown.landed, flown.why
    return sent


@cache
def alone() -> list[Frame]:
    return left(None)


async def until(true: Callable[[], bool]) -> None:
    while not true():
        await asyncio.sleep(0.2)


class Outside:
    """What is around the flight, and what is done to it."""

    def __init__(self, broker: Broker, terminal: Terminal, folder: Path) -> None:
        self.config = msgspec.structs.replace(
            CONFIG,
            status=StatusConfig(path=str(folder / "mqx.sock"), rate_hz=50.0),
            mqtt=config_for(broker),
        )
        self.done: list[str] = []
        self._broker = broker
        self._terminal = terminal
        self._socket = folder / "mqx.sock"
        self._heard = folder / "heard"

    async def beside(self, flight: Flight, _: Stage) -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, OpenLoop)
        async with crew(
            self.config, flight, lambda text, *_: self.done.append(text), needed=True
        ) as server:
            await until(lambda: flight.state is State.TRACKING)
            loop.pace = PACE
            frozen = asyncio.ensure_future(self._client_freezes(server))
            await asyncio.gather(self._broker_dies(), self._dashboard_dies(server))
            loop.pace = math.inf
            await frozen
            assert flight.state is State.TRACKING, "all this takes longer than the flight"
            await until(lambda: flight.state in FINAL)

    async def _broker_dies(self) -> None:
        # Streams to an address are in memory on our loop.
        await asyncio.to_thread(asyncio.run, self._broker.start())
        async with Listener(self._broker.port) as listener:
            await listener.until(
                lambda to: "tracking" in to.got[STATE] and len(to.got[SNAPSHOT]) > 10
            )
        self._broker.kill()
        await asyncio.sleep(1.0)
        await asyncio.to_thread(asyncio.run, self._broker.start())
        async with Listener(self._broker.port) as listener:
            await listener.until(lambda to: bool(to.got[SNAPSHOT]))
        self.done.append("broker")

    async def _dashboard_dies(self, server: Server) -> None:
        screen = [sys.executable, "-m", "groundstation", "tui", "--socket", str(self._socket)]
        self._terminal.start(*screen)
        await until(
            lambda: all(row in self._terminal.screen() for row in (*big("tracking"), "Armed by"))
        )
        self._terminal.type("?")
        [pid] = [
            pid for pid, args in processes(str(self._socket)).items() if args == " ".join(screen)
        ]
        clients = len(server._clients)
        os.kill(pid, signal.SIGKILL)
        await until(lambda: len(server._clients) < clients)
        self.done.append("dashboard")

    async def _client_freezes(self, server: Server) -> None:
        with self._heard.open("wb") as heard:
            client = subprocess.Popen([sys.executable, "-c", CLIENT, self._socket], stdout=heard)  # noqa: ASYNC220  # the loop is not asked
        try:
            await until(lambda: server.desk.is_held and self._heard.stat().st_size > 100)
            client.send_signal(signal.SIGSTOP)
            await until(lambda: not server.desk.is_held)  # it was dropped
        finally:
            client.kill()
            client.wait()
        self.done.append("client")


def test_a_broker_a_dashboard_and_a_client_that_die_or_freeze_change_no_byte_that_leaves(
    broker: Broker, terminal: Terminal, tmp_path: Path
) -> None:
    outside = Outside(broker, terminal, tmp_path)
    attended = left(outside.beside)
    assert set(outside.done) == {"broker", "dashboard", "client"}
    assert len(attended) > 1000
    assert attended == alone()


def test_a_client_that_is_obeyed_changes_what_leaves(tmp_path: Path) -> None:
    config = msgspec.structs.replace(CONFIG, status=StatusConfig(path=str(tmp_path / "mqx.sock")))

    async def beside(flight: Flight, _: Stage) -> None:
        async with crew(config, flight, lambda text, *_: pytest.fail(text), needed=True):
            await until(lambda: flight.state is State.TRACKING)
            _reader, writer = await asyncio.open_unix_connection(config.status.path)
            writer.write(b'{"id": 1, "ask": "land"}\n')
            await until(lambda: flight.state in FINAL)
            writer.close()

    disturbed, undisturbed = left(beside), alone()
    assert disturbed != undisturbed
    assert disturbed[: len(disturbed) // 5] == undisturbed[: len(disturbed) // 5]  # up to there
