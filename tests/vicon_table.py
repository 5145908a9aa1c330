"""The byte table of the Vicon stream, shared by the tests of reader, writer, source and by the fuzz tests."""

import pathlib

import msgspec

from groundstation.pose.sources.vicon_codec import ViconObject


class Readable(msgspec.Struct, frozen=True):
    """A datagram and what it says."""

    about: str
    frame_number: int
    size: int
    objects: tuple[ViconObject, ...]
    hex: str

    @property
    def datagram(self) -> bytes:
        return bytes.fromhex(self.hex)


class Dropped(msgspec.Struct, frozen=True):
    """A datagram that a decoder for the object ``mqx`` drops, and why."""

    about: str
    reason: str
    hex: str

    @property
    def datagram(self) -> bytes:
        return bytes.fromhex(self.hex)


class Table(msgspec.Struct, frozen=True):
    """The whole file."""

    about: str
    readable: tuple[Readable, ...]
    dropped: tuple[Dropped, ...]


_PATH = pathlib.Path(__file__).parent / "golden" / "vicon_object_stream.json"
TABLE = msgspec.json.decode(_PATH.read_bytes(), type=Table)
OURS = "mqx"
"""The object that is in every readable datagram."""
