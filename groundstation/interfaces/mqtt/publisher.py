"""MQTT publisher: telemetry to a v5 broker, and requests from it.

A broker away or slow is never noticed by the flight.

The topics are in messages.py and docs/reference/mqtt.md. Nothing is queued but the newest 100
events: whoever reads late reads the newest. What a request asks for is done where the gatekeeper
(requests.py) lets it through.
"""

import asyncio
import contextlib
import logging
import os
from collections import Counter, deque
from collections.abc import Awaitable, Callable, Coroutine
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from groundstation.config import ConfigError, refuse_value
from groundstation.core.messages import Ask, Notice, Reply, Request, Say, Sentence, Snapshot, notice
from groundstation.interfaces.api import ANSWER_S, new_events
from groundstation.interfaces.mqtt.broker import (
    MqttBroker,
    describe_error,
    heed_cancellation,
    open_broker,
)
from groundstation.interfaces.mqtt.messages import (
    ANSWER,
    EVENT,
    HEALTH,
    OFFLINE,
    REQUEST,
    SESSION,
    SNAPSHOT,
    STATE,
    EventMessage,
    HealthMessage,
    SessionMessage,
    Topic,
    properties,
)
from groundstation.interfaces.mqtt.requests import (
    MOST_MESSAGES,
    REQUEST_MAX_BYTES,
    ClientKey,
    Gatekeeper,
    Place,
)
from groundstation.machine import Latest, wall_ms
from groundstation.runtime import __version__
from groundstation.settings import MqttConfig
from links.core import REOPEN_S
from links.io import read_key

if TYPE_CHECKING:
    import aiomqtt


KEPT = 100
"""Limit of the answers, and of the events, that wait for a slow broker, or one that is away [-]; no
request waits for them. Older ones are lost; events are counted."""

Put = Callable[["aiomqtt.Client", Topic, bytes], Awaitable[None]]
"""Publishes to a topic."""


def read_client_keys(config: MqttConfig) -> dict[str, ClientKey]:
    """The clients by name, their keys read.

    Raises:
        ConfigError: by its dotted key, where one can't be read, others may read it, or two clients
            share it.
    """
    clients: dict[str, ClientKey] = {}
    for name, client in config.requests.clients.items():
        where = f"mqtt.requests.clients.{name}.key_file"
        with refuse_value(where):
            key = read_key(Path(client.key_file))
        if any(key == other.key for other in clients.values()):
            raise ConfigError(where, notice("mqtt.same_key", path=client.key_file))
        clients[name] = ClientKey(key, frozenset(map(Ask, client.may)))
    return clients


def ensure_mqtt(config: MqttConfig) -> None:
    """Stop before anything moves if a file of ``config`` can't be used.

    Raises:
        ConfigError: by its dotted key.
    """
    if not config.enabled:
        return
    open_broker(config, warn=False)
    if config.requests.enabled:
        read_client_keys(config)


