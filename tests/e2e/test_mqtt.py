"""Telemetry to a real mosquitto on a loopback port, which also goes away and comes back."""

import asyncio
import contextlib
import gc
import signal
import socket
import subprocess
import sys
from collections import defaultdict
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path
from typing import Any

import aiomqtt
import msgspec
import pytest

from groundstation.core.messages import Notice, Snapshot
from groundstation.interfaces.mqtt import broker as mqtt_broker, from_url, publish_forever
from groundstation.interfaces.mqtt.messages import EventMessage
from groundstation.machine import Latest
from groundstation.settings import MqttConfig
from tests.known import known
from tests.loops import in_real_time
from tests.sample_flight import sample


class Broker:
    """A mosquitto of our own."""

    def __init__(self, program: str, config: Path, port: int) -> None:
        self.port = port
        self._program = program
        self._config = config
        self._process: subprocess.Popen[bytes] | None = None

    async def start(self) -> None:
        self._launch()
        while True:
            with contextlib.suppress(OSError):
                _, writer = await asyncio.open_connection("127.0.0.1", self.port)
                writer.close()
                return
            assert known(self._process).poll() is None, "mosquitto did not start"
            await asyncio.sleep(0.01)

    def _launch(self) -> None:
        command = (self._program, "-c", self._config)
        self._process = subprocess.Popen(command, stderr=subprocess.DEVNULL)

    def send_signal(self, number: signal.Signals) -> None:
        known(self._process).send_signal(number)

    def kill(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None


@pytest.fixture
def broker(needs_program: Callable[..., str], tmp_path: Path) -> Iterator[Broker]:
    """One that lets everybody in; it does not run yet."""
    config, port = tmp_path / "mosquitto.conf", free_tcp_port()
    open_to_all = "persistence false\nuser root\nallow_anonymous true\n"
    config.write_text(f"listener {port} 127.0.0.1\n{open_to_all}")
    made = Broker(needs_program("mosquitto"), config, port)
    yield made
    made.kill()


def free_tcp_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Listener:
    """All that a broker delivers, by topic."""

    def __init__(self, port: int) -> None:
        self.got: dict[str, list[str]] = defaultdict(list)
        self.retained: dict[str, str] = {}
        self._client = aiomqtt.Client("127.0.0.1", port, protocol=aiomqtt.ProtocolVersion.V5)

    async def __aenter__(self) -> "Listener":
        await self._client.__aenter__()
        await self._client.subscribe("#", qos=1)
        self._task = asyncio.create_task(self._listen())
        return self

    async def __aexit__(self, *_: object) -> None:
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)
        with contextlib.suppress(aiomqtt.MqttError):
            await self._client.__aexit__(None, None, None)

    async def _listen(self) -> None:
        async for message in self._client.messages:
            assert isinstance(message.payload, bytes)
            topic, text = str(message.topic), message.payload.decode()
            if text:
                self.got[topic].append(text)
            if message.retain:
                self.retained[topic] = text

    async def until(self, true: Callable[["Listener"], bool]) -> None:
        while not true(self):
            await asyncio.sleep(0.01)


async def pass_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with contextlib.suppress(OSError):
        while data := await reader.read(65536):
            writer.write(data)
    writer.close()


STATE, SNAPSHOT, EVENT, HEALTH = (
    f"lab/mqx/{name}" for name in ("state", "snapshot", "event", "health")
)
SESSION = "lab/mqx/request/session"


@contextlib.asynccontextmanager
async def publishing(
    config: MqttConfig, latest: Latest[Snapshot]
) -> AsyncIterator[asyncio.Task[None]]:
    task = asyncio.create_task(publish_forever(config, latest))
    try:
        yield task
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


def config_for(broker: Broker, **more: Any) -> MqttConfig:
    return MqttConfig(enabled=True, port=broker.port, prefix="lab", rate_hz=50.0, **more)


