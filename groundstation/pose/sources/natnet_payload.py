"""The payload of a NatNet message (natnet_codec.py), read from front to back. Sans-IO."""

import struct
from typing import Any

U32 = struct.Struct("<I")


class Unreadable(Exception):
    """Why a message can't be read, as one word; never leaves the callers of these codecs."""


class Payload:
    """Reads a payload from front to back; whatever leads beyond its end is ``truncated``."""

    def __init__(self, data: bytes) -> None:
        """Begin at the front."""
        self._data = data
        self._at = 0

    def take(self, layout: struct.Struct) -> tuple[Any, ...]:
        """The next values, of this layout."""
        try:
            values = layout.unpack_from(self._data, self._at)
        except struct.error:
            raise Unreadable("truncated") from None
        self._at += layout.size
        return values

    def count(self) -> int:
        """The next u32: a number of elements, or of bytes."""
        return int(self.take(U32)[0])

    def section(self, sized: bool) -> int:
        """The number of elements of the next section, which is ``sized`` where it tells its bytes, too."""
        count = self.count()
        if sized:
            self.skip(4)
        return count

    def skip(self, size: int) -> None:
        """Pass over so many bytes."""
        self._at += size
        if self._at > len(self._data):
            raise Unreadable("truncated")

    def text(self) -> str:
        """The next text, up to its NUL."""
        end = self._data.find(b"\0", self._at)
        if end < 0:
            raise Unreadable("truncated")
        text = text_of(self._data[self._at : end])
        self._at = end + 1
        return text


def text_of(data: bytes) -> str:
    """The text in a field, up to its first NUL."""
    return data.partition(b"\0")[0].decode("utf-8", "replace")
