"""MQTT by a real mosquitto: telemetry, while it goes away and comes back, too, and requests."""

import asyncio
import contextlib
import gc
import signal
import sys
from collections import defaultdict
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path
from typing import Any

import aiomqtt
import msgspec
import pytest

from groundstation.config import from_dict
from groundstation.core.messages import Ask, Notice, Snapshot
from groundstation.interfaces.api.messages import Desk
from groundstation.interfaces.mqtt import (
    broker as mqtt_broker,
    command as mqtt_command,
    describe_error,
    from_url,
    publish_forever,
)
from groundstation.interfaces.mqtt.command import Unanswered, request_by_mqtt
from groundstation.interfaces.mqtt.messages import EventMessage, HealthMessage, SessionMessage
from groundstation.interfaces.mqtt.requests import Place, seal_request
from groundstation.machine import Latest, wall_ms
from groundstation.settings import Config, MqttConfig
from links.io import make_key, read_key
from tests.e2e.lab_broker import Broker, LabBroker, broker, free_tcp_port, lab
from tests.loops import in_real_time
from tests.sample_flight import Sampled, sample

__all__ = ["broker", "lab"]


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


# ---- requests, as a laboratory has it: TLS, passwords and access rules

MAY = '["hold", "return", "track", "land", "abort", "kill"]'


@pytest.fixture
def key(tmp_path: Path) -> Iterator[Path]:
    make_key(tmp_path / "tablet.key")
    yield tmp_path / "tablet.key"


def config_of(lab: LabBroker, key: Path | None, vehicle: str = "mqx", **more: str) -> MqttConfig:
    overrides = [f"{name}={value}" for name, value in {**lab.settings(vehicle), **more}.items()]
    if key is not None:
        overrides += [
            "mqtt.requests.enabled=true",
            f"mqtt.requests.clients.tablet.key_file={key}",
            f"mqtt.requests.clients.tablet.may={MAY}",
        ]
    return from_dict({}, Config, [*overrides, "mqtt.health_period_s=0.1"]).mqtt


class Station:
    """A station without a flight: it remembers what was asked of it."""

    def __init__(self) -> None:
        self.core = Sampled()
        self.desk = Desk("mqx", self.core)

    @contextlib.asynccontextmanager
    async def serving(self, config: MqttConfig) -> AsyncIterator[None]:
        latest: Latest[Snapshot] = Latest()
        latest.put(sample(1.0))
        task = asyncio.create_task(publish_forever(config, latest, self.desk.from_afar))
        try:
            yield
            assert not task.done()
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)


async def retained(client: aiomqtt.Client, topic: str) -> bytes:
    """The next non-empty message on ``topic``."""
    await client.subscribe(topic)
    async for message in client.messages:
        if message.payload:
            assert isinstance(message.payload, bytes)
            return message.payload
    raise AssertionError("unreachable")


async def counted(client: aiomqtt.Client, least: int) -> dict[str, int]:
    """The outcomes of the requests, once they are so many."""
    await client.subscribe("groundstation/mqx/health")
    async for message in client.messages:
        if str(message.topic).endswith("health"):
            counts = msgspec.json.decode(message.payload, type=HealthMessage).requests
            if sum(counts.values()) >= least:
                return counts
    raise AssertionError("unreachable")


@in_real_time
async def test_a_request_is_done_and_answered_and_a_dropped_one_counted_where_all_can_see(
    lab: LabBroker, key: Path
) -> None:
    station = Station()

    secret = read_key(key)
    operator = lab.address("operator")
    async with station.serving(config_of(lab, key)), operator.client() as client:
        answer = await request_by_mqtt(operator, "mqx", "tablet", secret, "land", "too windy")
        assert (answer.done, answer.says) == (True, "land: too windy (tablet by MQTT)")
        assert [request.ask for request in station.core.asked] == [Ask.LAND]

        session = msgspec.json.decode(
            await retained(client, "groundstation/mqx/request/session"), type=SessionMessage
        )
        topic, place = "groundstation/mqx/request", Place("groundstation", "mqx")
        now = wall_ms()
        good = seal_request(secret, place, session.session, "tablet", now, "kill", now + 3000)
        for data in (b"{}", good[:-5], good.replace(b'"kill"', b'"hold"'), b" " * 60000):
            await client.publish(topic, data, qos=1)
        await client.publish(
            topic, seal_request(secret, place, session.session, "tablet", 7, "kill", now), qos=1
        )
        # A station that comes later must not hear it.
        await client.publish(topic, good, qos=1, retain=True)
        await client.publish(topic, good, qos=1)
        await client.publish(topic, good, qos=1)
        counts = await counted(client, 8)
        # Of 60 kB the broker has told nobody: a station says that it takes no such packet.
        assert counts == {"done": 2, "malformed": 2, "replayed": 3, "unauthenticated": 1}
        assert [request.ask for request in station.core.asked] == [Ask.LAND, Ask.KILL]
    async with station.serving(config_of(lab, key)):  # another session, in which nothing old counts
        await client_published(lab, topic, good)
        await asyncio.sleep(0.3)
    assert len(station.core.asked) == 2


