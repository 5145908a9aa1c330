"""Telemetry to an MQTT v5 broker. The broker may be away or slow at any time: the flight never notices.

The topics are in mqtt_messages.py and docs/reference/mqtt.md. Nothing is queued but the newest 100 events: whoever
reads late reads the newest.
"""

import asyncio
import contextlib
import logging
import os
from collections import Counter, deque
from collections.abc import Callable, Coroutine
from typing import TYPE_CHECKING, Any

import msgspec

from groundstation.core.messages import Reply, Request, Snapshot
from groundstation.interfaces.mqtt.broker import HEARD_MAX_BYTES, TIMEOUT_S, heed_cancellation, in_words, opened
from groundstation.interfaces.mqtt.messages import (
    EVENT,
    HEALTH,
    OFFLINE,
    SESSION,
    SNAPSHOT,
    STATE,
    Event,
    Health,
    Topic,
    event_of,
    properties,
    unseen,
)
from groundstation.interfaces.mqtt.requests import Requests, requests_of
from groundstation.runtime import Latest, __version__
from groundstation.settings import MqttConfig

if TYPE_CHECKING:
    import aiomqtt

RETRY_FIRST_S = 0.5
RETRY_MAX_S = 10.0
EVENTS_KEPT = 100
"""So many events wait for a broker that is away; older ones are lost, and counted."""
HEARD_QUEUE = 256
"""Messages that wait for us; more of them are dropped by the library."""

log = logging.getLogger("groundstation.mqtt")


async def publish_forever(
    config: MqttConfig, latest: Latest[Snapshot], ask: Callable[[Request], Reply] | None = None
) -> None:
    """Publish what ``latest`` holds until cancelled, connecting again with growing pauses after every loss.

    What is asked by MQTT goes to ``ask``, where ``config`` lets anybody ask.

    Raises:
        ConfigError: a file of ``config`` can't be used. Nothing else.
    """
    import aiomqtt

    broker = opened(config)
    keys = requests_of(config) if config.requests.enabled else None
    _, first = await latest.newer()
    publisher = _Publisher(config, first.vehicle, latest)
    if keys is not None and ask is not None:
        publisher.requests = keys.of(first.vehicle, ask, lambda line: log.warning("%s", line))
    # The same name in each connection: the broker drops one that is half dead, with its last will, for the next.
    name = f"groundstation-{first.vehicle}-{os.urandom(4).hex()}"
    collecting = asyncio.create_task(publisher.collect())
    pause_s = RETRY_FIRST_S
    reachable = True
    try:
        while True:
            will = aiomqtt.Will(publisher.topic(STATE), OFFLINE, qos=STATE.quality, retain=STATE.retained)
            try:
                async with broker.client(
                    identifier=name,
                    will=will,
                    heard_max_bytes=HEARD_MAX_BYTES,
                    max_queued_incoming_messages=HEARD_QUEUE,
                ) as client:
                    log.log(logging.INFO if reachable else logging.WARNING, "publishing to %s", broker)
                    reachable, pause_s = True, RETRY_FIRST_S
                    heed_cancellation()
                    await publisher.run(client)
            except (aiomqtt.MqttError, ValueError) as error:  # ValueError: no possible host name
                if reachable:
                    log.warning("no broker at %s (%s); trying again", broker, in_words(error))
                reachable = False
            heed_cancellation()
            await asyncio.sleep(pause_s)
            pause_s = min(2.0 * pause_s, RETRY_MAX_S)
    finally:
        collecting.cancel()


class _Publisher:
    """What was published already, and what waits, kept from one connection to the next."""

    def __init__(self, config: MqttConfig, vehicle: str, latest: Latest[Snapshot]) -> None:
        self._root = f"{config.prefix}/{vehicle}"
        self._period_s = 1.0 / config.rate_hz
        self._health_s = config.health_period_s
        self._latest = latest
        self._events: deque[Event] = deque()
        self._more = asyncio.Event()
        self._counts: Counter[str] = Counter()
        self._version = __version__
        self.requests: Requests | None = None

    def topic(self, topic: Topic) -> str:
        return f"{self._root}/{topic.name}"

    async def collect(self) -> None:
        """Gather events until cancelled, whether there is a broker or not."""
        seen: tuple[str, ...] = ()
        number = 0
        async for snapshot in self._latest.values():
            for line in unseen(seen, snapshot.events):
                number += 1
                self._events.append(event_of(number, line))
                self._more.set()
            seen = snapshot.events
            while len(self._events) > EVENTS_KEPT:
                self._events.popleft()
                self._counts["events_lost"] += 1

    async def run(self, client: "aiomqtt.Client") -> None:
        """Publish over one connection until it breaks or we are cancelled; then say goodbye if we still can.

        Raises:
            MqttError: the connection is gone.
        """
        import aiomqtt

        self._counts["connections"] += 1
        work = [self._snapshots(client), self._publish_events(client), self._health(client)]
        if self.requests is None:
            work.append(self._put(client, SESSION, b""))  # nobody shall think that one still counts
        else:
            work += [self.requests.listen(client, self._put), self.requests.answer(client, self._put)]
        try:
            await _together(work)
        except asyncio.CancelledError:
            with contextlib.suppress(aiomqtt.MqttError):  # a clean end does not trigger the last will
                await self._send(client, STATE, OFFLINE.encode(), timeout_s=1.0)
                if self.requests is not None:
                    await self._send(client, SESSION, b"", timeout_s=1.0)
            raise

    async def _snapshots(self, client: "aiomqtt.Client") -> None:
        state = None
        async for snapshot in self._latest.values(self._period_s):
            if snapshot.state != state:
                state = snapshot.state
                await self._put(client, STATE, state.encode())
            await self._put(client, SNAPSHOT, msgspec.json.encode(snapshot))
            self._counts["snapshots"] += 1

    async def _publish_events(self, client: "aiomqtt.Client") -> None:
        while True:
            while self._events:
                event = self._events[0]
                await self._put(client, EVENT, msgspec.json.encode(event))
                if self._events and self._events[0] is event:  # else the newest have pushed it out meanwhile
                    self._events.popleft()
            self._more.clear()
            await self._more.wait()

    async def _health(self, client: "aiomqtt.Client") -> None:
        while True:
            counts = self._counts
            requests = {} if self.requests is None else dict(sorted(self.requests.counts.items()))
            health = Health(self._version, counts["connections"], counts["snapshots"], counts["events_lost"], requests)
            await self._put(client, HEALTH, msgspec.json.encode(health))
            await asyncio.sleep(self._health_s)

    async def _put(self, client: "aiomqtt.Client", topic: Topic, payload: bytes) -> None:
        await self._send(client, topic, payload)
        heed_cancellation()

    async def _send(self, client: "aiomqtt.Client", topic: Topic, payload: bytes, timeout_s: float = TIMEOUT_S) -> None:
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
