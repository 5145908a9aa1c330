"""Uplink of commands: whether they reach the vehicle, by its acknowledgements and its telemetry.

Sans-IO.
"""

import math

from groundstation.core.messages import Sentence, notice
from groundstation.core.safety import LATE_PERIODS
from links.core import NEWS_S, SILENCE_S, UPLINK_LOST_S, Arrival, CommandLink
from links.text import to_ms

INTERVAL_WEIGHT = 0.1
"""Weight of each interval in its running mean [-]. Chosen."""


class CommandUplink:
    """Whether commands reach the vehicle, and whether its telemetry stalls.

    Times are on the loop's clock [s].
    """

    def __init__(self, link: CommandLink) -> None:
        self._link = link
        self._telemetry_s, self._interval_s = -math.inf, 0.0
        self.is_down = False
        """Whether acknowledgements are overdue by more than ``SILENCE_S``."""
        self.is_late = False
        """Whether commands arrive too late."""

    def check(self, now_s: float) -> Sentence | None:
        """Set :attr:`is_down` and :attr:`is_late` for this frame.

        Return why commands can't fly the vehicle although its telemetry arrives; None if they reach
        it in time, or are overdue for less than ``UPLINK_LOST_S``.
        """
        autopilot = self._link.autopilot
        overdue_s, late_s = Arrival() if autopilot is None else autopilot.arrival(now_s)
        self.is_down, self.is_late = overdue_s > SILENCE_S, late_s > 0.0
        if self.is_late:
            return notice("fault.late_commands", late_ms=to_ms(late_s))
        return (
            notice("fault.unanswered", overdue_ms=to_ms(overdue_s))
            if overdue_s > UPLINK_LOST_S
            else None
        )

    def take_telemetry(self, now_s: float) -> None:
        """Take the time of a telemetry message."""
        since_s, self._telemetry_s = now_s - self._telemetry_s, now_s
        if since_s < NEWS_S:
            self._interval_s += INTERVAL_WEIGHT * (since_s - self._interval_s)

    def is_stalled(self, now_s: float) -> bool:
        """Whether the telemetry is silent for longer than usual, but not lost.

        After ``NEWS_S`` it is lost, and commands count as arriving again.
        """
        stall_s = max(SILENCE_S, LATE_PERIODS * self._interval_s)
        return stall_s < now_s - self._telemetry_s < NEWS_S
