"""What may be a name: it becomes part of a path, a topic and a command line."""

from typing import Any

import msgspec
import pytest

from groundstation.config import ConfigError, from_dict, is_name
from groundstation.interfaces.mqtt.messages import SealedRequest
from groundstation.interfaces.tui.fleet import FleetMonitor
from groundstation.lab.fleet import Name
from groundstation.machine.recordings import RECORDING
from groundstation.settings import Config

NO_NAMES = [
    "",
    "mqx\n",
    "..",
    ".",
    "-rf",
    "_x",
    "a/b",
    "a b",
    "ä",
    "x\x00",
    "\nmqx",
    "mqx\r",
    "+",
    "#",
]


def with_client(name: str) -> dict[str, Any]:
    client = {"key_file": "key", "may": ["land"]}
    return {"mqtt": {"requests": {"enabled": True, "clients": {name: client}}}}


KEYS = {
    "vehicle.name": lambda name: {"vehicle": {"name": name}},
    "mqtt.prefix": lambda name: {"mqtt": {"prefix": name}},
    "mqtt.prefix, second part": lambda name: {"mqtt": {"prefix": f"lab/{name}"}},
    "mqtt.requests": with_client,
}


@pytest.mark.parametrize(
    ("key", "name"),
    [(key, name) for key in KEYS for name in NO_NAMES if not ("prefix" in key and name == "a/b")],
)
def test_no_key_takes_what_is_no_name(key: str, name: str) -> None:
    with pytest.raises(ConfigError) as error:
        from_dict(KEYS[key](name), Config)
    assert error.value.key.startswith(key.partition(",")[0])
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", ["mqx", "quad-2", "Quad_2.b", "7"])
def test_every_key_takes_a_name(name: str) -> None:
    for data in KEYS.values():
        from_dict(data(name), Config)
    assert msgspec.convert(name, Name) == name
    assert RECORDING.fullmatch(f"20260102-030405-{name}.mcap")


@pytest.mark.parametrize("name", NO_NAMES)
def test_no_file_topic_or_message_takes_it_either(name: str) -> None:
    assert not is_name(name)
    assert RECORDING.fullmatch(f"20260102-030405-{name}.mcap") is None
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert(name, Name)
    fleet = FleetMonitor("lab")
    fleet.hear(f"lab/{name}/state", b"landed", 0.0)
    assert list(fleet) == []
    request = {"session": "0" * 32, "client": name, "id": 1, "ask": "land", "expires_ms": 1}
    request["mac"] = "0" * 64
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert(request, SealedRequest)


@pytest.mark.parametrize("kind", ["m:f\n", "m\n:f", "-m:f", "..m:f", ":f", "m:"])
def test_no_module_is_named_by_what_is_no_name(kind: str) -> None:
    with pytest.raises(ConfigError):
        from_dict({"controller": {"kind": kind}}, Config)
    with pytest.raises(ConfigError):
        from_dict({"controller": {"kind": "custom", "factory": kind}}, Config)
