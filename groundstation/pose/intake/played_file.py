"""The file of a recorded source, read whole."""

from collections.abc import Mapping
from pathlib import Path

from groundstation.core.messages.pose import SourceError

_MCAP = b"\x89MCAP0\r\n"
"""How a recording of our own begins."""


def contents(path: Path) -> bytes:
    """All of the file ``path``, as ``pose.path`` names it.

    Raises:
        SourceError: it can't be read, or it is a recording that has to be exported first.
    """
    try:
        data = path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a path that no system takes
        raise SourceError(f"pose.path: cannot read {path}: {getattr(error, 'strerror', None) or error}") from None
    if data.startswith(_MCAP):
        raise SourceError(
            f"pose.path: {path} is the recording of a flight: `groundstation export {path} --format poses` makes the "
            'file that pose.kind = "csv" plays'
        )
    return data


def no_poses(path: Path, dropped: Mapping[str, int], expected: str) -> SourceError:
    """What to raise for a file without poses: ``dropped`` counts what it holds instead, by reason."""
    found = ", ".join(f"{count} {reason}" for reason, count in sorted(dropped.items())) or "nothing at all"
    return SourceError(f"pose.path: {path} holds no poses (found: {found}); {expected}")
