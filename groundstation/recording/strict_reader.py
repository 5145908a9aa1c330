"""MCAP files read strictly: what is out of place is damage.

Loaded only where a recording is read: so is mcap.
"""

import struct
from collections.abc import Collection, Iterator
from typing import BinaryIO

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from zstandard import ZstdError

_DATA = (Opcode.HEADER, Opcode.METADATA, Opcode.CHUNK, Opcode.MESSAGE_INDEX, Opcode.DATA_END)
"""Records before the index. mcap passes over other records; here they are damaged chunks."""
DAMAGE: tuple[type[Exception], ...] = (
    McapError,
    struct.error,
    ValueError,
    EOFError,
    MemoryError,
    ZstdError,
)
"""Exceptions that mcap raises where a file is damaged."""


class StrictReader(StreamReader):
    """mcap's reader, for which a kind of record that is out of place is damage."""

    _in_index = False

    def __init__(self, file: BinaryIO) -> None:
        """Read ``file`` from its beginning, and give its chunks whole."""
        super().__init__(file, emit_chunks=True, validate_crcs=True)

    def _read_record(self, opcode: int, length: int) -> McapRecord | None:
        if not self._in_index and opcode not in _DATA:
            raise McapError(f"a record of kind {opcode} among the data")
        self._in_index = self._in_index or opcode == Opcode.DATA_END
        return super()._read_record(opcode, length)


def read_messages(
    chunk: Chunk, topics: Collection[str], names: dict[int, str]
) -> Iterator[tuple[str, Message]]:
    """The messages of a chunk on ``topics``, with their topic; ``names`` keeps the channels.

    A damaged chunk gives none.
    """
    for record in breakup_chunk(chunk, validate_crc=True):
        match record:
            case Channel(id=number, topic=topic, message_encoding="json"):  # others are for viewers
                if not topics or topic in topics:
                    names[number] = topic
            case Message(channel_id=number) if number in names:
                yield names[number], record
