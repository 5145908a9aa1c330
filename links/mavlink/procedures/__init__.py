"""Procedures that an autopilot goes through with us, sans-IO: arming, parameters, message rates."""