@in_real_time
async def test_state_events_and_snapshots_arrive_and_the_state_ends_offline(broker: Broker) -> None:
    await broker.start()
    latest: Latest[Snapshot] = Latest()
    async with Listener(broker.port) as listener:
        async with publishing(config_for(broker), latest):
            latest.put(sample(1.0, state="ready"))
            await listener.until(lambda to: bool(to.got[SNAPSHOT]))
            flying = sample(2.0)
            more = (*flying.events, Notice(102.0, "tracking", "wind"))
            latest.put(msgspec.structs.replace(flying, events=more))
            await listener.until(lambda to: len(to.got[SNAPSHOT]) == 2)
        await listener.until(lambda to: to.got[STATE][-1:] == ["offline"])
    assert listener.got[STATE] == ["ready", "tracking", "offline"]
    events = [msgspec.json.decode(text, type=EventMessage) for text in listener.got[EVENT]]
    told = [f"{one.time_s:.3f} {one.text}" for one in events]
    assert told == [*(notice.line for notice in sample(1.0).events), "102.000 wind"]
    assert [one.number for one in events] == [1, 2, 3]
    assert SESSION not in listener.got  # an empty one: whoever retained it has withdrawn it
    first = msgspec.json.decode(listener.got[SNAPSHOT][0], type=Snapshot)
    assert first == sample(1.0, state="ready")
    async with Listener(broker.port) as late:
        await late.until(lambda to: STATE in to.retained)
        assert set(late.retained) <= {STATE, HEALTH}
        assert late.retained[STATE] == "offline"


PUBLISHER = """
import asyncio, sys
from groundstation.machine.outlets import Latest
from groundstation.interfaces.mqtt.publisher import publish_forever
from groundstation.settings.settings import MqttConfig
from tests.sample_flight import sample
latest = Latest(); latest.put(sample(1.0))
asyncio.run(publish_forever(MqttConfig(port=int(sys.argv[1]), prefix="lab"), latest))
"""
"""A station that publishes until it is killed, by the broker's port."""


@in_real_time
async def test_the_broker_declares_a_publisher_that_vanished_offline(broker: Broker) -> None:
    await broker.start()
    command = (sys.executable, "-c", PUBLISHER, str(broker.port))
    async with Listener(broker.port) as listener:
        process = await asyncio.create_subprocess_exec(*command)
        await listener.until(lambda to: bool(to.got[SNAPSHOT]))
        process.kill()
        await process.wait()
        await listener.until(lambda to: to.got[STATE] == ["tracking", "offline"])


def told(listener: Listener) -> list[str]:
    """The texts of the events that it got."""
    return [msgspec.json.decode(text, type=EventMessage).text for text in listener.got[EVENT]]


