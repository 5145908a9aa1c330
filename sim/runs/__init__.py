"""Simulated flights, one or several, in virtual time or real time, and their judge."""
