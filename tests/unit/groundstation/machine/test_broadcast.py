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
