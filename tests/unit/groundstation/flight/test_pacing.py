"""When the next command leaves: frames, poses, and the last chance before a deadline, taken once."""

import asyncio
from dataclasses import dataclass
from typing import Any, cast

import pytest

from groundstation.flight.flight import LAST_CHANCE_S, Pacing
from links.core import CommandLink
from tests.loops import in_virtual_time

PERIOD_S = 0.0225


@dataclass
class Link:
    """As much of a link as pacing asks of it."""

    follows_poses: bool
    period_s: float = PERIOD_S


def left(deadline_s: float, *, follows_poses: bool, until_s: float = 0.5) -> list[float]:
    """When commands leave that all rest on the one pose with that deadline."""

    async def main() -> list[float]:
        loop = asyncio.get_running_loop()
        pacing = Pacing(cast(CommandLink, cast(Any, Link(follows_poses))))
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
def test_one_command_leaves_just_before_a_deadline_whatever_its_last_digits(follows_poses: bool, step: int) -> None:
    deadline = 0.2 + step * 1.37e-4 / 3.0
    times = left(deadline, follows_poses=follows_poses)
    assert min(abs(t - (deadline - LAST_CHANCE_S)) for t in times) < 1e-8
    pace = 1.5 * PERIOD_S if follows_poses else PERIOD_S
    assert len(times) <= 0.5 / pace + 3
    assert max(b - a for a, b in zip(times, times[1:], strict=False)) <= 1.5 * PERIOD_S + 1e-8


def test_a_last_chance_that_a_timer_meets_a_tick_early_is_taken() -> None:
    async def main() -> float:
        pacing = Pacing(cast(CommandLink, cast(Any, Link(False))))
        pacing.begin()
        await pacing.next(0.0, LAST_CHANCE_S + 5e-10)  # the chance is half a nanosecond ahead
        return asyncio.get_running_loop().time()

    assert in_virtual_time(main)() == pytest.approx(PERIOD_S, abs=1e-8)
