"""What the referee of a simulated mission judges."""

import pytest

from groundstation.core.messages import STEADY_S, SteadyError
from groundstation.core.trajectory.shapes import HoldConfig
from sim.runs.referee import StateEntry, TrueTrack

STEP_S = 0.01
OFF_M = 0.02


@pytest.mark.parametrize(("figure_s", "rms_cm"), [(15.0, None), (15.9, None), (17.0, 2.0)])
def test_errors_of_the_figure_are_judged_from_a_second_after_their_beginning_on(
    figure_s: float, rms_cm: float | None
) -> None:
    track, counted = TrueTrack(), SteadyError()
    for k in range(round(figure_s / STEP_S) + 1):
        track.step(STEP_S * k, (OFF_M, 0.0, 0.0))
        counted.add(STEP_S * k, OFF_M)
    states = [StateEntry("tracking", 0.0, ""), StateEntry("returning", figure_s, "")]
    hold = HoldConfig(position_ned=(0.0, 0.0, 0.0)).build()
    judged = track.judge_figure(hold, 0.0, states, STEP_S)
    assert judged["rms_cm"] == (rms_cm and pytest.approx(rms_cm))
    assert counted.rms_m == (rms_cm and pytest.approx(OFF_M))
    assert judged["max_cm"] == (rms_cm and pytest.approx(rms_cm))
    assert judged["figure_s"] == pytest.approx(figure_s - STEADY_S, abs=1.5 * STEP_S)
