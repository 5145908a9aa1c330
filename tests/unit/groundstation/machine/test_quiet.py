"""Idle slots: what can wait has its turn after a command, one thing a command, and is done all the same without one."""

import asyncio

from groundstation.machine import IdleSlots
from groundstation.machine.clock import WITHIN_S
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
