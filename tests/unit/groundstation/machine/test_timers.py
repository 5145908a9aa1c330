"""The loop that flies is woken up by the microsecond, and by whatever comes before."""

import asyncio
import contextlib
import os

import pytest

from groundstation.machine import cancel_task, precise_loop
from groundstation.machine.clock import CANCEL_AGAIN_S, PreciseSelector
from tests.loops import in_virtual_time


def test_timers_are_less_late_than_the_millisecond_that_epoll_counts_in() -> None:
    async def scene() -> list[float]:
        loop = asyncio.get_running_loop()
        late = []
        for _ in range(50):
            due = loop.time() + 0.00205  # epoll would wait for 3 ms
            come = loop.create_future()
            loop.call_at(due, come.set_result, None)
            await come
            late.append(loop.time() - due)
        return late

    with asyncio.Runner(loop_factory=precise_loop) as runner:
        late = runner.run(scene())
    assert 0.0 <= min(late) < 0.5e-3, "a busy machine is late now and then, not always"


def test_what_comes_earlier_ends_the_wait() -> None:
    ours, theirs = os.pipe()
    selector = PreciseSelector()
    try:
        selector.register(ours, 1, "pipe")
        assert selector.select(0.001) == []
        os.write(theirs, b"x")
        assert [key.data for key, _ in selector.select(60.0)] == ["pipe"]
        assert [key.data for key, _ in selector.select(0.0)] == ["pipe"]
        assert [key.data for key, _ in selector.select(None)] == ["pipe"]
    finally:
        selector.close()
        os.close(ours)
        os.close(theirs)


@in_virtual_time
async def test_a_task_that_forgets_its_cancellation_is_cancelled_again_and_what_it_fails_with_is_raised() -> None:
    async def forget() -> None:
        with contextlib.suppress(asyncio.CancelledError):
            await asyncio.sleep(60.0)
        await asyncio.sleep(60.0)

    async def fail() -> None:
        try:
            await asyncio.sleep(60.0)
        finally:
            await asyncio.sleep(0.5 * CANCEL_AGAIN_S)  # what cleans up is not cancelled again
            raise OSError("gone")

    loop = asyncio.get_running_loop()
    forgetful, failing = asyncio.create_task(forget()), asyncio.create_task(fail())
    await asyncio.sleep(0.1)
    begun = loop.time()
    await cancel_task(forgetful)
    assert forgetful.cancelled()
    assert loop.time() - begun == pytest.approx(CANCEL_AGAIN_S)
    with pytest.raises(OSError, match="gone"):
        await cancel_task(failing)
