"""One flight: pre-arm checks, mission, command loop, shutdown, statistics."""
