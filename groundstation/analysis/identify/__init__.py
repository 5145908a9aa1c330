"""Thrust, lags, delay, drag and noise of a vehicle from a recorded flight."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.analysis.identify.command import find_outside, identify, identify_command
    from groundstation.analysis.identify.stretch import (
        LEAST_S,
        FlightStretch,
        StretchTooShort,
        find_stretch,
        read_stretch,
    )


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
