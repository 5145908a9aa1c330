"""From a limit that is passed to what is done about it: one step of hold → land → failsafe descent after the other.

What lasts on after its answer is answered by the next step, unless no landing could end it, as an empty battery.
"""

import math
from enum import IntEnum
from typing import NamedTuple


class Step(IntEnum):
    """What may follow, in the order of escalation."""

    WARN = 0
    HOLD = 1
    LAND = 2
    DESCEND = 3


class Finding(NamedTuple):
    """A limit that is passed."""

    step: Step
    reason: str
    blind: bool = False
    """True where the estimate of the speed is not to be believed."""
    most: Step = Step.DESCEND
    """The last step that follows where it lasts on: what does not go away by landing is no reason to land worse."""


class Since:
    """Since when each of several conditions has been so, by name. Times are on the event loop's clock [s]."""

    def __init__(self) -> None:
        """Nothing is so."""
        self._since: dict[str, float] = {}

    def lasts(self, name: str, so: bool, now_s: float, for_s: float) -> bool:
        """Whether it is ``so`` and has been at every look for at least ``for_s`` [s]."""
        if not so:
            self._since.pop(name, None)
            return False
        return now_s - self._since.setdefault(name, now_s) >= for_s - 1e-9


class Escalation:
    """Turns findings into steps: each no gentler than the last, the next one where its cause lasts on."""

    def __init__(self, lasting_s: float) -> None:
        """Nothing found."""
        self._lasting = lasting_s
        self._step = Step.WARN
        self._at_s = -math.inf

    def answer(self, finding: Finding, now_s: float) -> Finding | None:
        """What to do now about ``finding``; None where the last answer is still at work."""
        if finding.step > self._step:
            answer = finding
        elif self._step < finding.most and now_s - self._at_s > self._lasting:
            answer = Finding(Step(self._step + 1), f"{finding.reason}, still", finding.blind, finding.most)
        else:
            return None
        self._step, self._at_s = answer.step, now_s
        return answer

    def eased(self) -> None:
        """The operator has sent it on: begin anew."""
        self._step, self._at_s = Step.WARN, -math.inf
