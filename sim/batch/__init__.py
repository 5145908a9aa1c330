"""Many flights at once: the same law, estimator and plant on arrays of vehicles."""
