"""Pose monitor: any pose source live, without flying."""
