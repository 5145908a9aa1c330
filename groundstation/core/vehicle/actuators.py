"""The actuators as the controller believes them: first-order lags on thrust and body rates, and their inverse.

Both are exact for a command that is held. Elementwise: floats, or arrays of shape (N,).
"""

from groundstation.core.geometry.ops import Ops, Real


def approach(ops: Ops, duration: Real, lag: float) -> Real:
    """How much of a step has arrived after ``duration`` [s] through a lag [s]: 1 - e^(-h/τ); 1 without lag."""
    return 1.0 - ops.exp(-duration / lag) if lag > 0.0 else 1.0


def lead(ops: Ops, hold: Real, lag: float) -> Real:
    """Inverse of the lag for a command held ``hold`` seconds: x_cmd = x + lead · x˙ makes x rise by hold · x˙.

    h/(1 - e^(-h/τ)) → τ for h → 0; h where there is no lag. With τ instead only 0.8-0.9 of a step arrives.
    """
    return hold / approach(ops, hold, lag)
