"""Brokers: one that lets everybody in, and a laboratory's, made by the script that users run."""

import asyncio
import contextlib
import os
import signal
import socket
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from groundstation.interfaces.mqtt import MqttBroker as Address, from_url
from tests.known import known

SET_UP = Path(__file__).parents[2] / "examples" / "broker" / "set-up.sh"


class Broker:
    """A mosquitto of our own."""

    def __init__(self, program: str, config: Path, port: int) -> None:
        self.port = port
        self._program = program
        self._config = config
        self._process: subprocess.Popen[bytes] | None = None

    async def start(self) -> None:
        self._launch()
        while True:
            with contextlib.suppress(OSError):
                _, writer = await asyncio.open_connection("127.0.0.1", self.port)
                writer.close()
                return
            assert known(self._process).poll() is None, "mosquitto did not start"
            await asyncio.sleep(0.01)

    def _launch(self) -> None:
        command = (self._program, "-c", self._config)
        self._process = subprocess.Popen(command, stderr=subprocess.DEVNULL)

    def send_signal(self, number: signal.Signals) -> None:
        known(self._process).send_signal(number)

    def kill(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None


@pytest.fixture
def broker(needs_program: Callable[..., str], tmp_path: Path) -> Iterator[Broker]:
    """One that lets everybody in; it does not run yet."""
    config, port = tmp_path / "mosquitto.conf", free_tcp_port()
    open_to_all = "persistence false\nuser root\nallow_anonymous true\n"
    config.write_text(f"listener {port} 127.0.0.1\n{open_to_all}")
    made = Broker(needs_program("mosquitto"), config, port)
    yield made
    made.kill()


def free_tcp_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class LabBroker(Broker):
    """A mosquitto of our own, as the script has set it up."""

    def __init__(self, program: str, folder: Path, vehicles: str) -> None:
        super().__init__(program, folder / "mosquitto.conf", free_tcp_port())
        self.folder = folder
        path = os.pathsep.join([str(Path(program).parent), os.environ.get("PATH", os.defpath)])
        environment = {**os.environ, "VEHICLES": vehicles, "PATH": path}
        subprocess.run(
            ["sh", SET_UP, folder, "localhost", str(self.port)], env=environment, check=True
        )

    @property
    def url(self) -> str:
        return f"mqtts://localhost:{self.port}"

    def password(self, user: str) -> Path:
        return self.folder / f"password-{user}"

    def address(self, user: str) -> Address:
        """How ``user`` connects."""
        return from_url(
            self.url, ca=self.folder / "ca.crt", user=user, password_file=self.password(user)
        )

    def settings(self, vehicle: str) -> dict[str, str]:
        """The same as keys of a station's configuration."""
        return {
            "mqtt.enabled": "true",
            "mqtt.host": "localhost",
            "mqtt.port": str(self.port),
            "mqtt.tls.enabled": "true",
            "mqtt.tls.ca_file": str(self.folder / "ca.crt"),
            "mqtt.username": vehicle,
            "mqtt.password_file": str(self.password(vehicle)),
        }


@pytest.fixture
def lab(needs_program: Callable[..., str], tmp_path: Path) -> Iterator[LabBroker]:
    """A running one, with the vehicles mqx and quad2."""
    needs_program("openssl")
    needs_program("mosquitto_passwd")
    broker = LabBroker(needs_program("mosquitto"), tmp_path / "broker", "mqx quad2")
    asyncio.run(broker.start())
    yield broker
    broker.kill()
