"""Pose sources: intake, clocks, the outlier gate, and forwarding to the autopilot."""
