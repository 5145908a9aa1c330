"""Telemetry to an MQTT broker, and sealed requests from it."""
