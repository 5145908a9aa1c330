"""The way of one pose through the program, as docs/explanation/architecture.md lists it."""

import asyncio
import re
import sys
from pathlib import Path
from types import FrameType
from typing import Any

from groundstation.core.mission import State
from groundstation.flight import Flight
from sim.runs import Stage
from tests.flight.flights import mission
from tests.loops import until

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/explanation/architecture.md").read_text("utf-8")
LISTED = [
    f"{file} {function}"
    for file, function in re.findall(r"^\d+\. `([\w/]+\.py)` `(\w+)`", PAGE, re.MULTILINE)
]


def calls_of_one_pose() -> list[str]:
    """File and function of every call from a pose's datagram to the wait after its command."""
    calls: list[str] = []
    found: list[str] = []

    def note(frame: FrameType, event: str, _: Any) -> None:
        path = Path(frame.f_code.co_filename)
        if event != "call" or found or not path.is_relative_to(ROOT):
            return
        call = f"{path.relative_to(ROOT).as_posix()} {frame.f_code.co_name}"
        if call == LISTED[0]:  # its command comes before the next pose
            calls.clear()
        calls.append(call)
        if call == LISTED[-1]:
            found.extend(calls)

    async def script(flight: Flight, _: Stage) -> None:
        await until(
            lambda: flight.state is State.TRACKING and flight.snapshot().flight_time_s > 1.0
        )
        sys.setprofile(note)
        try:
            await asyncio.sleep(0.2)
        finally:
            sys.setprofile(None)

    assert mission("paper", figure_s=3.0, script=script).landed
    return found


def test_a_pose_goes_forward_through_the_functions_that_the_architecture_lists() -> None:
    assert len(LISTED) > 20
    calls = iter(calls_of_one_pose())
    missed = next((step for step in LISTED if step not in calls), None)
    assert missed is None, "not called, or not after those before it"
