"""What a configuration of MQTT may say, and what stops the start."""

import logging
from pathlib import Path
from typing import Any

import pytest

from groundstation.config import ConfigError, from_dict
from groundstation.interfaces.mqtt import ensure_mqtt, from_url
from groundstation.interfaces.mqtt.broker import open_broker
from groundstation.settings import Config, MqttConfig
from links.io import make_key


def of(**mqtt: Any) -> MqttConfig:
    return from_dict({"mqtt": {"enabled": True, **mqtt}}, Config).mqtt


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1"])
def test_on_this_machine_nothing_needs_encryption(host: str) -> None:
    assert open_broker(of(host=host)).context is None
    assert of(host=host).tcp_port == 1883


def test_another_machine_needs_tls_or_a_word_that_it_does_not() -> None:
    assert of(host="lab.example", tls={"enabled": True}).tcp_port == 8883
    assert of(host="lab.example", insecure=True).tcp_port == 1883


@pytest.mark.parametrize(
    ("mqtt", "words"),
    [
        ({"host": "lab.example", "insecure": True}, "NOT ENCRYPTED"),
        ({"tls": {"enabled": True, "verify": False}}, "NOT VERIFIED"),
    ],
)
def test_what_is_not_safe_is_told_at_each_start(
    mqtt: dict[str, Any], words: str, caplog: pytest.LogCaptureFixture
) -> None:
    for _ in range(2):
        open_broker(of(**mqtt))
    assert [words in record.message for record in caplog.records] == [True, True]
    assert all(record.levelno == logging.WARNING for record in caplog.records)


def test_the_certificate_and_the_name_of_the_broker_are_checked_unless_told_otherwise() -> None:
    checked = open_broker(of(tls={"enabled": True})).context
    unchecked = open_broker(of(tls={"enabled": True, "verify": False})).context
    assert checked is not None
    assert unchecked is not None
    assert (checked.check_hostname, checked.verify_mode.name) == (True, "CERT_REQUIRED")
    assert (unchecked.check_hostname, unchecked.verify_mode.name) == (False, "CERT_NONE")


def test_a_password_or_a_key_that_others_may_read_stops_the_start(tmp_path: Path) -> None:
    password, key = tmp_path / "password", tmp_path / "key"
    password.write_text("secret\n")
    make_key(key)
    client = {"key_file": str(key), "may": ["land"]}
    requests = {"enabled": True, "clients": {"tablet": client}}
    mqtt = {"username": "mqx", "password_file": str(password), "requests": requests}
    password.chmod(0o640)
    with pytest.raises(ConfigError, match=r"mqtt\.password_file: .* has mode 0640"):
        ensure_mqtt(of(**mqtt))
    password.chmod(0o600)
    ensure_mqtt(of(**mqtt))
    key.chmod(0o644)
    says = r"mqtt\.requests\.clients\.tablet\.key_file: .* has mode 0644"
    with pytest.raises(ConfigError, match=says):
        ensure_mqtt(of(**mqtt))


def test_two_clients_never_share_a_key(tmp_path: Path) -> None:
    make_key(tmp_path / "key")
    one = {"key_file": str(tmp_path / "key"), "may": ["land"]}
    with pytest.raises(ConfigError, match="another client's key"):
        ensure_mqtt(of(requests={"enabled": True, "clients": {"a": one, "b": one}}))


def test_a_missing_authority_or_certificate_is_named(tmp_path: Path) -> None:
    says = r"mqtt\.tls\.ca_file: cannot use /nowhere/ca.crt: No such file"
    with pytest.raises(ConfigError, match=says):
        open_broker(of(tls={"enabled": True, "ca_file": "/nowhere/ca.crt"}))
    (tmp_path / "key").touch(0o600)
    (tmp_path / "cert").touch()
    files = {"cert_file": str(tmp_path / "cert"), "key_file": str(tmp_path / "key")}
    with pytest.raises(ConfigError, match=r"mqtt\.tls\.cert_file: cannot use"):
        open_broker(of(tls={"enabled": True, **files}))


def test_a_url_says_where_the_broker_is() -> None:
    config = from_url("mqtts://viewer@lab.example:8884/lab/one").config
    assert (config.host, config.tcp_port, config.username) == ("lab.example", 8884, "viewer")
    assert (config.prefix, config.tls.enabled) == ("lab/one", True)
    assert from_url("mqtt://localhost").config.tcp_port == 1883


@pytest.mark.parametrize(
    "url",
    ["lab.example", "http://lab", "mqtt://lab.example", "mqtts://", "mqtts://a:b@c", "mqtts://c:x"],
)
def test_what_is_no_url_of_a_broker_is_refused(url: str) -> None:
    with pytest.raises(ConfigError):
        from_url(url)
