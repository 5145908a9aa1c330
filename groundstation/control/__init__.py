"""How a vehicle is controlled: the pure law, the blocks around it, the estimator."""
