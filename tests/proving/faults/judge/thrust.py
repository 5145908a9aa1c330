"""What the station's commands push with once a fault was answered, held against the thrust that hovers."""

import math
from collections.abc import Callable

OVER = 1.03
"""Hovering is known so well [-]: what is up to 3 % more than the true thrust in the wind counts as hovering."""
LIFTS = 0.01
"""A smaller share of the thrust lifts nothing."""


class Thrust:
    """The commands of one flight, as they leave. Times are on the event loop's clock [s]."""

    def __init__(self, hover_n: float, newtons: Callable[[float, float], float], held_s: float) -> None:
        """``hover_n`` hovers in the wind [N]; ``newtons(time_s, signal)`` is what a signal truly gives [N].

        A signal (0..1) counts until the next one, or for as long as it is held: ``held_s`` [s].
        """
        self.answered_s = math.inf
        """From when on it counts: an answer, and what was under way then has left."""
        self.most = 0.0
        """The most thrust since, as a share of what hovers."""
        self.over_s = 0.0
        """For how long altogether it was more than that [s]."""
        self.last_lift_s = -math.inf
        """When a frame last left that lifts, at any time."""
        self._hover = hover_n
        self._newtons = newtons
        self._held = held_s
        self._over = False
        self._newest: tuple[float, float] | None = None

    def told(self, time_s: float, signal: float) -> None:
        """A command leaves."""
        if self._over:
            return
        if signal > LIFTS:
            self.last_lift_s = time_s
        self._close(time_s)
        if time_s >= self.answered_s:
            share = self._newtons(time_s, signal) / self._hover
            self.most = max(self.most, share)
            self._newest = time_s, share

    def end(self, time_s: float) -> None:
        """The flight is over: nothing counts any more."""
        self._close(time_s)
        self._over = True

    def _close(self, time_s: float) -> None:
        if self._newest is not None and self._newest[1] > OVER:
            self.over_s += min(time_s - self._newest[0], self._held)
        self._newest = None
