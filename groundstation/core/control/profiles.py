"""Flight profiles: the gain set, the limits in their order, and the tones of the phases of one
kind. Sans-IO.
"""

from collections.abc import Callable
from typing import NamedTuple

import msgspec

from groundstation.core.control.adaptive import Gains, calm_gains, hold_gains
from groundstation.core.control.controllers import ControllerConfig
from groundstation.core.control.limits import (
    FirstClimbLimit,
    LevelNearGround,
    Limit,
    ThrustLimit,
    TiltLimit,
    UplinkLostLimit,
)

GainSet = Callable[[Gains], Gains]
"""Largest gains of a profile, as a function of those configured."""


class FlightProfile(NamedTuple):
    """Profile of phases of one kind."""

    gains: GainSet | None
    """Gain set; None for the configured gains."""
    suspect_gains: GainSet | None
    """Gain set while the poses are suspect."""
    limits: tuple[type[Limit], ...]
    """Limits on each command, in this order."""
    is_excited: bool
    """Whether tones are flown all the time, as a response is not seen otherwise."""


TRACKING = FlightProfile(None, None, (FirstClimbLimit, UplinkLostLimit), is_excited=False)
"""Along the trajectory: its motion shows whether the poses respond."""
HOLDING = FlightProfile(hold_gains, calm_gains, (FirstClimbLimit, UplinkLostLimit), is_excited=True)
"""At one place."""
TRANSIT = FlightProfile(
    calm_gains,
    calm_gains,
    (FirstClimbLimit, TiltLimit, ThrustLimit, LevelNearGround, UplinkLostLimit),
    is_excited=True,
)
"""Between places: climb, way to a point, way back, landing."""
DESCENT_LIMITS: tuple[type[Limit], ...] = (UplinkLostLimit,)
"""Limits of a failsafe descent, whose controller limits tilt and thrust itself."""


class GainSchedule:
    """Gains of our own controller: those configured, or set in flight, within the gain set of the
    phase.
    """

    def __init__(self, config: ControllerConfig) -> None:
        self._config = config if isinstance(config, Gains) else None
        self._set: GainSet | None = None

    @property
    def gains(self) -> Gains | None:
        """Gains to fly with; None where the controller is not ours."""
        return (
            self._config if self._config is None or self._set is None else self._set(self._config)
        )

    def set_gain(self, name: str, value: float) -> bool:
        """Set one gain; return whether our controller has it."""
        if self._config is None:
            return False
        self._config = msgspec.structs.replace(self._config, **{name: value})
        return True

    def use(self, gain_set: GainSet | None) -> bool:
        """Use ``gain_set`` from now on; return whether the gains change."""
        is_same, self._set = gain_set is self._set, gain_set
        return not is_same and self._config is not None
