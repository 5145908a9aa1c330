"""MQTT broker: its address, the password and certificates read from their files, and a client to
connect with.
"""

import asyncio
import logging
import os
import re
import socket
import stat
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from groundstation.config import ConfigError, from_dict, refuse_io, refuse_value
from groundstation.core.messages import notice
from groundstation.interfaces.api import ANSWER_S
from groundstation.settings import MqttConfig
from links.io import is_loopback
from links.text import printable

if TYPE_CHECKING:
    import ssl

    import aiomqtt

KEEPALIVE_S = 5
"""The broker declares us lost after one and a half times this [s]."""
LOGIN_REFUSED = ("Bad user name or password", "Not authorized")
"""Reasons of a refused login: MQTT 5.0, section 3.2.2.2."""
SEND_BUFFER_BYTES = 16384
"""Send buffer for a broker that reads slowly [bytes]: some snapshots, not some minutes of them."""

log = logging.getLogger("groundstation.mqtt")
_PAHO = logging.getLogger("groundstation.mqtt.paho")
_PAHO.setLevel(logging.ERROR)  # what it warns of, a full queue, is counted by us


class MqttBroker(msgspec.Struct, frozen=True):
    """All that a connection needs."""

    config: MqttConfig
    password: str | None
    context: "ssl.SSLContext | None"
    """None: not encrypted."""

    def __str__(self) -> str:
        return f"{self.config.host}:{self.config.tcp_port}"

    def client(self, *, heard_max_bytes: int | None = None, **more: Any) -> "aiomqtt.Client":
        """A client that is not connected yet.

        Nothing is kept for it at the broker while it is away.

        Entering it raises MqttError, or ValueError for no possible host. ``more`` goes to aiomqtt.
        """
        import aiomqtt
        from paho.mqtt.packettypes import PacketTypes
        from paho.mqtt.properties import Properties

        properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]  # paho's
        if heard_max_bytes is not None:
            properties.MaximumPacketSize = heard_max_bytes
        client = aiomqtt.Client(
            self.config.host,
            self.config.tcp_port,
            username=self.config.username or None,
            password=self.password,
            tls_context=self.context,
            protocol=aiomqtt.ProtocolVersion.V5,
            keepalive=KEEPALIVE_S,
            timeout=ANSWER_S,
            properties=properties,
            logger=_PAHO,
            socket_options=[
                (socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES),
                (socket.IPPROTO_TCP, socket.TCP_NODELAY, 1),
            ],
            **more,
        )
        client._disconnected.add_done_callback(_retrieve)
        return client


def _retrieve(disconnected: "asyncio.Future[None]") -> None:
    """Retrieve why aiomqtt was disconnected, which asyncio otherwise logs as an error of ours.

    A broker that stood still may accept and drop a connection that was given up long before.
    """
    if not disconnected.cancelled():
        disconnected.exception()


def open_broker(config: MqttConfig, section: str = "mqtt.", *, warn: bool = True) -> MqttBroker:
    """The broker of ``config``, its files read; ``section`` begins the keys in errors.

    It can ``warn`` of what is not encrypted or not checked.

    Raises:
        ConfigError: a file can't be read or used, or others may read it.
    """
    password = (
        _password(Path(config.password_file), f"{section}password_file")
        if config.password_file
        else None
    )
    if warn and not config.tls.enabled and config.insecure:
        log.warning(
            "NOT ENCRYPTED: everybody on the way to the broker %s may read what is sent",
            config.host,
        )
    if warn and not config.tls.verify:
        log.warning(
            "NOT VERIFIED: mqtt.tls.verify = false, so anybody may pose as the broker %s",
            config.host,
        )
    return MqttBroker(config, password, _context(config, section) if config.tls.enabled else None)


def heed_cancellation() -> None:
    """To be called after whatever aiomqtt waits for with a time limit.

    It does so by ``asyncio.wait_for``, which before Python 3.12 forgets a cancellation that comes
    as the wait ends: the task would go on, and whoever has cancelled it would wait for ever.
    """
    task = asyncio.current_task()
    if task is not None and task.cancelling():
        raise asyncio.CancelledError


def describe_error(error: Exception) -> str:
    """Describe a broker's failure without the numbers of the libraries below."""
    from paho.mqtt.reasoncodes import ReasonCode

    why = re.sub(r"^\[[^\]]*\] *| *\(_ssl\.c:\d+\)", "", printable(str(error)))
    code = getattr(error, "rc", None)
    if isinstance(code, ReasonCode) and code.getName() in LOGIN_REFUSED:
        return notice("mqtt.login_refused", why=why).text
    if isinstance(error.__context__, ConnectionRefusedError):
        return notice("mqtt.refused").text
    return why or "the connection was lost"


OPTIONS = {"tls.ca_file": "--ca", "username": "--user", "password_file": "--password-file"}
"""Key of a configuration → the option of a command line in its place."""


def from_url(
    url: str, *, ca: Path | None = None, user: str = "", password_file: Path | None = None
) -> MqttBroker:
    """The broker at ``mqtts://[USER@]HOST[:PORT][/PREFIX]``, or ``mqtt://`` on this machine.

    Raises:
        ConfigError: it is no such address, or a file can't be used.
    """
    from urllib.parse import urlsplit

    with refuse_value(url):
        parts = urlsplit(url)
        port = parts.port
    tls = parts.scheme == "mqtts"
    if (
        parts.scheme not in ("mqtt", "mqtts")
        or not parts.hostname
        or parts.query
        or parts.fragment
        or parts.password
    ):
        raise ConfigError(url, notice("mqtt.url"))
    if not tls and not is_loopback(parts.hostname):
        raise ConfigError(url, notice("mqtt.unencrypted", host=parts.hostname))
    data: dict[str, Any] = {
        "enabled": True,
        "host": parts.hostname,
        "tls": {"enabled": tls, "ca_file": str(ca or "")},
        "username": user or parts.username or "",
        "password_file": str(password_file or ""),
    }
    data |= {} if port is None else {"port": port}
    data |= {"prefix": prefix} if (prefix := parts.path.strip("/")) else {}
    config = from_dict(data, MqttConfig, source=url)
    try:
        return open_broker(config, "")
    except ConfigError as error:
        raise ConfigError(OPTIONS.get(error.key, error.key), error.problem) from None


def _password(path: Path, key: str) -> str:
    with refuse_io(key, "file.unread", path), path.open(encoding="utf-8") as file:
        info = os.fstat(file.fileno())
        password = file.readline().rstrip("\r\n")
    _for_us_alone(info, path, key)
    return password


def _for_us_alone(info: os.stat_result, path: Path, key: str) -> None:
    if info.st_uid not in (os.getuid(), 0) or stat.S_IMODE(info.st_mode) & 0o077:
        raise ConfigError(
            key, notice("file.mode", path=path, mode=f"{stat.S_IMODE(info.st_mode):04o}")
        )


def _context(config: MqttConfig, section: str) -> "ssl.SSLContext":
    import ssl

    tls = config.tls
    with refuse_io(f"{section}tls.ca_file", "file.unusable", tls.ca_file):
        context = ssl.create_default_context(cafile=tls.ca_file or None)
    if not tls.verify:
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    if tls.cert_file:
        with refuse_io(
            f"{section}tls.cert_file", "file.unusable", f"{tls.cert_file} with {tls.key_file}"
        ):
            _for_us_alone(Path(tls.key_file).stat(), Path(tls.key_file), f"{section}tls.key_file")
            context.load_cert_chain(tls.cert_file, tls.key_file)
    return context
