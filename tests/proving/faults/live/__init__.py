"""Faults that need processes of their own, in real time."""