@in_real_time
async def test_a_broker_that_comes_back_misses_no_event(
    broker: Broker, caplog: pytest.LogCaptureFixture
) -> None:
    latest: Latest[Snapshot] = Latest()
    flying = sample(2.0)
    latest.put(flying)
    port = free_tcp_port()

    async def carry(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        there, back = await asyncio.open_connection("127.0.0.1", broker.port)
        await asyncio.gather(pass_on(reader, back), pass_on(there, writer))

    @contextlib.asynccontextmanager
    async def there() -> AsyncIterator[Listener]:
        """For a while the broker is; the station finds it only once somebody listens."""
        await broker.start()
        async with Listener(broker.port) as listener:
            way = await asyncio.start_server(carry, "127.0.0.1", port)
            yield listener
            way.close()
        broker.kill()

    async with publishing(msgspec.structs.replace(config_for(broker), port=port), latest) as task:
        await asyncio.sleep(0.2)  # nobody is there yet
        async with there() as listener:
            await listener.until(lambda to: bool(to.got[SNAPSHOT]))
            await listener.until(lambda to: len(to.got[EVENT]) == len(flying.events))
        lost = msgspec.structs.replace(
            flying, events=(*flying.events, Notice(103.0, "tracking", "while the broker was away"))
        )
        for _ in range(50):
            latest.put(lost)
            await asyncio.sleep(0.005)
        assert not task.done()
        async with there() as listener:
            await listener.until(lambda to: bool(to.got[SNAPSHOT]))
            await listener.until(lambda to: told(to)[-1:] == ["while the broker was away"])
            # What the broker had passed on, but not acknowledged, as it was killed comes again.
            assert told(listener)[:-1] in ([], [flying.events[-1].says])
            assert listener.got[STATE] == ["tracking"]
        assert not task.done()
    said = [record.message for record in caplog.records if record.name == "groundstation.mqtt"]
    assert [line.partition(" ")[0] for line in said] == ["not", "publishing", "not", "publishing"]


@in_real_time
async def test_a_broker_that_stands_still_delays_nobody_and_gets_the_newest_after(
    broker: Broker,
) -> None:
    await broker.start()
    loop = asyncio.get_running_loop()
    latest: Latest[Snapshot] = Latest()
    latest.put(sample(0.0))
    async with Listener(broker.port) as listener, publishing(config_for(broker), latest) as task:
        await listener.until(lambda to: bool(to.got[SNAPSHOT]))
        broker.send_signal(signal.SIGSTOP)
        slowest = 0.0
        for number in range(300):
            before = loop.time()
            latest.put(sample(1.0 + number))
            await asyncio.sleep(0.005)
            slowest = max(slowest, loop.time() - before)
        assert not task.done()
        broker.send_signal(signal.SIGCONT)
        await listener.until(
            lambda to: msgspec.json.decode(to.got[SNAPSHOT][-1], type=Snapshot) == sample(300.0)
        )
        assert len(listener.got[SNAPSHOT]) < 150
    assert slowest < 0.5


def test_a_broker_that_drops_a_connection_that_was_given_up_is_no_error(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """One that stood still accepts the old connection as it goes on, and drops it for the new."""
    monkeypatch.setattr(mqtt_broker, "ANSWER_S", 0.1)
    accepted = bytes((0x20, 3, 0, 0, 0))  # CONNACK, MQTT 5.0, section 3.2

    async def accept_late(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.read(100)
        await asyncio.sleep(0.2)
        writer.write(accepted)
        writer.close()

    async def give_up() -> None:
        async with await asyncio.start_server(accept_late, "127.0.0.1", 0) as server:
            port = server.sockets[0].getsockname()[1]
            with pytest.raises(aiomqtt.MqttError, match="timed out"):
                await from_url(f"mqtt://127.0.0.1:{port}").client().__aenter__()
            await asyncio.sleep(0.3)

    asyncio.run(give_up())
    gc.collect()
    assert not [record.message for record in caplog.records if record.name == "asyncio"]


@pytest.mark.parametrize("topic", [STATE, SESSION])
@in_real_time
async def test_whatever_is_retained_is_published_again_with_the_health(
    broker: Broker, topic: str
) -> None:
    """An older connection's last will may overwrite it long after the next one began."""

    await broker.start()
    latest: Latest[Snapshot] = Latest()
    latest.put(sample(1.0))
    wanted = {STATE: "tracking", SESSION: ""}  # it takes no requests: no session
    async with (
        publishing(config_for(broker, health_period_s=0.1), latest),
        aiomqtt.Client("127.0.0.1", broker.port) as client,
        Listener(broker.port) as listener,
    ):
        await listener.until(lambda to: bool(to.got[HEALTH]))
        await client.publish(topic, "late", qos=1, retain=True)
        await listener.until(lambda to: "late" in to.got[topic])
        rounds = len(listener.got[HEALTH])
        await listener.until(lambda to: len(to.got[HEALTH]) > rounds + 2)
        async with Listener(broker.port) as late:
            await late.until(lambda to: HEALTH in to.retained)
            assert late.retained.get(topic, "") == wanted[topic]
