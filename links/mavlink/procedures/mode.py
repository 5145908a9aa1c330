"""In which mode an autopilot is now: by itself it tells that only once a second. Sans-IO.

Source: mavlink.io/en/messages/common.html (0 HEARTBEAT, MAV_CMD_REQUEST_MESSAGE).
"""

import math

from links.core import LinkError, LinkLost
from links.mavlink.procedures.steps import Autopilot
from links.mavlink.protocol import REQUEST_MESSAGE, Message

AGAIN_S, PATIENCE_S = 0.1, 1.5
"""An autopilot that does not tell is asked again after so long, and not at all after the second [s]."""


class AskMode:
    """Ask for HEARTBEAT, which tells the mode and comes only once a second by itself; done when one has been heard.

    One that refuses is waited for. Its answer is waited for, too: a HEARTBEAT of before the question may be under way.
    """

    def __init__(self, autopilot: Autopilot) -> None:
        """Nothing is asked yet."""
        self.failure: LinkError | None = None
        self._autopilot = autopilot
        self._heard = self._answered = False
        self._asked = 0
        self._next_s = self._until_s = -math.inf

    @property
    def done(self) -> bool:
        """True when it has told."""
        return self._heard and self._answered

    def poll(self, now_s: float) -> list[bytes]:
        """The question, where it is due."""
        if self._asked == 0:
            self._until_s = now_s + PATIENCE_S
        if self.done or now_s < self._next_s:
            return []
        if now_s >= self._until_s:
            self.failure = LinkLost(f"it did not tell its mode within {PATIENCE_S:g} s")
            return []
        self._next_s = now_s + AGAIN_S
        self._asked += 1
        return [question(self._autopilot, self._asked - 1)]

    def hear(self, message: Message, now_s: float) -> None:
        """Take a heartbeat, or the answer."""
        name = message.get_type()
        self._heard = self._heard or name == "HEARTBEAT"
        self._answered = self._answered or (name == "COMMAND_ACK" and message.command == REQUEST_MESSAGE)


def question(autopilot: Autopilot, repetition: int = 0) -> bytes:
    """The frame that asks for HEARTBEAT."""
    codec, number = autopilot.codec, float(autopilot.codec.message_number("HEARTBEAT"))
    system, component = autopilot.system, autopilot.component
    return codec.command(system, component, REQUEST_MESSAGE, number, confirmation=min(repetition, 255))
