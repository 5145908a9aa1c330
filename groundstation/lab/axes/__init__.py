"""Axis calibration: a tracker's axes and latency from a vehicle carried by hand."""
