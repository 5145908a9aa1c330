"""How long what was sent had to wait for its answer."""

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple


class LatencyFailed(Exception):
    """The program that flies did not fly; the text says how far it came."""


class Answers(NamedTuple):
    """How long what was sent had to wait for its answer [s]."""

    latencies_s: list[float]
    sent: int
    overtaken: int = 0
    """Poses that a newer one followed before a command left: what answered the newer one has answered them, late."""


class Waiting:
    """The poses that no command has answered yet. Times are on the event loop's clock [s]."""

    def __init__(self) -> None:
        """None yet."""
        self.latencies_s: list[float] = []
        self.overtaken = 0
        self._left: deque[float] = deque()

    def left(self, now_s: float) -> None:
        """A pose has left."""
        self._left.append(now_s)

    def command(self, computed_ms: int, now_s: float) -> None:
        """A command has come, computed in the millisecond ``computed_ms`` (modulo 2³²).

        It answers every pose that had left by then; one between two poses, from what is known, answers no pose.
        """
        answered = 0
        while self._left and (computed_ms - int(1e3 * self._left[0])) & 0xFFFFFFFF < 1 << 31:
            self.latencies_s.append(now_s - self._left.popleft())
            answered += 1
        self.overtaken += max(answered - 1, 0)


def figures_of(answers: Answers) -> dict[str, float]:
    """Percentiles [µs] of all that were answered, overtaken ones too; how many those were, and how many were not."""
    ordered = sorted(answers.latencies_s)

    def percentile(p: float) -> float:
        return round(1e6 * ordered[min(int(p * len(ordered)), len(ordered) - 1)], 1)

    if not ordered:
        raise LatencyFailed("nothing came back")
    return {
        "p50_us": percentile(0.5),
        "p99_us": percentile(0.99),
        "p999_us": percentile(0.999),
        "count": len(ordered),
        "overtaken": answers.overtaken,
        "unanswered": answers.sent - len(ordered),
    }


def together(several: Sequence[Answers]) -> Answers:
    """Those of several flights as of one."""
    return Answers(
        [latency for one in several for latency in one.latencies_s],
        sum(one.sent for one in several),
        sum(one.overtaken for one in several),
    )
