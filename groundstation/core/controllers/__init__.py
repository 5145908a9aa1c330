"""Controllers to fly with: ours, the baselines, and a user's own."""
