"""One page about a recorded flight, with its figures."""
