"""Motors off at once, asked for until the autopilot has said yes. Sans-IO."""

from links.core import LinkError, LinkLost, LinkRejected
from links.mavlink.procedures.command import ACCEPTED
from links.mavlink.procedures.steps import Autopilot
from links.mavlink.protocol import ARM_DISARM, FORCE, Message

AGAIN_S = 0.05
"""Time between two requests [s]."""
PATIENCE_S = 5.0
"""How long it is asked for [s]."""
CERTAIN = 2
"""So many acceptances end it: one alone may answer an order to arm that was under way."""
HINT = "Use the remote control's kill switch"


class Kill:
    """Disarm by force (COMMAND_LONG 400, second parameter 21196), which works in the air. A step (steps.py)."""

    def __init__(self, autopilot: Autopilot) -> None:
        """Nothing leaves before the first poll."""
        self.done = False
        self.failure: LinkError | None = None
        self._autopilot = autopilot
        self._began_s: float | None = None
        self._next_s = 0.0
        self._sent = 0
        self._accepted = 0
        self._refused: int | None = None

    def poll(self, now_s: float) -> list[bytes]:
        """The request, where it is due."""
        if self._began_s is None:
            self._began_s = self._next_s = now_s
        if self.done or self.failure is not None or now_s < self._next_s:
            return []
        if now_s > self._began_s + PATIENCE_S:
            self._give_up()
            return []
        self._next_s = now_s + AGAIN_S
        self._sent += 1
        asked = self._autopilot
        again = min(self._sent - 1, 255)
        return [asked.codec.command(asked.system, asked.component, ARM_DISARM, 0.0, FORCE, confirmation=again)]

    def hear(self, message: Message, now_s: float) -> None:
        """Take the answer, where ``message`` is one."""
        if message.get_type() != "COMMAND_ACK" or message.command != ARM_DISARM or not self._sent:
            return
        if message.result == ACCEPTED:
            self._accepted += 1
            self.done = self._accepted >= CERTAIN
        else:
            self._refused = message.result

    def _give_up(self) -> None:
        if self._accepted:  # the rest of the answers got lost
            self.done = True
        elif self._refused is None:
            self.failure = LinkLost(f"no answer to “motors off”, sent {self._sent} times. {HINT}")
        else:
            name, because = self._autopilot.name, self._autopilot.codec.result_name(self._refused)
            reason = self._autopilot.words.complaints() or "it gave no reason"
            self.failure = LinkRejected(f"{name} refused to stop the motors ({because}): {reason}. {HINT}")
