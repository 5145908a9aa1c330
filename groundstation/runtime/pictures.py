"""Whether pictures can be drawn at all: matplotlib is an extra."""

from groundstation.config import ConfigError


def need_matplotlib(key: str, says: str) -> None:
    """Find out before any work is done that ends in a picture.

    Raises:
        ConfigError: matplotlib is not installed; it is said by ``key`` and in the words ``says``.
    """
    try:
        import matplotlib as _  # noqa: F401  # only whether it is there
    except ImportError:
        raise ConfigError(key, says) from None
