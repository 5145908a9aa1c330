"""The core API over real UNIX sockets: who may attach, what they get, and what they can't do."""

# a glance at a file does not hold up a test

import asyncio
import contextlib
import os
import re
import socket
import stat
from pathlib import Path
from typing import Any, cast

import msgspec
import pytest

from groundstation.config import ConfigError
from groundstation.core.messages import Ask, Request, Snapshot
from groundstation.interfaces.api import Control, ask_station, server as api_server, snapshots
from groundstation.interfaces.api.client import open_client
from groundstation.machine import ApiError, StatusConfig, find_socket, socket_path
from tests.dashboards import Stage
from tests.e2e.stations import program
from tests.loops import in_real_time
from tests.sample_flight import sample


@pytest.fixture
def station(tmp_path: Path) -> Stage:
    return Stage(tmp_path / "mqx.sock")


async def watch(station: Stage, seen: list[Snapshot]) -> None:
    async for snapshot in snapshots(station.path):
        seen.append(snapshot)


@pytest.fixture
def runtime(short_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder in which a station that is told no path has its socket, and is looked for."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(short_path))
    monkeypatch.delenv("RUNTIME_DIRECTORY", raising=False)
    return short_path / "groundstation"


@in_real_time
async def test_a_client_that_joins_late_gets_the_newest_snapshot(station: Stage) -> None:
    async with station.up():
        early = asyncio.create_task(station.first())
        await asyncio.sleep(0.05)
        assert not early.done()
        station.latest.put(sample(1.0))
        assert await early == sample(1.0)
        station.latest.put(sample(2.0))
        assert await station.first() == sample(2.0)
        stream = snapshots(station.path)
        assert await anext(stream) == sample(2.0)
        station.latest.put(sample(3.0))
        assert await anext(stream) == sample(3.0)


@in_real_time
async def test_the_socket_is_for_its_owner_alone_and_goes_away_at_the_end(station: Stage) -> None:
    async with station.up():
        assert stat.S_IMODE(station.path.stat().st_mode) == 0o600
    assert not station.path.exists()


@in_real_time
async def test_clients_get_the_last_snapshot_and_the_end_of_the_stream(station: Stage) -> None:
    seen: list[Snapshot] = []
    async with station.up(1.0):
        station.latest.put(sample(1.0))
        watcher = asyncio.create_task(watch(station, seen))
        while not seen:
            await asyncio.sleep(0.01)
        station.latest.put(sample(2.0, state="landed"))
    await watcher
    assert [snapshot.state for snapshot in seen] == ["tracking", "landed"]


def test_a_client_that_is_attached_as_the_program_ends_is_no_error(
    station: Stage, caplog: pytest.LogCaptureFixture
) -> None:
    async def end_with(client: socket.socket) -> None:
        server = station.server()
        await server.open()
        await asyncio.get_running_loop().sock_connect(client, str(station.path))
        await asyncio.get_running_loop().sock_recv(client, 1)
        server.close()

    with socket.socket(socket.AF_UNIX) as client:
        client.setblocking(False)
        asyncio.run(end_with(client))
    assert not caplog.messages


@in_real_time
async def test_no_client_gets_more_than_the_configured_rate(station: Stage) -> None:
    seen: list[Snapshot] = []
    async with station.up(10.0):
        watcher = asyncio.create_task(watch(station, seen))
        loop = asyncio.get_running_loop()
        start = loop.time()
        for i in range(100):
            station.latest.put(sample(0.01 * i))
            await asyncio.sleep(0.01)
        watcher.cancel()
        most = 10.0 * (loop.time() - start) + 2.0
    assert 3 <= len(seen) <= most < 100


@in_real_time
async def test_a_client_that_does_not_read_is_dropped_and_delays_nobody(station: Stage) -> None:
    large = msgspec.structs.replace(sample(0.0), reason="x" * 100_000)
    station.latest.put(large)
    async with station.up():
        sleepy, writer = await asyncio.open_unix_connection(station.path)
        stream = snapshots(station.path)
        for _ in range(30):
            assert await anext(stream) == large
            station.latest.put(large)
        got = 0
        with contextlib.suppress(ConnectionError):
            while chunk := await sleepy.read(1 << 20):
                got += len(chunk)
        assert got < 20 * 100_000
        writer.close()


@in_real_time
async def test_a_client_gets_a_configuration_as_long_as_a_line_may_be(station: Stage) -> None:
    """A course of thousands of points is part of the greeting, beyond what the kernel holds."""
    station.config_text = "#" * 900_000
    async with station.up():
        station.latest.put(sample(1.0))
        assert await station.first() == sample(1.0)


@in_real_time
async def test_a_flood_of_orders_waits_in_its_own_socket_and_the_others_are_served(
    station: Stage,
) -> None:
    async with station.up():
        _, writer = await asyncio.open_unix_connection(station.path)
        flood = asyncio.create_task(_flood(writer))
        await asyncio.sleep(0.3)
        assert not flood.done()
        most = api_server.ORDERS.burst + api_server.ORDERS.rate_hz * 0.4
        assert 0 < len(station.core.asked) <= most
        async with open_client(station.path) as client:
            answer = await client.ask(Request(Ask.LAND, "too windy"))
            assert answer.done
            station.latest.put(sample(2.0))
            assert await station.first() == sample(2.0)
        flood.cancel()
        writer.close()


async def _flood(writer: asyncio.StreamWriter) -> None:
    for start in range(0, 1_000_000, 1000):
        numbers = range(start, start + 1000)
        writer.write(b"".join(b'{"id": %d, "ask": "land"}\n' % number for number in numbers))
        await writer.drain()


BAD: dict[str, bytes] = {
    "no JSON": b"land!\n",
    "no object": b"[]\n",
    "not UTF-8": b'{"id": 1, "ask": "land", "why": "\xff\xfe"}\n',
    "no id": b'{"ask": "land"}\n',
    "a negative id": b'{"id": -1, "ask": "land"}\n',
    "unknown request": b'{"id": 1, "ask": "loop the loop"}\n',
    "two at once": b'{"id": 1, "ask": "land", "control": "take"}\n',
    "neither": b'{"id": 1}\n',
    "unknown key": b'{"id": 1, "ask": "land", "now": true}\n',
    "a gain that is no number": b'{"id": 1, "set": {"controller.k1": "high"}}\n',
    "deep": b"[" * 20000 + b"\n",
    "empty": b"\n",
    "long": b'{"id": 1, "ask": "land", "why": "' + b"x" * 300 + b'"}\n',
    "oversized": b'{"id": 1, "ask": "land"' + b" " * 70_000 + b"}\n",
    "oversized without an end": b"x" * 200_000,
}


@pytest.mark.parametrize("line", BAD.values(), ids=BAD)
@in_real_time
async def test_what_is_no_order_does_nothing_but_one_log_line_and_one_refusal(
    line: bytes, station: Stage
) -> None:
    async with station.up():
        reader, writer = await asyncio.open_unix_connection(station.path)
        await reader.readline()
        await reader.readline()
        writer.write(line)
        refusal = msgspec.json.decode(await reader.readline())
        assert list(refusal) == ["refused"]
        if len(line) < 60_000:
            writer.write(line)
            await reader.readline()
            writer.write(b'{"id": 9, "ask": "land"}\n')
            assert msgspec.json.decode(await reader.readline())["answer"]["done"]
            assert station.core.asked == [Request(Ask.LAND, f"told by client {os.getpid()}")]
        else:
            assert await reader.read() == b""
            assert station.core.asked == []
        assert len(station.log) == 1
        assert station.core.gains == {}
        writer.close()


@in_real_time
async def test_an_order_that_is_played_again_does_nothing(station: Stage) -> None:
    async with station.up():
        reader, writer = await asyncio.open_unix_connection(station.path)
        land, again = b'{"id": 5, "ask": "land"}\n', b'{"id": 5, "ask": "kill"}\n'
        writer.write(land + again + b'{"id": 4, "ask": "kill"}\n')
        says = [msgspec.json.decode(await reader.readline()) for _ in range(5)]
        kinds = [next(iter(one)) for one in says]
        assert kinds == ["hello", "control", "answer", "refused", "refused"]
        assert [request.ask for request in station.core.asked] == [Ask.LAND]
        writer.close()


@in_real_time
async def test_one_client_holds_control_until_it_goes_and_anyone_may_land(station: Stage) -> None:
    me = f"tui {os.getpid()}"
    async with station.up(), open_client(station.path, "other") as other:
        assert other.control == Control(None, False)
        async with open_client(station.path, "tui") as holder:
            assert (await holder.take_control()).done
            assert (await anext(other)) == Control(None, False)
            assert (await anext(other)) == Control(me, False)
            assert holder.control == Control(me, True)
            refused = await other.take_control()
            assert not refused.done and me in refused.says
            refused = await other.ask(Request(Ask.TRACK))
            assert not refused.done and f"control, which {me} holds" in refused.says
            assert station.core.asked == []
            for ask in (Ask.LAND, Ask.DESCEND, Ask.ABORT, Ask.KILL):
                assert (await other.ask(Request(ask, "now"))).done
            assert (await holder.ask(Request(Ask.TRACK))).done
            assert not (await holder.ask(Request(Ask.HOLD))).done
        assert (await anext(other)) == Control(None, False)
        assert (await other.take_control()).done
        assert f"{me} has gone" in station.core.notes[1]
    assert station.core.asked[0] == Request(Ask.LAND, f"now (other {os.getpid()})")


@in_real_time
async def test_arming_names_the_vehicle(station: Stage) -> None:
    async with station.up(), open_client(station.path, "tui") as client:
        assert (await client.take_control()).done
        for vehicle in ("", "mqy"):
            answer = await client.ask(Request(Ask.ARM), vehicle=vehicle)
            assert not answer.done and "expected 'mqx'" in answer.says
        assert station.core.asked == []
        assert (await client.ask(Request(Ask.ARM), vehicle="mqx")).done


@pytest.mark.parametrize(
    ("asked", "wrong"),
    [
        (("land",), "request: expected such as"),
        ((Ask.LAND,), "request: expected such as"),
        ((Request(cast("Ask", "fly")),), "request.ask: "),
        ((Request(cast("Ask", 5)),), "request.ask: "),
        ((Request(Ask.GOTO, "", cast("Any", (1.0, 2.0, -1.0))),), "request.points"),
        ((Request(Ask.GOTO, "", cast("Any", 5)),), "request.points: "),
        ((Request(Ask.LAND, cast("str", object())),), "request: "),
        ((Request(Ask.LAND), 5), "vehicle: expected text, got 5"),
        ((Request(Ask.LAND), None, 7), "socket: expected text, got 7"),
    ],
)
def test_a_wrong_request_is_refused_in_one_sentence(asked: tuple[Any, ...], wrong: str) -> None:
    with pytest.raises(ConfigError) as told:
        asyncio.run(ask_station(*asked))
    assert str(told.value).startswith(wrong) and "\n" not in str(told.value)


@in_real_time
async def test_a_request_takes_its_socket_as_text_and_says_where_nobody_serves(
    station: Stage,
) -> None:
    with pytest.raises(ApiError, match=f"{station.path}: no ground station serves there"):
        await ask_station(Request(Ask.LAND), socket=str(station.path))
    async with station.up():
        assert (await ask_station(Request(cast("Ask", "land")), socket=str(station.path))).done
    assert [one.ask for one in station.core.asked] == [Ask.LAND]


@in_real_time
async def test_the_python_of_the_page_asks_the_station_to_fly_there(
    runtime: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (Path(__file__).parents[2] / "docs/reference/api.md").read_text("utf-8")
    (shown,) = re.findall(r"^```python\n(.*?)^```$", page, re.M | re.S)
    station = Stage(runtime / "mqx.sock")
    async with station.up():
        await asyncio.to_thread(exec, shown, {})
    (asked,) = station.core.asked
    assert asked.ask is Ask.GOTO and [point.yaw_deg for point in asked.points] == [None, 90.0]
    assert capsys.readouterr().out


@in_real_time
async def test_a_request_wants_a_name_where_there_are_two_vehicles(
    runtime: Path, tmp_path: Path
) -> None:
    mine, service = Stage(runtime / "mqx.sock"), Stage(tmp_path / "lab" / "x500.sock")
    with pytest.raises(ApiError, match="nobody flies a vehicle here"):
        await find_socket(None, tmp_path)
    async with mine.up():
        assert await find_socket(None, tmp_path) == mine.path
        async with service.up():
            with pytest.raises(ApiError, match="more than one"):
                await find_socket(None, tmp_path)
            assert await find_socket("x500", tmp_path) == service.path
            with pytest.raises(ApiError, match=r"flies '\*'"):
                await find_socket("*", tmp_path)


@in_real_time
async def test_who_only_reads_keeps_no_order_out(station: Stage) -> None:
    station.latest.put(sample(1.0))
    async with station.up(), contextlib.AsyncExitStack() as stack:
        readers = [
            await stack.enter_async_context(open_client(station.path))
            for _ in range(api_server.CLIENTS_MAX)
        ]
        for reader in readers:
            await anext(reader)
        assert (await ask_station(Request(Ask.KILL), None, station.path)).done
        assert station.core.asked[-1].ask is Ask.KILL
        first = readers.pop(0)
        with pytest.raises(StopAsyncIteration):
            while True:
                await anext(first)
        station.latest.put(sample(2.0))
        for reader in readers:  # all others are served on
            while await anext(reader) != sample(2.0):
                pass


@in_real_time
async def test_the_socket_of_a_process_that_was_killed_is_replaced(station: Stage) -> None:
    process = await asyncio.create_subprocess_exec(*program("tests.sample_flight", station.path))
    while not station.path.exists():
        await asyncio.sleep(0.01)
    process.kill()
    await process.wait()
    assert station.path.exists()
    station.latest.put(sample(1.0))
    async with station.up():
        assert await station.first() == sample(1.0)


@in_real_time
async def test_a_second_station_is_refused_and_the_first_goes_on(station: Stage) -> None:
    station.latest.put(sample(1.0))
    async with station.up():
        with pytest.raises(ApiError, match="another ground station is serving this vehicle"):
            await Stage(station.path).server().open()
        assert await station.first() == sample(1.0)


@in_real_time
async def test_a_place_that_can_not_be_or_is_not_ours_is_refused_and_left_as_it_is(
    tmp_path: Path,
) -> None:
    path, shared = tmp_path / "mqx.sock", tmp_path / "shared"
    path.write_text("precious")
    shared.mkdir()
    shared.chmod(0o777)
    (tmp_path / "link").symlink_to(tmp_path)
    for place, says in (
        (path, "not a socket"),
        (shared / "a.sock", "must be a folder that belongs to you"),
        (tmp_path / "link" / "a.sock", "must be a folder that belongs to you"),
        (tmp_path / ("x" * 120), r"path too long.* set status\.path to another one"),
    ):
        with pytest.raises(ApiError, match=says):
            await Stage(place).server().open()
    assert path.read_text() == "precious"


def test_the_socket_is_in_the_runtime_folder_unless_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", "/run/user/7")
    assert socket_path(StatusConfig(), "mqx") == Path("/run/user/7/groundstation/mqx.sock")
    monkeypatch.setenv("XDG_RUNTIME_DIR", "relative")
    assert socket_path(StatusConfig(), "mqx") == Path(f"/tmp/groundstation-{os.getuid()}/mqx.sock")
    assert socket_path(StatusConfig(path="/a/b.sock"), "mqx") == Path("/a/b.sock")
