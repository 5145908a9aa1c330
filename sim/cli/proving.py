"""What only proves: it lives beside the tests (tests/proving/), and is not in the wheel."""

import importlib
from pathlib import Path
from typing import Any

MEASUREMENTS = (
    "tick", "flight", "command", "decode", "batch", "recording", "allocation", "links", "screen", "mqtt",
)  # fmt: skip
"""What ``groundstation-sim bench`` can measure, in the order in which it does: each a module of tests/proving/bench."""


def proving(command: str, module: str) -> Any:
    """The module ``module`` of tests/proving, for ``command``.

    Raises:
        ConfigError: only the wheel is installed, which does not have it.
    """
    from groundstation.config import ConfigError

    if not (Path(__file__).parents[2] / "tests" / "proving").is_dir():
        raise ConfigError(
            command, "needs a checkout of the repository: it is not in the wheel (clone it, then `make setup`)"
        )
    return importlib.import_module(f"tests.proving.{module}")
