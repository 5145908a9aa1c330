"""Random and damaged bytes for every decoder."""
