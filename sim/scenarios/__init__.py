"""The scenarios by name, and how one becomes the truth and what the controller is told."""
