"""Step timer: raises in a step of the user's code that does not return, and remembers one that was slow.

For flights in real time. A timer signal (SIGALRM) interrupts Python code wherever it is, also where it
sleeps or waits for a socket. Compiled code that never returns is not interrupted: Python runs no handler
before it does.
"""

import signal
from collections.abc import Callable
from types import FrameType

from groundstation.config import STEP_WATCH, StepWatch
from groundstation.core.messages import notice

LIMIT_S = 0.5
"""A step that has not returned after this time is interrupted [s]. By then no command may rest on a pose
(flight.coast_s and guards.level_s: 0.5 s), and the link plays its bring-down."""
AGAIN_S = 0.05
"""Period of repeated interrupts [s]: code that catches every exception may go on."""
SLOW_S = 0.1
"""A step that takes longer is named [s]: a command must leave within 0.25 s of its pose (flight.coast_s),
and the pose's own latency and the link take their share."""
SLOWER = 1.5
"""A slower step is named again from this factor on [-]."""
RECENT_S = 1.0
"""Steps that ended within this time may be why no command left in time [s]."""


class StepTimeout(BaseException):
    """A step of the user's code has not returned in time. No Exception: code that catches those goes on."""


class StepTimer(StepWatch):
    """Watches steps by the timer of this process; one at a time, and in the main thread."""

    def __init__(self, now_s: Callable[[], float], on_alarm: Callable[[], object]) -> None:
        """``now_s`` is a clock of real time [s]; ``on_alarm`` hears of a SIGALRM that somebody else has sent."""
        self._now_s = now_s
        self._on_alarm = on_alarm
        self._what = ""
        self._begun_s = 0.0
        self._slowest_s = SLOW_S
        self._newest = ""
        self._newest_s = 0.0
        self._ours_until_s = 0.0
        """An alarm up to then may be of a step that has just ended [s]."""

    def start(self) -> None:
        """Watch all steps of this context from now on; to be called in the main thread."""
        signal.signal(signal.SIGALRM, self._interrupt)
        STEP_WATCH.set(self)

    def begin(self, what: str) -> None:
        """The step of ``what`` begins."""
        self._what, self._begun_s = what, self._now_s()
        signal.setitimer(signal.ITIMER_REAL, LIMIT_S, AGAIN_S)

    def end(self) -> None:
        """Note that the step has returned."""
        what, self._what = self._what, ""
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        now_s = self._now_s()
        took_s = now_s - self._begun_s
        if took_s <= SLOW_S:
            return
        if took_s > LIMIT_S - AGAIN_S:
            self._ours_until_s = now_s + 2.0 * AGAIN_S
        self._newest_s = now_s
        self._newest = notice("code.slow", what=what, took_ms=1e3 * took_s, limit_ms=1e3 * SLOW_S)
        if took_s > SLOWER * self._slowest_s or not self.slow:
            self.slow, self._slowest_s = self._newest, took_s

    def find_recent(self) -> str:
        """Return the newest step that was too slow, where it was within a second; else nothing."""
        return self._newest if self._now_s() - self._newest_s < RECENT_S else ""

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        now_s = self._now_s()
        if self._what and now_s - self._begun_s > LIMIT_S - AGAIN_S:
            raise StepTimeout(notice("code.hangs", limit_ms=1e3 * LIMIT_S))
        if not self._what and now_s > self._ours_until_s:
            self._on_alarm()
