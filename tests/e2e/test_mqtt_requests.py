"""Requests by a real broker with TLS, passwords and access rules, as a laboratory has it."""

import asyncio
import contextlib
import gc
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path

import aiomqtt
import msgspec
import pytest

from groundstation.config import from_dict
from groundstation.core.messages import Ask, Snapshot
from groundstation.interfaces.api.messages import Desk
from groundstation.interfaces.mqtt import command as mqtt_command, describe_error, publish_forever
from groundstation.interfaces.mqtt.command import Unanswered, request_by_mqtt
from groundstation.interfaces.mqtt.messages import HealthMessage, SessionMessage
from groundstation.interfaces.mqtt.requests import Place, seal_request
from groundstation.machine import Latest, wall_ms
from groundstation.settings import Config, MqttConfig
from links.io import make_key, read_key
from tests.e2e.lab_broker import LabBroker, lab
from tests.loops import in_real_time
from tests.sample_flight import Sampled, sample

__all__ = ["lab"]

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
    """What became of the requests, once they are so many."""
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
