"""Frames of RF modules and the channels in them, sans-IO. A new module is a file and a line of kinds.py."""
