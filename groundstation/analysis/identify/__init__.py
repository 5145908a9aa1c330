"""Thrust, lags, delay and drag of a vehicle from a recorded flight."""

from groundstation.analysis.identify.command import find_outside, identify, identify_command
from groundstation.analysis.identify.fit import find_noise, respond_with_lag
from groundstation.analysis.identify.stretch import (
    LEAST_S,
    POSE_GAP_S,
    SETTLING_S,
    FlightStretch,
    StretchTooShort,
    find_stretch,
    read_stretch,
)
