"""The status socket over real UNIX sockets: who may attach, what they get, and what they can't do."""

# ruff: noqa: ASYNC240  # a glance at a file does not hold up a test

import asyncio
import contextlib
import math
import os
import stat
import sys
from collections.abc import AsyncIterator, Callable, Coroutine
from pathlib import Path
from typing import Any

import msgspec
import pytest

from groundstation.broadcast import Latest
from groundstation.snapshot import Snapshot
from groundstation.telemetry import status
from groundstation.telemetry.status import StatusConfig, StatusError, StatusServer, snapshots, socket_path
from tests.sample_flight import sample

Scene = Callable[[Path, Latest[Snapshot]], Coroutine[Any, Any, None]]


async def listening(path: Path) -> bool:
    try:
        _, writer = await asyncio.open_unix_connection(path)
    except OSError:
        return False
    writer.close()
    return True


@contextlib.asynccontextmanager
async def served(path: Path, latest: Latest[Snapshot], rate_hz: float = 50.0) -> AsyncIterator[asyncio.Task[None]]:
    task = asyncio.create_task(StatusServer(StatusConfig(path=str(path), rate_hz=rate_hz), "mqx", latest).serve())
    while not await listening(path) and not task.done():
        await asyncio.sleep(0.001)
    await asyncio.sleep(0.05)  # until the server knows that this first visitor has left
    try:
        yield task
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


def play(scene: Scene, tmp_path: Path) -> None:
    async def timed() -> None:
        async with asyncio.timeout(20.0):
            await scene(tmp_path / "mqx.sock", Latest())

    asyncio.run(timed())


async def first(path: Path) -> Snapshot:
    async for snapshot in snapshots(path):
        return snapshot
    raise AssertionError("nothing was served")


def test_several_clients_get_the_snapshots_and_one_that_joins_late_gets_the_newest(tmp_path: Path) -> None:
    async def scene(path: Path, latest: Latest[Snapshot]) -> None:
        async with served(path, latest):
            early = asyncio.create_task(first(path))
            await asyncio.sleep(0.05)
            assert not early.done()
            latest.put(sample(1.0))
            assert await early == sample(1.0)
            latest.put(sample(2.0))
            assert await first(path) == sample(2.0)
            stream = snapshots(path)
            assert await anext(stream) == sample(2.0)
            latest.put(sample(3.0))
            assert await anext(stream) == sample(3.0)

    play(scene, tmp_path)


def test_the_socket_is_for_its_owner_alone_and_goes_away_at_the_end(tmp_path: Path) -> None:
    async def scene(path: Path, latest: Latest[Snapshot]) -> None:
        async with served(path, latest):
            assert stat.S_IMODE(path.stat().st_mode) == 0o600
        assert not path.exists()

    play(scene, tmp_path)


def test_clients_get_the_last_snapshot_when_the_flight_ends_and_then_the_end_of_the_stream(tmp_path: Path) -> None:
    async def scene(path: Path, latest: Latest[Snapshot]) -> None:
        seen: list[str] = []

        async def watch() -> None:
            async for snapshot in snapshots(path):
                seen.append(snapshot.state)

        async with served(path, latest, rate_hz=1.0):
            latest.put(sample(1.0))
            watcher = asyncio.create_task(watch())
            while not seen:
                await asyncio.sleep(0.01)
            latest.put(sample(2.0, state="landed"))
        await watcher
        assert seen == ["tracking", "landed"]

    play(scene, tmp_path)


def test_no_client_gets_more_than_the_configured_rate(tmp_path: Path) -> None:
    async def scene(path: Path, latest: Latest[Snapshot]) -> None:
        seen = []

        async def watch() -> None:
            async for snapshot in snapshots(path):
                seen.append(snapshot)

        async with served(path, latest, rate_hz=10.0):
            watcher = asyncio.create_task(watch())
            loop = asyncio.get_running_loop()
            start = loop.time()
            for i in range(100):
                latest.put(sample(0.01 * i))
                await asyncio.sleep(0.01)
            watcher.cancel()
            most = 10.0 * (loop.time() - start) + 2.0
        assert 3 <= len(seen) <= most < 100

    play(scene, tmp_path)


