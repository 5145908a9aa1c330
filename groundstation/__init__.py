"""Offboard flight of quadrotors: poses in, thrust and body rates out."""

__version__ = "0.1.0"
"""Of all three packages; the same as in pyproject.toml. docs/how-to/release.md says what a new one promises."""