class RequestListener:
    """The requests to one vehicle, from one connection to the next."""

    def __init__(
        self,
        place: Place,
        clients: dict[str, ClientKey],
        ask: Callable[[Request], Reply],
        tell: Say,
    ) -> None:
        """``ask`` does what is let through; ``tell`` a line about what is not, seldom."""
        self._topic = f"{place.prefix}/{place.vehicle}/{REQUEST.name}"
        self._tell = tell
        self._gate = Gatekeeper(place, clients, ask, lambda: os.urandom(16).hex(), tell)
        self.counts = self._gate.counts
        """Number of requests by result."""
        self._session = ""
        self._answers: deque[bytes] = deque(maxlen=KEPT)
        self._more = asyncio.Event()

    def session_message(self) -> bytes:
        """Return the message that names the session.

        It is empty, which deletes the retained one, if we do not listen.
        """
        return msgspec.json.encode(SessionMessage(self._session)) if self._session else b""

    async def listen(self, client: "aiomqtt.Client", put: Put) -> None:
        """Take requests until the connection breaks; at once where the broker does not let us.

        Raises:
            MqttError: it does break.
        """
        loop = asyncio.get_running_loop()
        self._answers.clear()
        self._session = ""
        if not await self._subscribe(client):
            self._tell(notice("mqtt.no_requests", topic=self._topic))
            return
        while True:
            if self._gate.session != self._session:
                self._session = self._gate.session
                await put(client, SESSION, self.session_message())
            message = await anext(client.messages)
            now_s = loop.time()
            if self._gate.is_overrun(now_s):
                await self._pause(client)
                continue
            answer = self._gate.take(
                message.payload, retained=message.retain, now_s=now_s, wall_ms=wall_ms()
            )
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

    async def _subscribe(self, client: "aiomqtt.Client") -> bool:
        """Subscribe, but not to what the broker has kept; False where it refuses."""
        from paho.mqtt.subscribeoptions import SubscribeOptions

        options = SubscribeOptions(
            qos=REQUEST.quality, retainHandling=SubscribeOptions.RETAIN_DO_NOT_SEND
        )
        granted = await client.subscribe(self._topic, options=options)
        heed_cancellation()
        return not any(code.is_failure for code in granted if not isinstance(code, int))

    async def _pause(self, client: "aiomqtt.Client") -> None:
        """Read nothing for a while after a flood of messages: a kill is repeated for 4 s."""
        await client.unsubscribe(self._topic)
        heed_cancellation()
        await asyncio.sleep(REOPEN_S)
        while len(client.messages):
            await anext(client.messages)
        await self._subscribe(client)


log = logging.getLogger("groundstation.mqtt")


def _warn(sentence: Sentence) -> None:
    log.warning("%s", sentence, extra={"event": sentence})


async def publish_forever(
    config: MqttConfig, latest: Latest[Snapshot], ask: Callable[[Request], Reply] | None = None
) -> None:
    """Publish what ``latest`` holds until cancelled, connecting again after every loss.

    What is asked by MQTT goes to ``ask``, where ``config`` lets anybody ask.

    Raises:
        ConfigError: a file of ``config`` can't be used. Nothing else.
    """
    broker = open_broker(config)
    clients = read_client_keys(config) if config.requests.enabled else None
    _, first = await latest.newer()
    publisher = _Publisher(config, first.vehicle, latest)
    if clients is not None and ask is not None:
        place = Place(config.prefix, first.vehicle)
        publisher.requests = RequestListener(place, clients, ask, _warn)
    # The same name in each connection: the broker drops one that is half dead, with its last will,
    # for the next.
    name = f"groundstation-{first.vehicle}-{os.urandom(4).hex()}"
    collecting = asyncio.create_task(publisher.collect())
    reachable = True
    try:
        while True:
            reachable = await _publish_once(broker, publisher, name, was_reachable=reachable)
            heed_cancellation()
            await asyncio.sleep(REOPEN_S)
    finally:
        collecting.cancel()


async def _publish_once(
    broker: MqttBroker, publisher: "_Publisher", name: str, *, was_reachable: bool
) -> bool:
    """Publish over one connection until it breaks.

    Returns whether the broker is thought to be reachable; a loss is reported once.
    """
    import aiomqtt

    will = aiomqtt.Will(publisher.topic(STATE), OFFLINE, qos=STATE.quality, retain=STATE.retained)
    try:
        async with broker.client(
            identifier=name,
            will=will,
            heard_max_bytes=2 * REQUEST_MAX_BYTES,  # its topic comes in addition
            max_queued_incoming_messages=int(MOST_MESSAGES.burst),
        ) as client:
            level = logging.INFO if was_reachable else logging.WARNING
            log.log(level, "%s", notice("mqtt.publishing", broker=broker))
            was_reachable = True
            heed_cancellation()
            await publisher.run(client)
    except (aiomqtt.MqttError, ValueError) as error:  # ValueError: no possible host name
        if was_reachable:
            log.warning("%s", notice("mqtt.no_broker", broker=broker, why=describe_error(error)))
        return False
    return True


