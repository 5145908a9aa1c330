"""A scenario flown a thousand times in drawn worlds."""
