"""What an autopilot's heartbeats say of it, and how long they have not come. Sans-IO."""

import math
from typing import Any

from links.mavlink.protocol.codec import ARMED, Message

STALE_NEWS_S = 0.5
"""A HEARTBEAT may have left before the arming that it denies: it is not believed for this long after it [s]."""


class Heard:
    """The one autopilot at the other end. Times are on the event loop's clock [s]."""

    def __init__(self, timeout_s: float) -> None:
        """Not heard yet; silent where it is not heard for longer than ``timeout_s`` [s]."""
        self.kind: int | None = None
        """Its newest HEARTBEAT.autopilot, of when it was heard first or again; None before the first."""
        self.vehicle = 0
        """Its HEARTBEAT.type of then."""
        self.address: Any = None
        """Where it sends from; None where that is not known, or goes without saying."""
        self._timeout = timeout_s
        self._heard_s = 0.0
        self._armed_s: float | None = None

    @property
    def armed(self) -> bool:
        """Whether its motors are believed to be on."""
        return self._armed_s is not None

    def believe_armed(self, since_s: float | None) -> None:
        """Believe that the motors are on since then, or off (None), until a heartbeat tells."""
        self._armed_s = since_s

    def silence_s(self, now_s: float) -> float:
        """Time since its newest heartbeat [s]; infinite where its wire was lost after it."""
        return now_s - self._heard_s

    def is_silent(self, now_s: float) -> bool:
        """Whether its heartbeats have stayed away for too long."""
        return self.silence_s(now_s) > self._timeout

    def lose(self) -> None:
        """Its wire was lost: whatever it says next may be another's, or its own after a restart."""
        self.address = None
        self._armed_s = None
        self._heard_s = -math.inf

    def beat(self, heartbeat: Message, now_s: float) -> bool:
        """Take that it lives; returns whether it was silent before, or not heard at all."""
        news = self.kind is None or self.is_silent(now_s)
        self._heard_s = now_s
        if news:
            self.kind, self.vehicle = heartbeat.autopilot, heartbeat.type
        return news

    def take_armed(self, heartbeat: Message, now_s: float) -> None:
        """Take whether its motors are on."""
        if heartbeat.base_mode & ARMED:
            if self._armed_s is None:
                self._armed_s = now_s
        elif self._armed_s is not None and now_s - self._armed_s > STALE_NEWS_S:
            self._armed_s = None