async def client_published(lab: LabBroker, topic: str, data: bytes) -> None:
    async with lab.address("operator").client() as client:
        await client.publish(topic, data, qos=1)


@in_real_time
async def test_who_asks_reads_why_nothing_came_of_it(
    lab: LabBroker, key: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Four of them wait for as long as an operator would.
    monkeypatch.setattr(mqtt_command, "LIFE_MS", 500)
    make_key(tmp_path / "other.key")
    operator, secret = lab.address("operator"), read_key(key)
    station = Station()
    with pytest.raises(Unanswered, match="'mqx' is not known to this broker"):
        await request_by_mqtt(operator, "mqx", "tablet", secret, "land")
    async with station.serving(config_of(lab, None)):
        with pytest.raises(Unanswered, match="takes no requests by MQTT"):
            await request_by_mqtt(operator, "mqx", "tablet", secret, "land")
    with pytest.raises(Unanswered, match="no station flies 'mqx' now"):
        await request_by_mqtt(operator, "mqx", "tablet", secret, "land")
    async with station.serving(config_of(lab, key)):
        with pytest.raises(Unanswered, match="it may not know 'tablet' by this key"):
            await request_by_mqtt(
                operator, "mqx", "tablet", read_key(tmp_path / "other.key"), "land"
            )
        # The session came again and again, and was asked of once.
        async with operator.client() as client:
            assert await counted(client, 1) == {"unauthenticated": 1}
        # The access rules do not let a viewer publish.
        with pytest.raises(Unanswered, match="has not answered"):
            await request_by_mqtt(lab.address("viewer"), "mqx", "tablet", secret, "land")
    assert station.core.asked == []


@in_real_time
async def test_a_kill_is_heard_in_a_flood_and_all_else_once_it_is_over(
    lab: LabBroker, key: Path
) -> None:
    station = Station()

    async def flood(client: aiomqtt.Client) -> None:
        while True:
            await client.publish("groundstation/mqx/request", b"{}")
            await asyncio.sleep(0.006)

    operator, secret = lab.address("operator"), read_key(key)
    async with station.serving(config_of(lab, key)), operator.client() as client:
        await retained(client, "groundstation/mqx/request/session")
        for _ in range(200):
            await client.publish("groundstation/mqx/request", b"{}")
        flooding = asyncio.create_task(flood(client))
        for _ in range(3):
            assert (await request_by_mqtt(operator, "mqx", "tablet", secret, "kill")).done
        flooding.cancel()
        await asyncio.gather(flooding, return_exceptions=True)
        await asyncio.sleep(1.0)
        assert (await request_by_mqtt(operator, "mqx", "tablet", secret, "land")).done
        assert (await counted(client, 1))["flooded"] >= 1
    assert [request.ask for request in station.core.asked] == [*3 * [Ask.KILL], Ask.LAND]


# paho leaves a failed handshake's socket to Python.
@pytest.mark.filterwarnings("ignore:unclosed:ResourceWarning")
def test_a_broker_of_another_authority_is_not_spoken_to(
    lab: LabBroker,
    needs_program: Callable[..., str],
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    stranger = LabBroker(needs_program("mosquitto"), tmp_path / "stranger", "mqx")

    async def scene(ca: Path, more: dict[str, str], patience_s: float = 30.0) -> None:
        station = Station()
        config = config_of(lab, None, **{"mqtt.tls.ca_file": str(ca), **more})
        async with lab.address("viewer").client() as client:
            # Before its only one, which no broker keeps.
            await client.subscribe("groundstation/mqx/snapshot")
            async with station.serving(config), asyncio.timeout(patience_s):
                await anext(aiter(client.messages))

    with pytest.raises(TimeoutError):
        asyncio.run(scene(stranger.folder / "ca.crt", {}, 0.7))
    assert "certificate verify failed" in caplog.text
    asyncio.run(scene(lab.folder / "ca.crt", {}))
    asyncio.run(scene(lab.folder / "ca.crt", {"mqtt.tls.verify": "false"}))
    assert "NOT VERIFIED" in caplog.text
    gc.collect()


@in_real_time
async def test_a_station_can_speak_for_no_other_vehicle_and_nobody_without_a_password(
    lab: LabBroker,
) -> None:
    anonymous = lab.address("mqx")
    nobody = msgspec.structs.replace(
        anonymous,
        password=None,
        config=msgspec.structs.replace(anonymous.config, username="", password_file=""),
    )
    with pytest.raises(aiomqtt.MqttError, match=r"[Nn]ot authori[sz]ed") as refused:
        await nobody.client().__aenter__()
    told = describe_error(refused.value)
    assert told.startswith("the login was refused"), told
    assert told.endswith("check the user's name and password")
    async with lab.address("viewer").client() as viewer, lab.address("mqx").client() as mqx:
        await viewer.subscribe("groundstation/#")
        await mqx.publish("groundstation/quad2/state", b"landed", qos=1)
        await viewer.publish("groundstation/quad2/request", b"kill", qos=1)
        await mqx.publish("groundstation/mqx/state", b"ready", qos=1)
        message = await anext(aiter(viewer.messages))
        assert str(message.topic) == "groundstation/mqx/state"
