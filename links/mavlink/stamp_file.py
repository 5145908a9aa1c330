"""Stamp file: the newest time stamp that signed a frame, kept on disk beside the key.

No time stamp may be used twice, also not after a restart with a clock that was set back: the next
run begins behind the newest one.
"""

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from links.io import read_key
from links.mavlink.protocol import LAST_STAMP, TICKS_PER_S, Signer
from links.text import link_notice

_EPOCH = datetime(2015, 1, 1, tzinfo=UTC)
"""Zero of MAVLink's signing time stamps."""


class StampFile:
    """File with the newest time stamp of a key, beside the key."""

    def __init__(self, key_file: Path) -> None:
        self._key_file = key_file
        self._path = key_file.with_name(key_file.name + ".stamp")

    def make_signer(self, time_s: Callable[[], float]) -> Signer:
        """Return a signer whose stamps follow the last run's, and the clock ``time_s()`` [s].

        Raises:
            ValueError: the key or its newest stamp can't be used.
        """
        key, first, begun_s = read_key(self._key_file), self.first(), time_s()
        signer = Signer(key, lambda: first + int((time_s() - begun_s) * TICKS_PER_S))
        signer.stamp = first - 1
        return signer

    def first(self) -> int:
        """Return the first stamp of this run: now, or behind the last run's where that is later.

        Raises:
            ValueError: the file is damaged.
        """
        now = int((datetime.now(UTC) - _EPOCH).total_seconds() * TICKS_PER_S)
        try:
            kept = int(self._path.read_text("ascii"))
            if not 0 <= kept < LAST_STAMP:
                raise ValueError(
                    link_notice("mavlink.stamp_range", stamp=kept, last=LAST_STAMP - 1)
                )
        except FileNotFoundError:
            kept = 0
        except (OSError, ValueError) as error:
            raise ValueError(
                link_notice("mavlink.stamp_unread", path=self._path, why=error)
            ) from None
        return max(now, kept + 1)

    def keep(self, stamp: int) -> None:
        """Write ``stamp``, all or nothing.

        Raises:
            ValueError: the folder can't be written.
        """
        new = self._path.with_name(self._path.name + ".new")
        try:
            new.write_text(f"{stamp}\n", "ascii")
            new.replace(self._path)
        except OSError as error:
            raise ValueError(
                link_notice("mavlink.stamp_unwritten", path=self._path, why=error.strerror)
            ) from None
