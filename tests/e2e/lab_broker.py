"""A broker as a laboratory has it: TLS, passwords and access rules, made by the script that users run."""

import asyncio
import contextlib
import os
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from groundstation.interfaces.mqtt import MqttBroker as Address
from groundstation.interfaces.mqtt import from_url
from tests.e2e.test_mqtt import free_tcp_port

SET_UP = Path(__file__).parents[2] / "examples" / "broker" / "set-up.sh"


class LabBroker:
    """A mosquitto of our own."""

    def __init__(self, program: str, folder: Path, vehicles: str) -> None:
        self.folder = folder
        self.port = asyncio.run(free_tcp_port())
        self._program = program
        self._process: subprocess.Popen[bytes] | None = None
        path = os.pathsep.join([str(Path(program).parent), os.environ.get("PATH", os.defpath)])
        environment = {**os.environ, "VEHICLES": vehicles, "PATH": path}
        subprocess.run(["sh", SET_UP, folder, "localhost", str(self.port)], env=environment, check=True)

    async def begin(self) -> None:
        """Start it, and return once it listens."""
        self._launch()
        async with asyncio.timeout(60.0):
            while True:
                with contextlib.suppress(OSError):
                    _, writer = await asyncio.open_connection("127.0.0.1", self.port)
                    writer.close()
                    return
                await asyncio.sleep(0.01)

    def _launch(self) -> None:
        self._process = subprocess.Popen(
            [self._program, "-c", self.folder / "mosquitto.conf"], stderr=subprocess.DEVNULL
        )

    def kill(self) -> None:
        """Kill it, at once."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None

    @property
    def url(self) -> str:
        return f"mqtts://localhost:{self.port}"

    def password(self, user: str) -> Path:
        return self.folder / f"password-{user}"

    def address(self, user: str) -> Address:
        """How ``user`` connects."""
        return from_url(self.url, ca=self.folder / "ca.crt", user=user, password_file=self.password(user))

    def login(self, user: str) -> list[str]:
        """The same as arguments of a command."""
        return ["--ca", str(self.folder / "ca.crt"), "--user", user, "--password-file", str(self.password(user))]

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
    asyncio.run(broker.begin())
    yield broker
    broker.kill()
