"""Flights without a terminal: the daemon, its signals, logs and health."""
