"""Offboard flight of quadrotors: poses in, thrust and body rates out."""

from groundstation.runtime.version import __version__

__all__ = ["__version__"]
