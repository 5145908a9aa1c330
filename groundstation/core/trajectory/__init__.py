"""Trajectories with exact derivatives, and what they ask of a vehicle."""
