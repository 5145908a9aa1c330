"""Thrust, lags, delay, drag and noise of a vehicle from a recorded flight."""
