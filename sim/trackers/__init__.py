"""Simulated tracking systems: what their cameras see, as the bytes that they send."""
