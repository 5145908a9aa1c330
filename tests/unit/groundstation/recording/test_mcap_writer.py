"""groundstation/recording/writer.py against the package that MCAP's own project publishes."""

import io
import random
from collections.abc import Iterator
from typing import Any

import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from groundstation.recording import McapWriter
from groundstation.recording.writer import CHUNK_BYTES

TOPICS = {"/a": b"{}", "/b": b'{"type": "object"}', "/ü": b"{}"}


def entries(seed: int, count: int, size: int) -> list[tuple[int, int, bytes] | None]:
    """Channel, stamp and data of messages, their stamps not always in order; None: flush."""
    luck = random.Random(seed)
    made: list[tuple[int, int, bytes] | None] = []
    for n in range(count):
        stamp = 1_000_000 * n + luck.randint(0, 3_000_000)
        made.append((luck.randint(1, 2), stamp, luck.randbytes(luck.randint(0, size))))
        if luck.random() < 0.05:
            made.append(None)
    return made


def by_ours(messages: list[tuple[int, int, bytes] | None]) -> bytes:
    file = io.BytesIO()
    writer = McapWriter(file, "test")
    writer.add_metadata("about", {"key": "value", "ü": ""})
    for topic, schema in TOPICS.items():
        writer.add_channel(topic, f"schema of {topic}", schema)
    writer.flush()
    for message in messages:
        if message is None:
            writer.flush()
        else:
            writer.add_message(*message)
    writer.add_metadata("result", {})
    writer.finish()
    return file.getvalue()


def by_theirs(messages: list[tuple[int, int, bytes] | None]) -> bytes:
    file = io.BytesIO()
    writer: Any = Writer(file, compression=CompressionType.ZSTD, enable_data_crcs=True)
    writer.start(library="test")
    writer.add_metadata("about", {"key": "value", "ü": ""})
    for topic, schema in TOPICS.items():
        number = writer.register_schema(f"schema of {topic}", "jsonschema", schema)
        writer.register_channel(topic, "json", number)
    writer.flush()
    for message in messages:
        if message is None:
            writer.flush()
        else:
            channel, stamp, data = message
            writer.add_message(channel, stamp, data, stamp)
    writer.add_metadata("result", {})
    writer.finish()
    return file.getvalue()


@pytest.mark.parametrize("seed", range(5))
def test_the_file_is_the_mcap_packages_byte_for_byte(seed: int) -> None:
    messages = entries(seed, 300, 200)
    assert by_ours(messages) == by_theirs(messages)


def test_a_recording_without_messages_is_the_mcap_packages_too() -> None:
    assert by_ours([]) == by_theirs([])


def test_a_chunk_that_has_grown_long_is_closed_as_by_the_mcap_package() -> None:
    messages = entries(7, 40, CHUNK_BYTES // 8)
    ours = by_ours(messages)
    assert ours == by_theirs(messages)
    summary = make_reader(io.BytesIO(ours)).get_summary()
    assert summary is not None
    assert len(summary.chunk_indexes) > 2


def _complete(data: bytes) -> Iterator[Any]:
    """The records of a file that ends in its middle."""
    try:
        yield from StreamReader(io.BytesIO(data), record_size_limit=None).records
    except EndOfFile:
        return


def test_what_was_flushed_is_in_the_file_and_what_was_not_is_not() -> None:
    file = io.BytesIO()
    writer = McapWriter(file, "test")
    channel = writer.add_channel("/a", "schema", b"{}")
    begun = file.getvalue()
    writer.add_message(channel, 1, b'{"n": 1}')
    assert file.getvalue() == begun
    writer.flush()
    flushed = file.getvalue()
    read = [record for record in _complete(flushed) if isinstance(record, Message)]
    assert [(record.channel_id, record.log_time, record.data) for record in read] == [(channel, 1, b'{"n": 1}')]
    writer.add_message(channel, 2, b'{"n": 2}')
    assert file.getvalue() == flushed
