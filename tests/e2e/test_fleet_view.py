"""The fleet view: from a real broker with ten stations, and its keys, at two sizes."""

import asyncio
from collections.abc import Callable

import msgspec
import pytest
from textual.widgets import DataTable, Static

from groundstation.interfaces.mqtt import MqttBroker, from_url
from groundstation.interfaces.tui.fleet import FleetMonitor, FleetScreen
from groundstation.interfaces.tui.widgets import Banner
from tests.e2e.lab_broker import LabBroker, lab
from tests.loops import in_real_time
from tests.sample_flight import sample

__all__ = ["lab"]


def shown(screen: FleetScreen) -> list[list[str]]:
    table = screen.query_one(DataTable)
    return [[str(cell) for cell in table.get_row_at(index)] for index in range(table.row_count)]


def told(screen: FleetScreen) -> str:
    return str(screen.query_one("#chosen", Static).content)


def headline(screen: FleetScreen) -> str:
    return str(screen.query_one(Banner).render())


def hear(fleet: FleetMonitor, name: str, state: str, now_s: float) -> None:
    snapshot = msgspec.structs.replace(sample(1.0, vehicle=name), state=state)
    fleet.hear(f"groundstation/{name}/state", state.encode(), now_s)
    fleet.hear(f"groundstation/{name}/snapshot", msgspec.json.encode(snapshot), now_s)


@pytest.mark.parametrize("size", [(60, 20), (160, 48)])
@in_real_time
async def test_keys_choose_and_the_worst_is_seen_first(size: tuple[int, int]) -> None:
    screen = FleetScreen(from_url("mqtt://127.0.0.1:1"))  # nobody is there
    async with screen.run_test(size=size) as pilot:
        now_s = asyncio.get_running_loop().time()
        for name, state in (("a", "ready"), ("b", "tracking"), ("c", "aborted")):
            hear(screen.fleet, name, state, now_s)
        screen.draw()
        await pilot.pause()
        assert [cells[:2] for cells in shown(screen)] == [
            ["c", "!!ABORTED"],
            ["b", "▲ TRACKING"],
            ["a", "· READY"],
        ]
        assert told(screen).startswith("c: ABORTED - following the trajectory")
        await pilot.press("down")
        await pilot.pause()
        assert told(screen).startswith("b: TRACKING")
        hear(screen.fleet, "b", "landing", now_s + 0.1)
        screen.draw()
        assert shown(screen)[1][1] == "▲ LANDING"
        await pilot.pause()
        assert screen.query_one("#details").region.bottom <= size[1]
        assert told(screen).startswith("b: LANDING")  # the same one as before
        screen._trouble = "mqtts://broker.lab.example:8883 as viewer: Connection refused"
        screen.draw()
        assert "Connection refused" in " ".join(headline(screen).split())
        await pilot.press("q")


@in_real_time
async def test_a_broker_is_found_lost_and_found_again(lab: LabBroker) -> None:
    async def until(screen: FleetScreen, true: Callable[[], bool]) -> None:
        async with asyncio.timeout(60.0):
            while not true():
                await asyncio.sleep(0.05)
                screen.draw()

    async def say(broker: MqttBroker, topic: str, payload: bytes) -> None:
        async with broker.client() as station:
            await station.publish(topic, payload, qos=1, retain=True)

    screen = FleetScreen(lab.address("viewer"))
    async with screen.run_test(size=(100, 30)):
        await until(screen, lambda: "none has published" in headline(screen))
        await say(lab.address("quad2"), "groundstation/quad2/state", b"offline")
        await until(
            screen, lambda: [cells[:2] for cells in shown(screen)] == [["quad2", "  OFFLINE"]]
        )
        lab.kill()
        await until(screen, lambda: f"localhost:{lab.port}: " in headline(screen))
        await lab.start()
        await until(screen, lambda: "1 offline" in headline(screen))
        await say(lab.address("quad2"), "groundstation/quad2/state", b"ready")
        await until(screen, lambda: shown(screen)[0][1] == "!!NO DATA")
