"""Version: which release this is, of all three packages."""

__version__ = "0.1.0"
"""Version, equal to pyproject.toml's. CONTRIBUTING.md says what a new one promises."""
