"""Step timer: raises in a step of the user's code that does not return, and remembers one that was
slow.

For flights in real time. A timer signal (SIGALRM) interrupts Python code wherever it is, also where
it sleeps or waits for a socket; code that catches every exception is interrupted again at its next
line. Code that uses SIGALRM for a timeout of its own is interrupted by the operator's keys
(:meth:`StepTimer.interrupt_by`). Compiled code that never returns is not interrupted: Python runs
no handler before it does.
"""

import signal
import sys
import threading  # noqa: TID251  # it asks which thread it is in
import time  # noqa: TID251  # the timer of the process is one of real time
from collections.abc import Callable
from types import FrameType
from typing import Any

from groundstation.config import STEP_LIMIT_S, STEP_WATCH, StepWatch
from groundstation.core.messages import Sentence, notice
from links.text import to_ms

AGAIN_S = 0.05
"""Period of repeated interrupts [s]: code that catches every exception may go on."""
SLOW_S = 0.05
"""A step that takes longer is reported, once a flight [s]: with what else one frame needs, poses
wait for more than 0.06 s, as in a program that was stalled, and are not used."""
RECENT_S = 1.0
"""Steps that ended within this time are a possible cause of a late command [s]."""


class StepTimeout(BaseException):
    """A step of the user's code has not returned in time.

    No Exception: code that catches those goes on.
    """


class StepTimer(StepWatch):
    """Watches steps by the timer of this process; one at a time, and in the main thread."""

    def __init__(self) -> None:
        """A timer that is not yet started."""
        self.on_alarm: Callable[[], object] = lambda: None
        """Called on a SIGALRM of another sender."""
        self._keys = set[int]()
        """Signals that the event loop handles."""
        self._what = ""
        self._begun_s = 0.0
        self._limit_s = STEP_LIMIT_S
        self._caller: FrameType | None = None
        """The frame that began the step: those above it are the user's."""
        self._interrupts = 0
        """Number of interrupts of the present step [-]."""
        self._interrupted_s = 0.0
        """Time of the newest interrupt [s]."""
        self._newest: Sentence | None = None
        self._newest_s = 0.0
        self._ours_until_s = 0.0
        """End of the time in which an alarm may be of a step that has just ended [s]."""

    @classmethod
    def start(cls) -> "StepTimer":
        """Watch all steps of this context from now on; to be called in the main thread."""
        timer = cls()
        signal.signal(signal.SIGALRM, timer._interrupt)
        STEP_WATCH.set(timer)
        return timer

    def interrupt_by(self, number: int) -> None:
        """Let the signal ``number``, which the event loop handles, also interrupt a late step."""
        signal.signal(number, lambda _number, frame: self._interrupt_late(frame))
        self._keys.add(number)

    def is_interrupted_by_keys(self) -> bool:
        """Whether Ctrl-C raises KeyboardInterrupt in a step: not where the event loop handles
        it.
        """
        return signal.SIGINT not in self._keys

    def run(
        self, what: str, limit_s: float, code: Callable[..., Any], /, *arguments: Any, **named: Any
    ) -> Any:
        """Call ``code`` as a step.

        Only the main thread receives signals: a step in another one is not watched.
        """
        if threading.current_thread() is not threading.main_thread():
            return code(*arguments, **named)
        return super().run(what, limit_s, code, *arguments, **named)

    def begin(self, what: str, limit_s: float = STEP_LIMIT_S) -> None:
        """The step of ``what`` begins, and has ``limit_s`` [s] to return."""
        self._what, self._begun_s, self._limit_s = what, time.monotonic(), limit_s
        self._caller, self._interrupts = sys._getframe(1), 0
        signal.signal(signal.SIGALRM, self._interrupt)  # the step before may have taken it
        signal.setitimer(signal.ITIMER_REAL, limit_s, AGAIN_S)

    def end(self) -> None:
        """Note that the step has returned."""
        what, self._what = self._what, ""
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        self._caller = None
        if self._interrupts > 1:
            sys.settrace(None)
        now_s = time.monotonic()
        took_s = now_s - self._begun_s
        if took_s > self._limit_s - AGAIN_S:
            self._ours_until_s = now_s + 2.0 * AGAIN_S
        if took_s > SLOW_S and self._limit_s <= STEP_LIMIT_S:
            self._newest_s = now_s
            self._newest = notice(
                "code.slow", what=what, took_ms=to_ms(took_s), limit_ms=to_ms(SLOW_S)
            )
            self.slow = self.slow or self._newest

    def find_recent(self) -> Sentence | None:
        """Return the newest step that was too slow, if it ended within the last second.

        Else None.
        """
        return self._newest if time.monotonic() - self._newest_s < RECENT_S else None

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        self._interrupt_late(frame)
        if not self._what and time.monotonic() > self._ours_until_s:
            self.on_alarm()

    def _interrupt_late(self, frame: FrameType | None) -> None:
        now_s = time.monotonic()
        if now_s - self._interrupted_s < 0.5 * AGAIN_S:
            # A key and the alarm at once: the second would be raised where the first is handled.
            return
        if self._what and now_s - self._begun_s > self._limit_s - AGAIN_S:
            self._interrupts += 1
            self._interrupted_s = now_s
            if self._interrupts > 1:  # the code has caught the one before
                self._raise_at_next_line(frame)
            raise self._timeout()

    def _raise_at_next_line(self, frame: FrameType | None) -> None:
        """Have each of the user's frames raise once more at its next line: in the handler that
        catches everything.
        """

        def raise_again(_frame: FrameType, event: str, _argument: object) -> Any:
            if event == "line":
                raise self._timeout()
            return raise_again

        while frame is not None and frame is not self._caller:
            frame.f_trace = raise_again
            frame = frame.f_back
        sys.settrace(lambda *_: None)  # no function that is called from now on is traced

    def _timeout(self) -> StepTimeout:
        if self._limit_s > STEP_LIMIT_S:
            return StepTimeout(notice("code.hangs_making", limit_s=self._limit_s))
        return StepTimeout(notice("code.hangs", limit_ms=to_ms(self._limit_s)))
