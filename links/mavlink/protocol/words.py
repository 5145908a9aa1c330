"""What an autopilot says in words, so that its refusals can be quoted. Sans-IO."""

from collections import deque

from links.core.printable import printable
from links.mavlink.protocol.codec import Message

_WARNING = 4
"""MAV_SEVERITY_WARNING; lower is graver."""


class Words:
    """What the autopilot said of late (STATUSTEXT), long texts put together again, and only what is fit to be shown."""

    def __init__(self) -> None:
        """Nothing said yet."""
        self._texts: deque[tuple[int, int, str]] = deque(maxlen=20)

    def hear(self, message: Message) -> None:
        """Take one STATUSTEXT."""
        number, severity, text = message.id, message.severity, message.text
        if number and message.chunk_seq and self._texts and self._texts[-1][0] == number:
            text = self._texts.pop()[2] + text
        self._texts.append((number, severity, text))

    @property
    def newest(self) -> str:
        """The newest text, or an empty string."""
        return printable(self._texts[-1][2].strip()) if self._texts else ""

    def complaints(self) -> str:
        """The last warnings and errors, newest last, each once; an empty string where there are none."""
        texts = [printable(text.strip()) for _, severity, text in self._texts if severity <= _WARNING]
        return "; ".join(f"“{text}”" for text in list(dict.fromkeys(texts))[-3:])
