"""Poses that come later from some instant on, with stamps that say so: their age counts."""

import asyncio
from collections.abc import Sequence

import pytest

from groundstation.core.messages import tell_lines
from groundstation.core.mission import FINAL, State
from groundstation.flight import Flight
from sim.runs import MissionResult, Stage
from sim.trackers import TrackedBody
from tests.flight.flights import mission
from tests.known import known
from tests.loops import until
from tests.proving.faults import stand_between
from tests.proving.faults.pictures import Send

STRIKE_AFTER_S = 1.0
LASTS_S = 10.0
SOURCES = ["vicon", "natnet", "qualisys", "json"]


def late(source: str, late_s: float) -> tuple[MissionResult, list[str], list[float]]:
    """A mission struck in hold, the lines told afterwards, and errors of the newest pose's time."""
    told: list[str] = []
    errors: list[float] = []

    async def script(flight: Flight, stage: Stage) -> None:
        left_s = 0.0
        """When the newest frame that has left was exposed."""

        def way(send: Send, frame: int, exposure_s: float, bodies: Sequence[TrackedBody]) -> None:
            def leave() -> None:
                nonlocal left_s
                left_s = max(left_s, exposure_s)
                send(frame, exposure_s, bodies)

            asyncio.get_running_loop().call_later(late_s, leave)

        meddler = known(stand_between(stage))
        await until(lambda: flight.state is State.HOLD)
        await asyncio.sleep(STRIKE_AFTER_S)
        told.clear()
        meddler.way = way
        await asyncio.sleep(late_s + 0.1)
        for _ in range(round(LASTS_S / 0.05)):
            await asyncio.sleep(0.05)
            if flight.state in FINAL:
                return
            true_s = asyncio.get_running_loop().time() - flight.snapshot().pose_age_s
            errors.append(true_s - left_s)
        flight.stop("enough was seen")

    hear = tell_lines(told.append)
    return mission("paper", figure_s=5.0, source=source, watch=hear, script=script), told, errors


def text(told: list[str], word: str) -> str:
    return next((line for line in told if word in line), "")


@pytest.mark.tried(2)  # sources
@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("late_s", [0.1, 0.2])
def test_poses_that_come_late_for_good_are_as_old_as_they_are_for_good(
    source: str, late_s: float
) -> None:
    flown, told, errors = late(source, late_s)
    assert errors
    assert max(map(abs, errors)) < 2e-3
    old_s = 0.6 * 0.25 - 0.01  # of flight.coast_s; the cameras' own latency counts, too
    assert flown.why.startswith("aborted: enough was seen" if late_s < old_s else "landed")
    # Motive says itself how old each frame was as it left: nothing is late on its way.
    if source != "natnet":
        assert f"poses are {1e3 * late_s:.0f} ms later than before" in text(told, "later")
