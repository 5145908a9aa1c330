"""The newest value through shared memory: never half of one, whatever either side is at."""

import subprocess
import sys
from binascii import crc32

import pytest
from hypothesis import given, strategies as st

from links.rf import Mailbox

# By their numbers: a limit that the test took from the code would bear out any value.
CAPACITY_BYTES = 16384

WRITER = """
import sys, time
from links.rf.shared_memory import Mailbox
box = Mailbox(int(sys.argv[1]))
end, number = time.monotonic() + float(sys.argv[2]), 0
while time.monotonic() < end:
    number += 1
    box.put(number.to_bytes(8, "big") * (1 + number % 500))
box.put(b"the last")
"""


def close(writer: Mailbox, reader: Mailbox) -> None:
    reader._words.release()
    reader._bytes.release()
    reader._memory.close()
    writer.close()


def test_the_newest_value_is_got_once() -> None:
    writer = Mailbox()
    reader = Mailbox(writer.fd)
    assert reader.get() is None
    for value in (b"one", b"two", b"", b"x" * CAPACITY_BYTES):
        writer.put(value)
    assert reader.get() == b"x" * CAPACITY_BYTES
    assert reader.get() is None
    writer.put(b"")
    assert reader.get() == b""
    close(writer, reader)


def test_records_have_these_bytes() -> None:
    """Slots of 24 + 16,384 bytes begin at byte 64: number, size, CRC-32 of both, value."""
    writer = Mailbox()
    writer.put(b"first")
    writer.put(b"second!")
    memory = bytes(writer._memory[:])
    assert len(memory) == 64 + 2 * 16408
    assert memory[:8] == (2).to_bytes(8, "little")
    for slot, number, value in ((64 + 16408, 1, b"first"), (64, 2, b"second!")):
        head = (number, len(value), crc32(value, number))
        assert memory[slot : slot + 24] == b"".join(word.to_bytes(8, "little") for word in head)
        assert memory[slot + 24 : slot + 24 + len(value)] == value
    assert not any(memory[8:64])
    with pytest.raises(ValueError, match="16385 bytes"):
        writer.put(bytes(16385))
    writer.close()


values = st.binary(max_size=40)


@given(st.lists(values, min_size=1, max_size=4), values, st.data())
def test_a_writer_that_stops_anywhere_leaves_the_value_before_or_none(
    before: list[bytes], value: bytes, data: st.DataObject
) -> None:
    """Any mixture of memory before and after: a processor may reorder its stores."""
    writer = Mailbox()
    for each in before:
        writer.put(each)
    old = bytes(writer._memory[:])
    writer.put(value)
    new = bytes(writer._memory[:])
    changed = [at for at in range(0, len(old), 8) if old[at : at + 8] != new[at : at + 8]]
    for at in changed:
        if data.draw(st.booleans()):
            writer._memory[at : at + 8] = old[at : at + 8]
    reader = Mailbox(writer.fd)
    got = reader.get()
    assert got in (before[-1], value, None)
    if got == value != before[-1]:
        assert writer._words[0] == len(before) + 1
    close(writer, reader)


@pytest.mark.real_time
def test_two_processes_at_full_speed_never_show_each_other_half_a_value() -> None:
    box = Mailbox()
    seen = 0
    newest = 0
    with subprocess.Popen(
        [sys.executable, "-c", WRITER, str(box.fd), "0.4"], pass_fds=[box.fd]
    ) as writer:
        while True:
            value = box.get()
            if value == b"the last":
                break
            if value is None:
                assert writer.poll() in (None, 0)
                continue
            number = int.from_bytes(value[:8], "big")
            assert value == number.to_bytes(8, "big") * (1 + number % 500)
            assert number > newest
            newest, seen = number, seen + 1
    box.close()
    assert seen > 10