class _Publisher:
    """Published and waiting messages, kept from one connection to the next."""

    def __init__(self, config: MqttConfig, vehicle: str, latest: Latest[Snapshot]) -> None:
        self._root = f"{config.prefix}/{vehicle}"
        self._period_s = 1.0 / config.rate_hz
        self._health_s = config.health_period_s
        self._latest = latest
        self._events: deque[EventMessage] = deque()
        self._more = asyncio.Event()
        self._counts: Counter[str] = Counter()
        self._state = ""
        """State of the mission as last published."""
        self.requests: RequestListener | None = None

    def topic(self, topic: Topic) -> str:
        return f"{self._root}/{topic.name}"

    async def collect(self) -> None:
        """Gather events until cancelled, whether there is a broker or not."""
        seen: tuple[Notice, ...] = ()
        number = 0
        async for snapshot in self._latest.values():
            for one in new_events(seen, snapshot.events):
                number += 1
                self._events.append(
                    EventMessage(number, round(one.time_s, 3), one.says, one.id, one.numbers)
                )
                self._more.set()
            seen = snapshot.events
            while len(self._events) > KEPT:
                self._events.popleft()
                self._counts["events_lost"] += 1

    async def run(self, client: "aiomqtt.Client") -> None:
        """Publish over one connection until it breaks or we are cancelled.

        Then say goodbye if we still can.
        """
        import aiomqtt

        self._counts["connections"] += 1
        work = [self._snapshots(client), self._publish_events(client), self._health(client)]
        if self.requests is not None:
            work += [
                self.requests.listen(client, self._put),
                self.requests.answer(client, self._put),
            ]
        try:
            await _together(work)
        except asyncio.CancelledError:
            # A clean end does not trigger the last will.
            with contextlib.suppress(aiomqtt.MqttError):
                await self._send(client, STATE, OFFLINE.encode(), timeout_s=1.0)
                if self.requests is not None:
                    await self._send(client, SESSION, b"", timeout_s=1.0)
            raise

    async def _snapshots(self, client: "aiomqtt.Client") -> None:
        self._state = ""
        async for snapshot in self._latest.values(self._period_s):
            if snapshot.state != self._state:
                self._state = snapshot.state
                await self._put(client, STATE, self._state.encode())
            await self._put(client, SNAPSHOT, msgspec.json.encode(snapshot))
            self._counts["snapshots"] += 1

    async def _publish_events(self, client: "aiomqtt.Client") -> None:
        while True:
            while self._events:
                event = self._events[0]
                await self._put(client, EVENT, msgspec.json.encode(event))
                # Otherwise the newest have pushed it out meanwhile.
                if self._events and self._events[0] is event:
                    self._events.popleft()
            self._more.clear()
            await self._more.wait()

    async def _health(self, client: "aiomqtt.Client") -> None:
        """Publish the health, and again what the broker retains.

        An earlier connection of this vehicle, of a program that was killed or behind a network that
        was gone, can overwrite what is retained long after we have published it: by its last will,
        or by messages that were still on their way.
        """
        while True:
            counts = self._counts
            requests = {} if self.requests is None else dict(sorted(self.requests.counts.items()))
            health = HealthMessage(
                __version__,
                counts["connections"],
                counts["snapshots"],
                counts["events_lost"],
                requests,
            )
            await self._put(client, HEALTH, msgspec.json.encode(health))
            await self._put(
                client, SESSION, b"" if self.requests is None else self.requests.session_message()
            )
            await asyncio.sleep(self._health_s)
            if self._state:
                await self._put(client, STATE, self._state.encode())

    async def _put(self, client: "aiomqtt.Client", topic: Topic, payload: bytes) -> None:
        await self._send(client, topic, payload)
        heed_cancellation()

    async def _send(
        self, client: "aiomqtt.Client", topic: Topic, payload: bytes, timeout_s: float = ANSWER_S
    ) -> None:
        await client.publish(
            self.topic(topic),
            payload,
            qos=topic.quality,
            retain=topic.retained,
            properties=properties(topic),
            timeout=timeout_s,
        )


async def _together(work: list[Coroutine[Any, Any, None]]) -> None:
    """Run all until one fails, and raise what it has raised.

    No TaskGroup: before Python 3.13 one that has failed leaves its task marked as cancelled.
    """
    tasks = [asyncio.create_task(one) for one in work]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_EXCEPTION)
        for task in done:
            task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
