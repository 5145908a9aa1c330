"""Latest: the newest value, for any number of readers, none of which can hold up the writer."""

import asyncio

from groundstation.machine import Latest
from tests.loops import in_real_time


@in_real_time
async def test_every_waiting_reader_gets_the_new_value() -> None:
    latest: Latest[str] = Latest()
    readers = [asyncio.create_task(latest.newer()) for _ in range(3)]
    await asyncio.sleep(0)
    latest.put("a")
    assert await asyncio.gather(*readers) == [(1, "a")] * 3


@in_real_time
async def test_a_reader_that_comes_late_gets_the_newest_at_once_and_skips_the_rest() -> None:
    latest: Latest[int] = Latest()
    for value in range(10):
        latest.put(value)
    assert await latest.newer() == (10, 9)
    assert await latest.newer(4) == (10, 9)


@in_real_time
async def test_a_reader_waits_for_something_newer_than_what_it_has() -> None:
    latest: Latest[int] = Latest()
    latest.put(1)
    reader = asyncio.create_task(latest.newer(1))
    await asyncio.sleep(0)
    assert not reader.done()
    latest.put(2)
    latest.put(3)
    assert await reader == (3, 3)


@in_real_time
async def test_a_reader_that_is_cancelled_does_not_take_the_others_with_it() -> None:
    latest: Latest[str] = Latest()
    leaving, staying = asyncio.create_task(latest.newer()), asyncio.create_task(latest.newer())
    await asyncio.sleep(0)
    leaving.cancel()
    await asyncio.sleep(0)
    latest.put("a")
    assert await staying == (1, "a")
    assert leaving.cancelled()


@in_real_time
async def test_none_is_a_value_like_any_other() -> None:
    latest: Latest[None] = Latest()
    latest.put(None)
    assert await latest.newer() == (1, None)


@in_real_time
async def test_a_slow_reader_misses_values_and_a_fast_one_sees_each() -> None:
    latest: Latest[int] = Latest()
    seen: dict[float, list[int]] = {0.0: [], 0.1: []}

    async def read(period_s: float) -> None:
        async for value in latest.values(period_s):
            seen[period_s].append(value)

    readers = [asyncio.create_task(read(period_s)) for period_s in seen]
    for value in range(50):
        latest.put(value)
        await asyncio.sleep(0.005)
    await asyncio.sleep(0.15)
    for reader in readers:
        reader.cancel()
    await asyncio.gather(*readers, return_exceptions=True)
    assert seen[0.0] == list(range(50))
    assert 2 <= len(seen[0.1]) < 50
    assert seen[0.1][-1] == 49
