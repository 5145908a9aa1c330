"""What a flight in real time tells of itself: what it answered to the fault, and what went wrong."""

import math

from groundstation.core.mission.mission import State
from tests.proving.faults.deck.moments import MOMENTS
from tests.proving.faults.judge.thrust import LIFTS
from tests.proving.faults.judge.verdict import Answer
from tests.proving.faults.live.scene import LiveScene

UNDER_WAY_S = 0.06
"""What a killed process has sent may be under way for so long on a busy machine [s]."""
GAP_S = 0.3
"""A flight that goes on leaves no longer gap between two frames [s]: the coast limit, and a moment more."""
RADIO_S = 2.0 + 0.25 + 0.25 + 0.1
"""How long after its station's death a pacer may lift: to the deadline, and its bring-down [s]."""
TAKEN_OVER_S = 0.15
"""How long the last frame of a pacer that is gone may be held [s]: a sign of life 60 ms old on two looks, and what a
busy machine takes."""


def evidence(
    scene: LiveScene, name: str, state: str, *, struck_s: float, acts_s: float | None, rests: bool
) -> tuple[list[Answer], str]:
    """What ``scene`` answered to the fault ``name`` in ``state``, and what is wrong with that; empty where nothing is.

    ``acts_s`` is when the autopilot acted by itself, where it did, and ``rests`` whether the vehicle stands in the end.
    """
    answers = [(time_s, str(after), reason) for time_s, after, reason in scene.moves.answers]
    if acts_s is not None and acts_s > struck_s:
        answers.append((acts_s, "autopilot lands", "set-points stopped: the autopilot's own failsafe"))
    wrong = "" if rests else "it does not come to rest"
    if not scene.finite:
        wrong = wrong or "a number that is not finite left"
    if name.startswith("SIGKILL"):
        then = _after_death(scene, state, struck_s, answers)
    elif scene.stage.radio is not None:
        then = _after_pacing(scene, struck_s)
    else:
        then = _flying_on(scene, struck_s, answers)
    return answers, wrong or then


def _after_death(scene: LiveScene, state: str, struck_s: float, answers: list[Answer]) -> str:
    """Of a station that was killed. A pacer that outlives it is an answer."""
    wrong = ""
    if scene.stage.radio is None and scene.bytes_s[-1] > struck_s + UNDER_WAY_S:
        wrong = f"something left {scene.bytes_s[-1] - struck_s:.2f} s after the station was dead"
    if scene.stage.radio is not None:
        lifted_s = max((t for t, thrust in scene.frames if thrust > LIFTS), default=-math.inf)
        if lifted_s > struck_s + RADIO_S:
            wrong = f"a frame that lifts left {lifted_s - struck_s:.2f} s after the station was dead"
        if lifted_s > struck_s + scene.config.flight.coast_s:
            said = "no orders any more: the pacer plays the bring-down"
            answers.append((struck_s + scene.config.flight.coast_s, "pacer brings down", said))
    if not answers and not MOMENTS[state].flying:
        answers.append((struck_s, "silence", "nothing leaves a dead process, and it had not left the floor"))
    return wrong


def _after_pacing(scene: LiveScene, struck_s: float) -> str:
    """Of a radio whose pacer is gone, or told to end: somebody goes on, with a bring-down, and last of all disarmed."""
    after = [(t, thrust) for t, thrust in scene.frames if t > struck_s]
    if not after:
        return "no frame came any more: the receiver held one that flies"
    gap = max(b - a for (a, lifts), (b, _) in zip([(struck_s, 1.0), *after], after, strict=False) if lifts > LIFTS)
    if gap > TAKEN_OVER_S:
        return f"the receiver held a frame that flies for {1e3 * gap:.0f} ms"
    if after[-1][1] > LIFTS:
        return "the last frame flies"
    lifted_s = max((t for t, thrust in after if thrust > LIFTS), default=-math.inf)
    return f"a frame that lifts left {lifted_s - struck_s:.2f} s after" if lifted_s > struck_s + RADIO_S else ""


def _flying_on(scene: LiveScene, struck_s: float, answers: list[Answer]) -> str:
    """Of a station that lives."""
    times = [t for t, _ in scene.frames if t >= struck_s - 0.1]
    gap = max((b - a for a, b in zip(times, times[1:], strict=False)), default=0.0)
    if gap > GAP_S and not answers:
        return f"{1e3 * gap:.0f} ms without a frame, though it flew on"
    if scene.moves.state is not State.LANDED:
        busy = "this machine stood still: " if any("stood still" in line for line in scene.log) else ""
        return f"{busy}the flight did not end as planned: {scene.log[-3:]}"
    return ""
