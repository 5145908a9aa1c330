"""The truth of a simulated flight: plant, wind, vehicle, and the scenarios."""
