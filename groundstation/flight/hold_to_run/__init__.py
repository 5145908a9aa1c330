"""The operator's own dead man: what must be held for a vehicle to fly."""
