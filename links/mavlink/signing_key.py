"""The newest time stamp that a key has signed, on disk. The only file of this package that reads the machine's clock.

A time stamp must never be used twice, also not after a restart with a clock that was set back: so the newest one is
kept beside the key, and the next run begins behind it.
"""

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from links.io import read_key
from links.mavlink.protocol import TICKS_PER_S, Signer

_EPOCH = datetime(2015, 1, 1, tzinfo=UTC)


class StampFile:
    """The newest time stamp, beside the key."""

    def __init__(self, key_file: Path) -> None:
        """``key.stamp`` for the key file ``key``."""
        self._path = key_file.with_name(key_file.name + ".stamp")

    def first(self) -> int:
        """Where to begin: now, or behind the newest of the last run where that is later.

        Raises:
            ValueError: the file is damaged.
        """
        now = int((datetime.now(UTC) - _EPOCH).total_seconds() * TICKS_PER_S)
        try:
            kept = int(self._path.read_text("ascii"))
        except FileNotFoundError:
            kept = 0
        except (OSError, ValueError) as error:
            raise ValueError(f"cannot read the newest time stamp in {self._path} ({error}): remove it") from None
        return max(now, kept + 1)

    def keep(self, stamp: int) -> None:
        """Write ``stamp`` down, all or nothing.

        Raises:
            ValueError: the folder can't be written.
        """
        new = self._path.with_name(self._path.name + ".new")
        try:
            new.write_text(f"{stamp}\n", "ascii")
            new.replace(self._path)
        except OSError as error:
            raise ValueError(
                f"cannot write {self._path} ({error.strerror}): signing needs it, or stamps repeat"
            ) from None


class Signing:
    """A key in use: its signer, and the stamps that it may use."""

    def __init__(self, key_file: Path, time_s: Callable[[], float]) -> None:
        """Begin where the last run ended, and follow the clock ``time_s()`` [s].

        Raises:
            ValueError: the key or its newest stamp can't be used.
        """
        key = read_key(key_file)
        self._stamps = StampFile(key_file)
        first, begun_s = self._stamps.first(), time_s()
        self.signer = Signer(key, lambda: first + int((time_s() - begun_s) * TICKS_PER_S))
        self.signer.stamp = first - 1
        self.keep()

    def keep(self) -> None:
        """Write the newest stamp down; raises ValueError."""
        self._stamps.keep(self.signer.stamp)
