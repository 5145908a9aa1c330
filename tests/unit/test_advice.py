"""What tutorials, examples and the Makefile advise: that it does what it says."""

import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SET_UP = ROOT / "examples" / "broker" / "set-up.sh"


@pytest.mark.parametrize("name", ["tablet.key", "signing.key", "lab/bridge.key"])
def test_no_key_is_added_to_the_repository(needs_program: Callable[..., str], name: str) -> None:
    git = needs_program("git")
    if subprocess.run([git, "-C", ROOT, "rev-parse"], capture_output=True, check=False).returncode:
        pytest.skip("no clone")
    subprocess.run([git, "-C", ROOT, "check-ignore", "-q", name], check=True)


class BrokerFolder:
    """What ``set-up.sh`` has made."""

    def __init__(self, folder: Path, program: str) -> None:
        self.folder = folder
        self.certificate = str(folder / "broker.crt")
        self._path = os.pathsep.join(
            [str(Path(program).parent), os.environ.get("PATH", os.defpath)]
        )

    def set_up(self, *words: str, vehicles: str = "") -> str:
        environment = {**os.environ, "PATH": self._path, "VEHICLES": vehicles}
        command = ["sh", str(SET_UP), str(self.folder), *words]
        return subprocess.run(
            command, env=environment, check=True, capture_output=True, text=True
        ).stdout

    def read(self, name: str) -> str:
        return (self.folder / name).read_text()

    def names(self) -> str:
        words = ["openssl", "x509", "-in", self.certificate, "-noout", "-ext", "subjectAltName"]
        return subprocess.run(words, check=True, capture_output=True, text=True).stdout


def test_a_broker_gets_a_certificate_for_another_name_and_passwords_of_further_vehicles(
    needs_program: Callable[..., str], tmp_path: Path
) -> None:
    needs_program("openssl")
    broker = BrokerFolder(tmp_path / "broker", needs_program("mosquitto_passwd"))
    broker.set_up()
    assert "listener 8883 127.0.0.1\n" in broker.read("mosquitto.conf")
    kept = {
        name: broker.read(name)
        for name in ("ca.crt", "ca.key", "password-mqx", "password-operator", "access")
    }
    old = broker.read("broker.crt")
    broker.set_up()
    assert broker.read("broker.crt") == old

    told = broker.set_up("lab-pc.example", vehicles="mqx quad2")
    assert "a new certificate for lab-pc.example" in told and "a password for quad2" in told
    assert "DNS:lab-pc.example" in broker.names()
    assert "listener 8883\n" in broker.read("mosquitto.conf")
    assert {name: broker.read(name) for name in kept} == kept
    names = [line.split(":")[0] for line in broker.read("passwords").splitlines()]
    assert names == ["mqx", "viewer", "operator", "quad2"]
    verified = ["openssl", "verify", "-CAfile", str(broker.folder / "ca.crt"), broker.certificate]
    subprocess.run(verified, check=True, capture_output=True)

    new = broker.read("broker.crt")
    broker.set_up()  # no name: that of before
    broker.set_up("lab-pc.example")
    assert broker.read("broker.crt") == new and "listener 8883\n" in broker.read("mosquitto.conf")
    assert "IP Address:10.0.0.7" in (broker.set_up("10.0.0.7") and broker.names())


def test_a_folder_of_something_else_is_no_place_for_a_broker(
    needs_program: Callable[..., str], tmp_path: Path
) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(subprocess.CalledProcessError) as caught:
        BrokerFolder(tmp_path, needs_program("mosquitto_passwd")).set_up()
    assert "must be new" in caught.value.stderr
