"""Numbers in texts of a user: arguments, cells of a table, answers.

Python takes ``1_0`` for 10; a person who writes it means 1.0, or two cells. TOML, in which
``1_000`` is a number, is read elsewhere.
"""

from groundstation.config.config_notices import config_notice


def parse_number(text: str) -> float:
    """Parse a number, which may be NaN or infinite.

    Raises:
        ValueError: it is none.
    """
    return float(_without_underscores(text))


def parse_whole_number(text: str) -> int:
    """Parse a whole number.

    Raises:
        ValueError: it is none.
    """
    return int(_without_underscores(text))


def _without_underscores(text: str) -> str:
    if "_" in text:
        raise ValueError(config_notice("value.underscore", found=text))
    return text
