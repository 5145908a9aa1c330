"""When a command is due, when a last chance is taken, and what has waited for a stalled program."""

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest

from groundstation.flight import FrameLateness
from groundstation.flight.command_loop import Pacing
from groundstation.flight.controller import LAST_CHANCE_S
from tests.loops import in_virtual_time

PERIOD_S = 0.0225


def link(period_s: float = PERIOD_S, *, follows_poses: bool = False) -> Any:
    """As much of a link as pacing asks of it."""
    return SimpleNamespace(period_s=period_s, follows_poses=follows_poses)


def left(deadline_s: float, *, follows_poses: bool, until_s: float = 0.5) -> list[float]:
    """When commands leave that all rest on the one pose with that deadline."""

    async def main() -> list[float]:
        loop = asyncio.get_running_loop()
        pacing = Pacing(link(follows_poses=follows_poses))
        pacing.begin()
        times: list[float] = []
        while loop.time() < until_s:
            times.append(loop.time())
            assert len(times) < 1000, "time stands still"
            await pacing.next(times[-1], deadline_s)
        return times

    return in_virtual_time(main)()


@pytest.mark.parametrize("follows_poses", [False, True])
@pytest.mark.parametrize("step", range(40))
def test_one_command_leaves_just_before_a_deadline_whatever_its_last_digits(
    follows_poses: bool, step: int
) -> None:
    deadline = 0.2 + step * 1.37e-4 / 3.0
    times = left(deadline, follows_poses=follows_poses)
    assert min(abs(t - (deadline - LAST_CHANCE_S)) for t in times) < 1e-8
    pace = 1.5 * PERIOD_S if follows_poses else PERIOD_S
    assert len(times) <= 0.5 / pace + 3
    assert max(b - a for a, b in zip(times, times[1:], strict=False)) <= 1.5 * PERIOD_S + 1e-8


def test_a_last_chance_that_a_timer_meets_a_tick_early_is_taken() -> None:
    async def main() -> float:
        pacing = Pacing(link())
        pacing.begin()
        await pacing.next(0.0, LAST_CHANCE_S + 5e-10)  # the chance is half a nanosecond ahead
        return asyncio.get_running_loop().time()

    assert in_virtual_time(main)() == pytest.approx(PERIOD_S, abs=1e-8)


def test_a_frame_is_late_by_what_it_misses_and_one_in_between_is_none() -> None:
    due = FrameLateness(link(0.02))
    seen = [due.measure_s(now, 0, 0.0) for now in (1.0, 1.02, 1.043, 1.05, 1.06, 1.101, 1.121)]
    assert seen == pytest.approx([0.0, 0.0, 0.003, None, 0.0, 0.021, 0.0], abs=1e-9)
