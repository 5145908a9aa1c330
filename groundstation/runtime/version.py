"""Version: which release this is, of all three packages."""

__version__ = "0.1.0"
"""The same as in pyproject.toml. CONTRIBUTING.md says what a new one promises."""
