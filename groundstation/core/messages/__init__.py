"""What the parts of a flight hand to each other, and show to others: poses, estimates, decisions, requests."""
