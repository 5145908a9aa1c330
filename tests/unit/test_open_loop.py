"""The loop in virtual time that serves real things, too: what they do moves no instant, and no order in one."""

import asyncio
import os
import time

from tests.open_loop import OpenLoop

Trace = list[tuple[float, str]]


async def busy(trace: Trace, name: str, period_s: float) -> None:
    """Mark each period, without drift: with others of the kind, often at the same instant."""
    loop = asyncio.get_running_loop()
    for _ in range(300):
        await asyncio.sleep(period_s)
        trace.append((loop.time(), name))


async def beside() -> None:
    """Threads, a pipe, and timers at, and a hair beside, the instants of the others."""
    loop = asyncio.get_running_loop()
    reading, writing = os.pipe()
    came: list[bytes] = []
    loop.add_reader(reading, lambda: came.append(os.read(reading, 100)))
    try:
        for number in range(100):
            await asyncio.to_thread(os.write, writing, b"x")
            await asyncio.sleep(0.01 if number % 2 else 0.01 + 1e-15)
            loop.call_later(0.03, came.append, b"")
        assert b"".join(came) == b"x" * 100
    finally:
        loop.remove_reader(reading)
        os.close(reading)
        os.close(writing)


def traced(*, attended: bool) -> Trace:
    trace: Trace = []

    async def work() -> None:
        async with asyncio.TaskGroup() as group:
            if attended:
                group.create_task(beside())
            for name, period_s in (("a", 0.01), ("b", 0.02), ("c", 0.005), ("d", 0.01)):
                group.create_task(busy(trace, name, period_s))

    with asyncio.Runner(loop_factory=OpenLoop) as runner:
        runner.run(work())
    return trace


def test_what_is_beside_moves_no_instant_and_no_order_in_one() -> None:
    assert traced(attended=True) == traced(attended=False)


def test_virtual_time_can_be_held_to_a_pace() -> None:

    def work(pace: float) -> float:
        async def sleep() -> None:
            loop = asyncio.get_running_loop()
            assert isinstance(loop, OpenLoop)
            loop.pace = pace
            for _ in range(10):
                await asyncio.sleep(0.1)

        began = time.monotonic()
        with asyncio.Runner(loop_factory=OpenLoop) as runner:
            runner.run(sleep())
        return time.monotonic() - began

    assert work(10.0) >= 0.095
    assert work(1e9) < 0.95


def test_a_thread_that_ends_later_than_its_loop_is_waited_for() -> None:
    ended: list[bool] = []

    def late() -> None:
        time.sleep(0.1)
        ended.append(True)

    async def work() -> None:
        loop = asyncio.get_running_loop()
        loop.run_in_executor(None, late)
        loop.call_later(3600.0, int)  # something later, to which virtual time could go meanwhile

    with asyncio.Runner(loop_factory=OpenLoop) as runner:
        runner.run(work())
    assert ended == [True]
