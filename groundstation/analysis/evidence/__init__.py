"""Flights that others recorded: import, and how well our estimator predicts them."""

from groundstation.analysis.evidence.evidence import evidence_command
from groundstation.analysis.evidence.imports import import_command
from groundstation.analysis.evidence.shadow import (
    FlownPath,
    OpenedRecording,
    RecordedVehicle,
    flying,
    open_recording,
    read_recording,
    shadow_command,
)
