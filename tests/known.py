"""Values that a test cannot do without."""

from typing import TypeVar

T = TypeVar("T")


def known(value: T | None) -> T:
    """Return ``value``; the test fails where it is None."""
    assert value is not None
    return value
