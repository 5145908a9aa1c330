"""Pages of docs/reference that are made from the code: ``groundstation-sim reference --write docs/reference``."""
