"""What a name is wherever it becomes part of a path, a topic or a line: of a vehicle, of a client. Sans-IO."""

import re

_FIRST, _NEXT = "[A-Za-z0-9]", "[A-Za-z0-9_.-]"
"""The first a letter or a digit: no option, no hidden file, no folder above."""
NAME = f"{_FIRST}{_NEXT}*"
"""A name within a longer pattern."""
VEHICLE_LETTERS, CLIENT_LETTERS = 24, 32
"""So long may the name of a vehicle be, and that of a client."""


def name_of(most: int) -> str:
    """The pattern of a whole name of at most ``most`` letters; ``$`` would let a line end pass."""
    return rf"\A{_FIRST}{_NEXT}{{0,{most - 1}}}\Z"


def a_name(most: int) -> str:
    """The same in words."""
    return f"a name matching {in_words(name_of(most))}"


def in_words(pattern: str) -> str:
    """``pattern``, that of a whole text, as people write it."""
    return pattern.removeprefix(r"\A").removesuffix(r"\Z")


def is_name(text: str, most: int) -> bool:
    """Whether ``text`` is one of at most ``most`` letters."""
    return re.search(name_of(most), text) is not None
