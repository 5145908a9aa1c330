"""The byte tables of the pose sources, shared by the tests of readers, writers and fuzz."""

import pathlib

import msgspec

from groundstation.core.geometry import Frames, Quat, Vec3
from groundstation.pose.sources import (
    Intake,
    JsonReader,
    NatNetReader,
    PoseReader,
    QualisysReader,
    ViconReader,
    VisionReader,
)
from groundstation.pose.sources.vicon_codec import ViconObject


class GoldenPose(msgspec.Struct, frozen=True):
    """Where the vehicle is, in our frames."""

    position_ned: Vec3
    attitude: Quat


class Row(msgspec.Struct, frozen=True):
    """A datagram: it makes a pose, or it is dropped for a reason."""

    about: str
    hex: str
    pose: GoldenPose | None = None
    drop: str | None = None

    @property
    def datagram(self) -> bytes:
        return bytes.fromhex(self.hex)


class Table(msgspec.Struct, frozen=True):
    """One file."""

    about: str
    prelude: tuple[str, ...]
    rows: tuple[Row, ...]


GOLDEN = pathlib.Path(__file__).parent / "golden"
FILES = {
    "natnet 3.0": "natnet_3_0.json",
    "natnet 4.1": "natnet_4_1.json",
    "qualisys": "qualisys_rtp.json",
    "json": "json_poses.json",
    "vision": "vision_position_estimate.json",
}
TABLES = {
    name: msgspec.json.decode((GOLDEN / file).read_bytes(), type=Table)
    for name, file in FILES.items()
}


def fresh_reader(name: str) -> PoseReader:
    """A reader of the table ``name`` that has heard the prelude; it looks for the body ``quad``."""
    reader = _reader(name.split(maxsplit=1)[0])
    for datagram in TABLES[name].prelude if name in TABLES else ():
        assert reader.read(bytes.fromhex(datagram), 0.0) == ()
    return reader


def _reader(kind: str) -> PoseReader:
    match kind:
        case "natnet":
            return NatNetReader("quad", Intake(0.0, Frames("nue", "fur")))
        case "vicon":
            return ViconReader(OURS, Intake(0.0))
        case "qualisys":
            qualisys = QualisysReader("quad", Intake(0.0, Frames("nwu", "flu")))
            qualisys.names = ("wand", "quad")
            return qualisys
        case "json":
            seconds, frames = (Intake(0.0, Frames("nwu", "flu"), frame_s=s) for s in (None, 0.02))
            return JsonReader("quad", seconds, frames)
        case _:
            return VisionReader(Intake(0.0))


class ViconReadable(msgspec.Struct, frozen=True):
    """A datagram and what it says."""

    about: str
    frame_number: int
    size: int
    objects: tuple[ViconObject, ...]
    hex: str

    @property
    def datagram(self) -> bytes:
        return bytes.fromhex(self.hex)


class ViconDropped(msgspec.Struct, frozen=True):
    """A datagram that a decoder for the object ``mqx`` drops, and why."""

    about: str
    reason: str
    hex: str

    @property
    def datagram(self) -> bytes:
        return bytes.fromhex(self.hex)


class ViconTable(msgspec.Struct, frozen=True):
    """The file of Vicon's datagrams."""

    about: str
    readable: tuple[ViconReadable, ...]
    dropped: tuple[ViconDropped, ...]


VICON = msgspec.json.decode((GOLDEN / "vicon_object_stream.json").read_bytes(), type=ViconTable)
OURS = "mqx"
"""The object that is in every readable datagram."""


def datagrams(name: str) -> list[bytes]:
    """Those of the table ``name``, good and bad."""
    if name == "vicon":
        return [row.datagram for row in VICON.readable] + [row.datagram for row in VICON.dropped]
    return [row.datagram for row in TABLES[name].rows]
