"""Time on the loop that flies: timers by the microsecond, ends of tasks, and idle slots."""

import asyncio
import contextlib
import os

import pytest

from groundstation.machine import IdleSlots, cancel_task, precise_loop
from groundstation.machine.clock import CANCEL_AGAIN_S, WITHIN_S, PreciseSelector
from sim.time import in_virtual_time


@in_virtual_time
async def test_each_command_makes_room_for_one_thing_in_the_order_of_asking() -> None:
    quiet, done = IdleSlots(), list[int]()

    async def work(number: int) -> None:
        await quiet.moment()
        done.append(number)

    tasks = [asyncio.create_task(work(number)) for number in range(3)]
    for number in range(3):
        await asyncio.sleep(0.001)
        assert done == list(range(number))
        quiet.begin()
    await asyncio.gather(*tasks)
    assert done == [0, 1, 2]


@in_virtual_time
async def test_nothing_runs_before_whoever_sent_the_command_has_ended_its_turn() -> None:
    quiet, said = IdleSlots(), list[str]()
    quiet.moment().add_done_callback(lambda _: said.append("can wait"))
    quiet.begin()
    said.append("what follows the command")
    await asyncio.sleep(0)
    assert said == ["what follows the command", "can wait"]


@in_virtual_time
async def test_without_commands_nothing_waits_for_long() -> None:
    begun = asyncio.get_running_loop().time()
    await IdleSlots().moment()
    assert WITHIN_S <= asyncio.get_running_loop().time() - begun < WITHIN_S + 0.001


@in_virtual_time
async def test_what_was_called_off_or_has_been_done_takes_no_other_ones_turn() -> None:
    quiet = IdleSlots()
    await quiet.moment()  # past its longest wait
    called_off, meant = quiet.moment(), quiet.moment()
    called_off.cancel()
    quiet.begin()
    assert meant.done()


@in_virtual_time
async def test_on_the_ground_what_is_done_is_forgotten() -> None:
    quiet = IdleSlots()
    for _ in range(100):
        await quiet.moment()
    assert len(quiet._waiting) == 1


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
async def test_a_task_that_forgets_its_cancellation_is_cancelled_again() -> None:
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
