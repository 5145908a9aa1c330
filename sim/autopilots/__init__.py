"""Simulated autopilots: PX4 and ArduPilot, as they were seen to behave towards a ground station."""
