"""Pose sources by vendor: one or two files each."""
