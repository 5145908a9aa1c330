"""Monitors that a flight of the deck goes on with: the real one, none, or one that is forced to doubt.

A flight comes to its strike with the real monitor and guards; the copies of it differ from there on.
"""

from typing import Any

from groundstation.config import ConfigError
from groundstation.core import Pilot
from groundstation.core.estimation import ModelEstimator
from groundstation.core.safety import PoseEvidence
from groundstation.flight import Flight

UNGUARDED = "off"
"""Neither monitor nor guards."""
SUSPECT = "suspect"
"""Poses that are suspect without a reason."""
FAILED = "failed:"
"""Poses that have failed, for the reason that follows."""


def check_forced(doubt: str) -> None:
    """Check that ``doubt`` can be forced upon a flight.

    Raises:
        ConfigError: it can't.
    """
    if doubt:
        raise ConfigError("--forced", "this monitor can't be forced to doubt")


def take_over(flight: Flight, watch: str, from_s: float) -> None:
    """Have ``flight`` go on with the monitor called ``watch``; a forced doubt begins at ``from_s``."""
    if watch != UNGUARDED:
        return

    def see_nothing(_: Pilot) -> PoseEvidence:
        return PoseEvidence(0.0, 0.0, 0.0, 0.0)

    def do_nothing(*_: Any, **__: Any) -> None:
        return

    for part in vars(flight).values():
        if hasattr(part, "_guards"):
            part._guards = None
    # This process flies nothing else.
    setattr(Pilot, "evidence", property(see_nothing))  # noqa: B010
    setattr(Pilot, "doubt", do_nothing)  # noqa: B010
    setattr(ModelEstimator, "hold", do_nothing)  # noqa: B010
