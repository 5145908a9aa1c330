"""Requests that come by MQTT: listens, has the gatekeeper look at them, and sends the answers."""

import asyncio
import os
from collections import Counter, deque
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from groundstation.config import ConfigError
from groundstation.core.messages import Reply, Request
from groundstation.interfaces.mqtt.broker import heed_cancellation, opened
from groundstation.interfaces.mqtt.gatekeeper import ClientKey, Gatekeeper
from groundstation.interfaces.mqtt.messages import ANSWER, REQUEST, SESSION, SessionMessage, Topic
from groundstation.interfaces.mqtt.request_codec import Place
from groundstation.runtime import wall_ms
from groundstation.settings import MqttConfig, asks
from links.io import read_key

if TYPE_CHECKING:
    import aiomqtt

PAUSE_S = 5.0
"""How long nobody listens after too many messages [s]."""
ANSWERS_KEPT = 16
"""So many answers wait for a slow broker; no request waits for them."""

Put = Callable[["aiomqtt.Client", Topic, bytes], Awaitable[None]]
"""Publishes to a topic."""


class Keys(msgspec.Struct, frozen=True):
    """The clients of a configuration, their keys read."""

    prefix: str
    clients: dict[str, ClientKey]

    def of(self, vehicle: str, ask: Callable[[Request], Reply], tell: Callable[[str], None]) -> "Requests":
        """What takes the requests to ``vehicle``."""
        return Requests(Place(self.prefix, vehicle), self.clients, ask, tell)


def requests_of(config: MqttConfig) -> Keys:
    """Read the keys of all clients.

    Raises:
        ConfigError: by its dotted key, where one can't be read, others may read it, or two clients share it.
    """
    clients: dict[str, ClientKey] = {}
    for name, client in config.requests.clients.items():
        where = f"mqtt.requests.clients.{name}.key_file"
        try:
            key = read_key(Path(client.key_file))
        except ValueError as error:
            raise ConfigError(where, str(error)) from None
        if any(key == other.key for other in clients.values()):
            raise ConfigError(where, f"{client.key_file} holds another client's key: each needs its own")
        clients[name] = ClientKey(key, asks(client))
    return Keys(config.prefix, clients)


def ensure_mqtt(config: MqttConfig) -> None:
    """Stop before anything moves if a file of ``config`` can't be used.

    Raises:
        ConfigError: by its dotted key.
    """
    if not config.enabled:
        return
    opened(config, warn=False)
    if config.requests.enabled:
        requests_of(config)


class Requests:
    """The requests to one vehicle, from one connection to the next."""

    def __init__(
        self,
        place: Place,
        clients: dict[str, ClientKey],
        ask: Callable[[Request], Reply],
        tell: Callable[[str], None],
    ) -> None:
        """``ask`` does what is let through; ``tell`` a line about what is not, seldom."""
        self._topic = f"{place.prefix}/{place.vehicle}/{REQUEST.name}"
        self._tell = tell
        self._gate = Gatekeeper(place, clients, ask, lambda: os.urandom(16).hex(), tell)
        self._answers: deque[bytes] = deque(maxlen=ANSWERS_KEPT)
        self._more = asyncio.Event()

    @property
    def counts(self) -> Counter[str]:
        """What became of them."""
        return self._gate.counts

    async def listen(self, client: "aiomqtt.Client", put: Put) -> None:
        """Take requests until the connection breaks; at once where the broker does not let us.

        Raises:
            MqttError: it does break.
        """
        loop = asyncio.get_running_loop()
        self._answers.clear()
        if not await self._subscribed(client):
            self._tell(f"the broker does not let us read {self._topic}: no requests; look at its access rules")
            return
        said = ""
        while True:
            if self._gate.session != said:
                said = self._gate.session
                await put(client, SESSION, msgspec.json.encode(SessionMessage(said)))
            message = await anext(client.messages)
            now_s = loop.time()
            if self._gate.is_flooded(now_s):
                await self._pause(client)
                continue
            answer = self._gate.take(message.payload, retained=message.retain, now_s=now_s, wall_ms=wall_ms())
            if answer is not None:
                self._answers.append(answer)
                self._more.set()

    async def answer(self, client: "aiomqtt.Client", put: Put) -> None:
        """Send the answers until the connection breaks.

        Raises:
            MqttError: it does.
        """
        while True:
            while self._answers:
                await put(client, ANSWER, self._answers.popleft())
            self._more.clear()
            await self._more.wait()

    async def _subscribed(self, client: "aiomqtt.Client") -> bool:
        """Subscribe, but not to what the broker has kept; False where it refuses."""
        from paho.mqtt.subscribeoptions import SubscribeOptions

        options = SubscribeOptions(qos=REQUEST.quality, retainHandling=SubscribeOptions.RETAIN_DO_NOT_SEND)
        granted = await client.subscribe(self._topic, options=options)
        heed_cancellation()
        return not any(code.is_failure for code in granted if not isinstance(code, int))

    async def _pause(self, client: "aiomqtt.Client") -> None:
        await client.unsubscribe(self._topic)
        heed_cancellation()
        await asyncio.sleep(PAUSE_S)
        while len(client.messages):
            await anext(client.messages)
        await self._subscribed(client)
