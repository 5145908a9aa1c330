"""What an autopilot says, in a whole flight: a long text of which a part got lost, and the result of a command."""

from typing import Any

import pytest

from groundstation.core.messages import tell_lines
from groundstation.core.mission import State
from groundstation.flight import FlightOutcome, make_flight
from sim.runs import Stage, confirm_at
from sim.scenarios import SCENARIOS, prepare
from tests.flight.flights import running
from tests.loops import in_virtual_time

LONG = "PreArm: compass 2 is not healthy, calibrate it away from the steel of the floor, then restart the autopilot"
"""Three parts of 50 bytes."""


def test_a_refusal_to_arm_is_told_in_words_and_with_the_gap_of_a_lost_part(monkeypatch: pytest.MonkeyPatch) -> None:
    world, config = prepare(SCENARIOS["paper"], ["flight.duration_s=3"])
    said: list[str] = []

    async def main() -> FlightOutcome:
        stage = Stage(world, config, 0)
        stage.autopilot.lacks = LONG
        pack = stage.autopilot.codec.pack

        def lose_second_part(message: Any) -> bytes:
            return b"" if message.get_type() == "STATUSTEXT" and message.chunk_seq == 1 else pack(message)

        monkeypatch.setattr(stage.autopilot.codec, "pack", lose_second_part)
        flight = make_flight(config, confirm=confirm_at(0.0), subscribers=(tell_lines(said.append),))
        async with running(stage):
            return await flight.run()

    outcome = in_virtual_time(main)()
    assert outcome.state is State.ABORTED
    (refused,) = [line for line in said if "refused to arm" in line]
    assert outcome.reason in refused, "in the log as on the screen"
    assert "not possible at this moment, MAV_RESULT_TEMPORARILY_REJECTED" in refused
    assert f"{LONG[:50]}[…]{LONG[100:]}" in refused
