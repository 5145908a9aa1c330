"""The search for gains, and how wrong the world may be with them."""
