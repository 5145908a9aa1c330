"""The heart of a flight, sans-IO: what is computed from poses to commands, and what is refused."""
