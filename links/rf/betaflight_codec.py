"""Protocols of a Betaflight board's own port: frames of MSP, and the answers of its command line.

Sans-IO.

MSP version 1, 115200 baud 8N1 or USB; numbers with the low byte first:

    bytes 0..2    "$M<" to the board, "$M>" from it, "$M!" where it knows no such command
    byte 3        length n of the payload, 0..255
    byte 4        command
    5 .. 4+n      payload
    byte 5+n      XOR of bytes 3 to 4+n

Command 2: four letters, BTFL. 3: version, a byte each. 101, status: its u32 at byte 6 has bit 0 set
while it is armed, as ARM is the first of the modes there. 160: three u32 by which each processor
differs.

A "#" between frames opens the command line, not while it is armed; from then on it can't be armed
until it was restarted. A line is echoed and answered, and after each answer comes a new line and "#
". ``get`` answers with each setting whose name holds the word, ``name = value``. Source: Betaflight
4.6, src/main/msp/msp.c, msp_serial.c, msp_box.c, and cli/cli.c.
"""

import math
import re
import struct
from enum import IntEnum
from functools import reduce
from operator import xor
from typing import NamedTuple

from links.rf.codec import FrameReader, RfLinkConfig
from links.rf.module_codec import DsmLinkConfig
from links.text import link_notice


class MspCommand(IntEnum):
    """Commands of MSP."""

    FC_VARIANT = 2
    """Name of the firmware."""
    FC_VERSION = 3
    STATUS = 101
    """State of the board."""
    UID = 160
    """Unique id of the processor."""


class BoardMode(IntEnum):
    """Modes of a board, by their numbers; a status has a bit for each."""

    ARM = 0


VARIANT = b"BTFL"
PROMPT = "\n# "
"""Prompt of the command line."""
_REQUEST, _ANSWERS = b"$M<", (b"$M>", b"$M!")
_FRAME_BYTES = 6
"""Bytes of a frame beside its payload [B]."""
_MODES = struct.Struct("<6xI")
_REFUSES = re.compile(r"###ERROR|invalid|unknown|parse error", re.IGNORECASE)
_ROWS = re.compile(
    r"^(aux|rxrange|rxfail) (\d+) ([ahs\d][\d ]*?)\s*$|^(map) ([A-Z0-9]{8})\s*$", re.MULTILINE
)


class MspAnswer(NamedTuple):
    """One frame from the board."""

    command: int
    payload: bytes
    known: bool
    """False where the board knows no such command."""


def encode_request(command: int, payload: bytes = b"") -> bytes:
    """The frame that asks the board for ``command``.

    Raises:
        ValueError: the payload is longer than 255 bytes.
    """
    body = bytes((len(payload), command)) + payload
    return _REQUEST + body + bytes((_xor(body),))


class MspReader(FrameReader[MspAnswer]):
    """Finds a board's answers by their head, length and checksum."""

    def _find_end(self, data: bytes, at: int) -> int | str:
        head = data[at : at + 3]
        if not any(kind.startswith(head) for kind in _ANSWERS):
            return "not_a_frame"
        if at + 3 >= len(data):
            return at + 4
        end = at + _FRAME_BYTES + data[at + 3]
        if end <= len(data) and _xor(data[at + 3 : end - 1]) != data[end - 1]:
            return "bad_checksum"
        return end

    def _decode_frame(self, frame: bytes) -> MspAnswer:
        return MspAnswer(frame[4], frame[5:-1], frame[:3] == _ANSWERS[0])


def is_armed(status: bytes) -> bool:
    """Return whether the payload of a :attr:`MspCommand.STATUS` says that the board is armed.

    Raises:
        ValueError: it is too short to say it.
    """
    if len(status) < _MODES.size:
        raise ValueError(f"expected at least {_MODES.size} bytes of status, got {len(status)}")
    (modes,) = _MODES.unpack_from(status)
    return bool(modes >> BoardMode.ARM & 1)


def find_refusal(answer: str) -> str | None:
    """The line in an answer of the command line that says that it refuses.

    None where it does not.
    """
    return next((line.strip() for line in answer.splitlines()[1:] if _REFUSES.match(line)), None)


def find_settings(answer: str) -> dict[str, float | str]:
    """Every setting in an answer of the command line: ``name = value``, and rows of tables.

    Rows of a table go by their numbers: ``aux 0`` is ``0 0 1700 2100 0 0``, ``rxfail 4`` is
    ``s 1000``.
    """
    found: dict[str, float | str] = {}
    for line in answer.splitlines():
        name, equals, value = line.partition(" = ")
        if equals and re.fullmatch(r"\w+", name):
            found[name] = parse_value(value.strip())
    for table, number, row, single, letters in _ROWS.findall(answer):
        found[f"{table} {number}" if table else single] = row or letters
    return found


def parse_value(text: str) -> float | str:
    """A number where it is a finite one, else the word."""
    try:
        number = float(text)
    except ValueError:
        return text
    return number if math.isfinite(number) else text


def describe_change(name: str, value: float | str) -> str:
    """The line of the command line that changes a setting, as :func:`find_settings` names it."""
    said = f"{value:g}" if isinstance(value, float) else value
    return f"{name} {said}" if " " in name or name == "map" else f"set {name} = {said}"


def describe_pulses(config: RfLinkConfig) -> tuple[float, str]:
    """Half of the range between the positions -1 and 1 [µs], and the board's channel ``map``.

    Raises:
        ValueError: thrust or a rate is on a channel beyond the eighth.
    """
    named = config.map
    letters = {
        named.roll.channel: "A",
        named.pitch.channel: "E",
        named.thrust.channel: "T",
        named.yaw.channel: "R",
    }
    if max(letters) > 8:
        raise ValueError(link_notice("rf.betaflight_channels"))
    others = iter("1234")
    order = "".join(letters.get(channel) or next(others) for channel in range(1, 9))
    return (0.5 * (config.high - config.low) if isinstance(config, DsmLinkConfig) else 512.0), order


def _xor(data: bytes) -> int:
    return reduce(xor, data, 0)
