"""Several vehicles: their cores together, and the relay of poses between them."""
