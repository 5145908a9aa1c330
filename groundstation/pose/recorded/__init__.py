"""Recorded pose sources: CSV and .tlog, played back."""
