"""One command to an autopilot (COMMAND_LONG) until its answer (COMMAND_ACK). Sans-IO.

Source: mavlink.io/en/services/command.html.
"""

from collections.abc import Sequence

from links.core import LinkRejected
from links.mavlink.procedures.steps import ANSWER_S, TRIES, Autopilot, Repeated
from links.mavlink.protocol import Message

PATIENCE_S = 4.0
"""For how long a refusal that may pass is answered by asking again [s]."""
AGAIN_S = 1.0
"""Pause before asking again after such a refusal [s]."""
WORDS_S = 0.3
"""How long after a refusal the autopilot's explanation may still arrive [s]."""

ACCEPTED, TEMPORARILY_REJECTED, FAILED, IN_PROGRESS = 0, 1, 4, 5
_MAY_PASS = (TEMPORARILY_REJECTED, FAILED)


class Exchange(Repeated):
    """One COMMAND_LONG until its COMMAND_ACK."""

    def __init__(
        self,
        autopilot: Autopilot,
        what: str,
        command: int,
        params: Sequence[float],
        hint: str,
        patience_s: float = PATIENCE_S,
        any_answer: bool = False,
    ) -> None:
        """Ask ``autopilot`` for ``command``; a refusal quotes its words and ends with ``hint``: what to do.

        A refusal that may pass is final after ``patience_s`` [s]; with ``any_answer`` it is as good as a yes.
        """

        def frame(repetition: int) -> bytes:
            system, component = autopilot.system, autopilot.component
            return autopilot.codec.command(system, component, command, *params, confirmation=repetition)

        super().__init__(what, frame)
        self._autopilot = autopilot
        self._command = command
        self._hint = hint
        self._patience = patience_s
        self._any_answer = any_answer
        self._refused: tuple[int, float] | None = None

    def poll(self, now_s: float) -> list[bytes]:
        """The request, where it is due."""
        if self._refused is None:
            return super().poll(now_s)
        result, at_s = self._refused
        if now_s >= at_s + WORDS_S and self.failure is None:
            name, because = self._autopilot.name, self._autopilot.codec.result_name(result)
            reason = self._autopilot.words.complaints() or "it gave no reason"
            self.failure = LinkRejected(f"{name} refused to {self._what} ({because}): {reason}. {self._hint}")
        return []

    def hear(self, message: Message, now_s: float) -> None:
        """Take the answer, where ``message`` is one and answers us."""
        if message.get_type() != "COMMAND_ACK" or message.command != self._command or not self._sent:
            return
        if message.target_system not in (0, self._autopilot.codec.system_id):
            return
        result = message.result
        began_s = now_s if self._since_s is None else self._since_s
        if result == ACCEPTED or self._any_answer:
            self.done = True
        elif result == IN_PROGRESS:
            self._answered(now_s + ANSWER_S * TRIES)
        elif result in _MAY_PASS and now_s < began_s + self._patience:
            self._answered(now_s + AGAIN_S)
        else:
            self._refused = (result, now_s)
