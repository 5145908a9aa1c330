"""Notices that this program stood still: whatever it reads next may have waited as long. Sans-IO.

A pose without a time stamp of its own would otherwise pass for fresh: it lay in its socket meanwhile.
"""

LOOK_S = 0.02
"""How often :meth:`Standstill.look` is to be called, at least [s]."""
STALL_S = 0.06
"""Not having looked for longer than that is standing still [s]."""
DRAIN_S = 0.01
"""For so long afterwards nothing that is read counts: what waits in a socket is read within some milliseconds [s]."""


class Standstill:
    """Times are on the event loop's clock [s]."""

    def __init__(self) -> None:
        """Nothing is expected before the first look."""
        self._looked_s: float | None = None
        self._drained_s = 0.0

    def look(self, now_s: float) -> None:
        """The program runs at ``now_s``."""
        if self._looked_s is not None and now_s - self._looked_s > STALL_S:
            self._drained_s = now_s + DRAIN_S
        self._looked_s = now_s

    def waited(self, now_s: float) -> bool:
        """Whether what is read at ``now_s`` may have come while the program stood still."""
        if self._looked_s is None:
            return False
        self.look(now_s)
        return now_s < self._drained_s
