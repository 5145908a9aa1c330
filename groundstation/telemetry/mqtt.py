"""Telemetry to an MQTT v5 broker. The broker may be away or slow at any time: the flight never notices.

Topics, below ``PREFIX/VEHICLE/``: ``state`` (the mission state as plain text, retained; ``offline`` once nobody flies,
also as last will), ``snapshot`` (JSON, see snapshot.py), ``event`` (each event once, as plain text).
"""

import asyncio
import contextlib
import logging
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec

from groundstation.broadcast import Latest
from groundstation.snapshot import Snapshot

if TYPE_CHECKING:
    import aiomqtt

OFFLINE = "offline"
RETRY_FIRST_S = 0.5
RETRY_MAX_S = 10.0
KEEPALIVE_S = 5
"""The broker declares us lost after one and a half times this [s]."""
TIMEOUT_S = 3.0
"""How long the broker may take to answer, or to take what we send [s]."""

log = logging.getLogger("groundstation.mqtt")


class MqttConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The broker to publish to."""

    enabled: bool = False
    """Publish at all."""
    host: Annotated[str, msgspec.Meta(min_length=1)] = "127.0.0.1"
    """Name or address of the broker. Nothing is encrypted: to cross a network, bridge from a broker on this machine."""
    port: Annotated[int, msgspec.Meta(ge=1, le=65535)] = 1883
    """TCP port of the broker."""
    username: str = ""
    """Name to log in with; empty for none."""
    password_file: str = ""
    """File whose first line is the password; empty for none."""
    prefix: Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9_.-]+(/[A-Za-z0-9_.-]+)*$")] = "groundstation"
    """First part of every topic."""
    rate_hz: Annotated[float, msgspec.Meta(gt=0.0, le=50.0)] = 5.0
    """Most snapshots a second [1/s]."""

    def password(self) -> str | None:
        """The password, read from its file; None where none is set.

        Raises:
            OSError: the file can't be read.
        """
        if not self.password_file:
            return None
        return Path(self.password_file).read_text("utf-8").partition("\n")[0].rstrip("\r")


async def publish_forever(config: MqttConfig, latest: Latest[Snapshot]) -> None:
    """Publish what ``latest`` holds until cancelled, connecting again with growing pauses after every loss.

    Raises:
        OSError: the password file can't be read. Nothing else.
    """
    import aiomqtt

    password = config.password()
    _, first = await latest.newer()
    publisher = _Publisher(config, first.vehicle, latest)
    pause_s = RETRY_FIRST_S
    reachable = True
    while True:
        try:
            async with aiomqtt.Client(
                config.host,
                config.port,
                username=config.username or None,
                password=password,
                protocol=aiomqtt.ProtocolVersion.V5,
                will=aiomqtt.Will(publisher.topic("state"), OFFLINE, qos=1, retain=True),
                keepalive=KEEPALIVE_S,
                timeout=TIMEOUT_S,
            ) as client:
                log.log(logging.INFO if reachable else logging.WARNING, "publishing to %s:%d", config.host, config.port)
                reachable, pause_s = True, RETRY_FIRST_S
                await publisher.run(client)
        except (aiomqtt.MqttError, ValueError) as error:  # ValueError: no possible host name
            if reachable:
                log.warning("no broker at %s:%d (%s); trying again", config.host, config.port, error)
            reachable = False
        await asyncio.sleep(pause_s)
        pause_s = min(2.0 * pause_s, RETRY_MAX_S)


class _Publisher:
    """What was published already, kept from one connection to the next."""

    def __init__(self, config: MqttConfig, vehicle: str, latest: Latest[Snapshot]) -> None:
        self._root = f"{config.prefix}/{vehicle}"
        self._period_s = 1.0 / config.rate_hz
        self._latest = latest
        self._events: tuple[str, ...] = ()

    def topic(self, name: str) -> str:
        return f"{self._root}/{name}"

    async def run(self, client: "aiomqtt.Client") -> None:
        """Publish over one connection until it breaks or we are cancelled; then say goodbye if we still can.

        Raises:
            MqttError: the connection is gone.
        """
        import aiomqtt

        state = None
        try:
            async for snapshot in self._latest.values(self._period_s):
                if snapshot.state != state:
                    state = snapshot.state
                    await client.publish(self.topic("state"), state, qos=1, retain=True)
                for event in unseen(self._events, snapshot.events):
                    await client.publish(self.topic("event"), event, qos=1)
                self._events = snapshot.events
                await client.publish(self.topic("snapshot"), msgspec.json.encode(snapshot))
        except asyncio.CancelledError:
            with contextlib.suppress(aiomqtt.MqttError):  # a clean end does not trigger the last will
                await client.publish(self.topic("state"), OFFLINE, qos=1, retain=True, timeout=1.0)
            raise


def unseen(before: tuple[str, ...], now: tuple[str, ...]) -> tuple[str, ...]:
    """The events of ``now`` that follow those of ``before``, both being windows of one growing list."""
    for start in range(len(before)):
        tail = before[start:]
        if now[: len(tail)] == tail:
            return now[len(tail) :]
    return now
