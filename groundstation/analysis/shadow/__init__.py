"""Offline comparison: our estimator and controller over a recorded .tlog."""
