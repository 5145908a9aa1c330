"""Arguments of ``groundstation-sim``: what their values may be.

Each raises ArgumentTypeError where one is not.
"""

import argparse


def count(text: str) -> int:
    """Parse a whole number of at least 1."""
    return _from(1, text)


def whole(text: str) -> int:
    """A whole number, 0 or more."""
    return _from(0, text)


def _from(least: int, text: str) -> int:
    from groundstation.config import parse_whole_number

    try:
        value = parse_whole_number(text)
    except ValueError:
        value = least - 1
    if value < least:
        from sim.text import notice

        raise argparse.ArgumentTypeError(str(notice("value.whole_number", least=least, found=text)))
    return value


def names(text: str) -> list[str]:
    """Names between commas, each once, and one at least."""
    found = list(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    if not found:
        from sim.text import notice

        raise argparse.ArgumentTypeError(str(notice("value.names", found=text)))
    return found
