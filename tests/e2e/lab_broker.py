"""A laboratory's broker: TLS, passwords and access rules, made by the script that users run."""

import asyncio
import os
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from groundstation.interfaces.mqtt import MqttBroker as Address, from_url
from tests.e2e.test_mqtt import Broker, free_tcp_port

SET_UP = Path(__file__).parents[2] / "examples" / "broker" / "set-up.sh"


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
