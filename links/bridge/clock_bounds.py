"""What another machine's clock shows, as far as messages between us can tell: bounds, not an estimate. Sans-IO."""

import math

DRIFT = 2e-4
"""How fast two machines' clocks may run apart [-]: crystals stay within a tenth of that."""


ROUNDING_S = 1e-6
"""Bounds may cross by so little [s]."""


class ClockBounds:
    """Bounds on what must be added to the other's clock to get ours [s].

    A message that left there at their t and came here at our T says: at most T - t. One that left here at our T and had
    come there by their t says: at least T - t. The tightest of each kind is kept, and loosened by the drift as it ages.
    """

    def __init__(self) -> None:
        self.least_s, self.most_s = -math.inf, math.inf
        self._at_s = 0.0

    def narrow(self, least_s: float, most_s: float, now_s: float) -> bool:
        """Take two new bounds; False where they contradict the old ones: a clock has jumped. Then only they count."""
        if not math.isfinite(least_s + most_s):
            return False
        # Each is true of an instant up to a round trip ago.
        drifted = DRIFT * max(0.0, most_s - least_s)
        least_s, most_s = least_s - drifted, most_s + drifted
        slack = DRIFT * max(0.0, now_s - self._at_s)
        least, most = max(self.least_s - slack, least_s), min(self.most_s + slack, most_s)
        self._at_s = now_s
        if least > most + ROUNDING_S:
            self.least_s, self.most_s = least_s, most_s
            return False
        self.least_s, self.most_s = least, most
        return True

    @property
    def middle_s(self) -> float:
        """Half-way between the bounds."""
        return 0.5 * (self.least_s + self.most_s)

    @property
    def width_s(self) -> float:
        """How far apart they are: at best the round trip."""
        return self.most_s - self.least_s