def test_nothing_is_encoded_while_nobody_is_attached(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    encoded = []
    real = msgspec.json.encode

    def count(value: Any) -> bytes:
        encoded.append(value)
        return real(value)

    monkeypatch.setattr(msgspec.json, "encode", count)

    async def scene(path: Path, latest: Latest[Snapshot]) -> None:
        async with served(path, latest):
            for i in range(20):
                latest.put(sample(float(i)))
                await asyncio.sleep(0.005)
            assert encoded == []
            await asyncio.gather(*(first(path) for _ in range(5)))
            assert len(encoded) == 1

    play(scene, tmp_path)


def test_a_client_that_does_not_read_is_dropped_and_delays_nobody(tmp_path: Path) -> None:
    async def scene(path: Path, latest: Latest[Snapshot]) -> None:
        large = msgspec.structs.replace(sample(0.0), reason="x" * 100_000)
        latest.put(large)
        async with served(path, latest):
            sleepy, writer = await asyncio.open_unix_connection(path)
            stream = snapshots(path)
            for _ in range(30):
                assert await anext(stream) == large
                latest.put(large)
            got = 0
            with contextlib.suppress(ConnectionError):
                while chunk := await sleepy.read(1 << 20):
                    got += len(chunk)
            assert got < 20 * 100_000
            writer.close()

    play(scene, tmp_path)


def test_what_a_client_sends_is_not_read(tmp_path: Path) -> None:
    async def scene(path: Path, latest: Latest[Snapshot]) -> None:
        async with served(path, latest):
            reader, writer = await asyncio.open_unix_connection(path)
            flood = asyncio.create_task(_flood(writer))
            latest.put(sample(1.0))
            assert msgspec.json.decode(await reader.readline(), type=Snapshot) == sample(1.0)
            await asyncio.sleep(0.1)
            assert not flood.done()  # its writes fill its own buffers and stop there
            latest.put(sample(2.0))
            assert msgspec.json.decode(await reader.readline(), type=Snapshot) == sample(2.0)
            flood.cancel()
            writer.close()

    play(scene, tmp_path)


async def _flood(writer: asyncio.StreamWriter) -> None:
    for _ in range(1000):
        writer.write(b'{"land": true}\n' * 1000)
        await writer.drain()


def test_too_many_clients_are_turned_away(tmp_path: Path) -> None:
    async def scene(path: Path, latest: Latest[Snapshot]) -> None:
        latest.put(sample(1.0))
        async with served(path, latest):
            streams = [snapshots(path) for _ in range(status.CLIENTS_MAX)]
            for stream in streams:
                assert await anext(stream) == sample(1.0)
            with pytest.raises(StopAsyncIteration):
                await anext(snapshots(path))

    play(scene, tmp_path)


def test_the_socket_of_a_process_that_was_killed_is_replaced(tmp_path: Path) -> None:
    async def scene(path: Path, latest: Latest[Snapshot]) -> None:
        process = await asyncio.create_subprocess_exec(sys.executable, "-m", "tests.sample_flight", str(path))
        while not path.exists():
            await asyncio.sleep(0.01)
        process.kill()
        await process.wait()
        assert path.exists()
        latest.put(sample(1.0))
        async with served(path, latest):
            assert await first(path) == sample(1.0)

    play(scene, tmp_path)


def test_a_second_ground_station_of_the_same_vehicle_is_refused_and_the_first_goes_on(tmp_path: Path) -> None:
    async def scene(path: Path, latest: Latest[Snapshot]) -> None:
        latest.put(sample(1.0))
        async with served(path, latest):
            with pytest.raises(StatusError, match="another ground station is serving this vehicle"):
                await StatusServer(StatusConfig(path=str(path)), "mqx", latest).serve()
            assert await first(path) == sample(1.0)

    play(scene, tmp_path)


def test_a_file_that_is_no_socket_is_not_touched(tmp_path: Path) -> None:
    async def scene(path: Path, latest: Latest[Snapshot]) -> None:
        path.write_text("precious")
        with pytest.raises(StatusError, match="not a socket"):
            await StatusServer(StatusConfig(path=str(path)), "mqx", latest).serve()
        assert path.read_text() == "precious"

    play(scene, tmp_path)


def test_a_folder_that_others_may_write_to_is_refused(tmp_path: Path) -> None:
    async def scene(path: Path, latest: Latest[Snapshot]) -> None:
        shared = tmp_path / "shared"
        shared.mkdir()
        shared.chmod(0o777)
        link = tmp_path / "link"
        link.symlink_to(tmp_path)
        for folder in (shared, link):
            with pytest.raises(StatusError, match="must be a folder that belongs to you"):
                await StatusServer(StatusConfig(path=str(folder / "a.sock")), "mqx", latest).serve()

    play(scene, tmp_path)


def test_a_path_too_long_for_a_socket_is_told(tmp_path: Path) -> None:
    async def scene(path: Path, latest: Latest[Snapshot]) -> None:
        with pytest.raises(StatusError, match="too long"):
            await StatusServer(StatusConfig(path=str(tmp_path / ("x" * 120))), "mqx", latest).serve()

    play(scene, tmp_path)


def test_numbers_that_are_not_finite_reach_the_screen_as_such(tmp_path: Path) -> None:
    async def scene(path: Path, latest: Latest[Snapshot]) -> None:
        broken = msgspec.structs.replace(
            sample(1.0), error_m=math.nan, position_ned=(math.nan, 1.0, math.inf), diagnostics=None
        )
        latest.put(broken)
        async with served(path, latest):
            seen = await first(path)
        assert math.isnan(seen.error_m)
        assert math.isnan(seen.position_ned[0])
        assert seen.position_ned[1] == 1.0
        assert not math.isfinite(seen.position_ned[2])
        assert seen.diagnostics is None
        assert seen.events == broken.events

    play(scene, tmp_path)


@pytest.mark.parametrize("line", [b"hello\n", b"[]\n", b'{"vehicle": "a"}\n', b"null\n", b"\xff\n", b"x" * (2 << 20)])
def test_a_socket_that_serves_something_else_is_told_to_the_reader(tmp_path: Path, line: bytes) -> None:
    async def scene(path: Path, latest: Latest[Snapshot]) -> None:
        del latest

        async def say(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            with contextlib.suppress(ConnectionError):
                writer.write(line)
                await writer.drain()
            writer.close()

        server = await asyncio.start_unix_server(say, path)
        with pytest.raises(StatusError, match=r"mqx\.sock"):
            await first(path)
        server.close()

    play(scene, tmp_path)


def test_the_socket_is_in_the_users_runtime_folder_unless_the_configuration_says_otherwise(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", "/run/user/7")
    assert socket_path(StatusConfig(), "mqx") == Path("/run/user/7/groundstation/mqx.sock")
    monkeypatch.setenv("XDG_RUNTIME_DIR", "relative")
    assert socket_path(StatusConfig(), "mqx") == Path(f"/tmp/groundstation-{os.getuid()}/mqx.sock")
    assert socket_path(StatusConfig(path="/a/b.sock"), "mqx") == Path("/a/b.sock")
