"""Flights that others recorded: import, and how well our estimator predicts them."""

from groundstation.analysis.evidence.evidence import drive_flight, evidence_command, load_flight
from groundstation.analysis.evidence.imports import import_command
