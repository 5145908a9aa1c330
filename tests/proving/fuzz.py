"""Random and damaged bytes for every decoder of poses and links.

Nothing may raise, and a stream that comes in pieces must say the same as one that comes whole.
"""

import random
import struct
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, partial
from itertools import pairwise
from typing import Any, NamedTuple

import msgspec
from fastcrc.crc8 import dvb_s2
from fastcrc.crc16 import mcrf4xx

from groundstation.pose import TlogReader, sources
from links import rf
from links.bridge import codec as bridge_codec
from links.core import Command
from links.mavlink.protocol import MavlinkCodec, load_dialect
from tests.mavlink_table import FRAMES
from tests.pose_tables import GOLDEN, TABLES, datagrams, fresh_reader

PERIOD_S = 0.01
"""Time from one datagram to the next [s]."""


class Subject(NamedTuple):
    """One decoder, with good datagrams to damage."""

    seeds: Sequence[bytes]
    feed: Callable[[bytes, float], int]
    """Decodes one datagram at a time [s]; returns how many events came of it."""
    drops: Callable[[], Mapping[str, int]]
    """Counts of drops so far."""
    repair: Callable[[bytes], bytes] = bytes
    """A damaged datagram with lengths and checksums that fit, so that damage gets past them."""
    decode_stream: Callable[[Sequence[bytes]], object] | None = None
    """Decoding of a stream in these pieces; None for a decoder of datagrams."""


def read_poses(name: str, repair: Callable[[bytes], bytes] = bytes) -> Subject:
    """The reader of the table ``name``, which has heard the prelude."""
    reader = fresh_reader(name)
    return Subject(
        datagrams(name),
        lambda data, now: len(reader.read(data, now)),
        lambda: reader.status.dropped,
        repair,
    )


def read_natnet(name: str) -> Subject:
    """Messages of the handshake are among the frames, as damaged ones are believed."""

    def repair(datagram: bytes) -> bytes:
        size = min(max(len(datagram) - 4, 0), 0xFFFF)
        return datagram[:2] + struct.pack("<H", size) + datagram[4:]

    subject = read_poses(name, repair)
    return subject._replace(seeds=[*map(bytes.fromhex, TABLES[name].prelude), *subject.seeds])


def read_qualisys() -> Subject:
    """The contents of QTM's data packets, and the packets of its stream."""

    def frame(pieces: Sequence[bytes]) -> tuple[list[bytes], bool]:
        framer = sources.Framer()
        return [packet for piece in pieces for packet in framer.feed(piece)], framer.broken

    return read_poses("qualisys")._replace(decode_stream=frame)


@cache
def _load_pairs(tlog: str, names: tuple[str, ...]) -> list[bytes]:
    messages = [record.message for record in TlogReader((GOLDEN / tlog).read_bytes())]
    frames = [bytes(m.get_msgbuf()) for m in messages if m.get_type() in names]
    return list(map(bytes.__add__, frames, frames[1:]))


def read_flown(decoder: sources.PoseDecoder, tlog: str) -> Subject:
    """Poses of a real autopilot: two messages of its recording in one datagram, as it may be."""
    codec = MavlinkCodec(255, 190)

    def feed(data: bytes, now_s: float) -> int:
        made = [decoder.decode(message, now_s) for message in codec.feed(data, "sender")]
        return len(made) - made.count(None)

    return Subject(
        _load_pairs(tlog, decoder.messages),
        feed,
        lambda: codec.dropped + decoder.intake.dropped,
        repair_mavlink,
    )


def read_tlog() -> Subject:
    """Records of a .tlog: a message behind its time."""
    drops: Counter[str] = Counter()

    def feed(datagram: bytes, now_s: float) -> int:
        reader = TlogReader(datagram)
        count = sum(1 for _ in reader)
        drops.update(reader.dropped)
        return count

    seeds = [(n * 10_000).to_bytes(8, "big") + row.frame for n, row in enumerate(FRAMES)]
    return Subject(seeds, feed, lambda: drops, lambda data: data[:8] + repair_mavlink(data[8:]))


def repair_mavlink(frame: bytes) -> bytes:
    """A damaged MAVLink 2 frame with the length and the checksum of what it holds."""
    if len(frame) < 12:
        return frame
    number = int.from_bytes(frame[7:10], "little")
    message = load_dialect().mavlink_map.get(number)
    if message is None:
        return frame
    body = bytes([min(len(frame) - 12, 255)]) + b"\0" + frame[3:-2][:263]
    return b"\xfd" + body + mcrf4xx(body + bytes([message.crc_extra])).to_bytes(2, "little")


SOURCES: dict[str, Callable[[], Subject]] = {
    "vicon": partial(read_poses, "vicon"),
    "natnet 3.0": partial(read_natnet, "natnet 3.0"),
    "natnet 4.1": partial(read_natnet, "natnet 4.1"),
    "qualisys": read_qualisys,
    "json": partial(read_poses, "json"),
    "vision": partial(read_poses, "vision", repair_mavlink),
    "odometry": lambda: read_flown(sources.OdometryDecoder(0.0), "px4_takeoff.tlog"),
    "local_position": lambda: read_flown(
        sources.LocalPositionDecoder(0.0), "ardupilot_landing.tlog"
    ),
    "tlog": read_tlog,
}
"""Decoders of pose sources; a new source adds its own here."""

LONGEST = 2000
"""Longest random datagram [bytes]."""
LIFE = 50
"""Datagrams that one decoder is fed: after a stamp of the far future it takes no other any more."""
STREAM_PACKETS = 6
"""Datagrams in one stream, which is fed whole and in pieces."""
_AWKWARD = (
    bytes(8), b"\xff" * 8, b"\xff\xff\xff\x7f", b"\x00\x00\x00\x80",
    struct.pack("<d", float("nan")), struct.pack("<f", float("inf")),
    struct.pack("<f", float("nan")), struct.pack("<d", -1e308), b"1e999", b"null", b'"',
)  # fmt: skip


def try_damaged(
    make: Callable[[], Subject], count: int, seed: int = 0
) -> tuple[int, Mapping[str, int]]:
    """Feed ``count`` damaged datagrams to a decoder; return its count of events and its drops.

    Raises:
        Exception: what the decoder raises, with the datagram as a note.
        AssertionError: a stream says something else in pieces.
    """
    chance, events, drops = random.Random(seed), 0, Counter[str]()
    for _ in range(count // LIFE):
        subject = make()
        damaged = list(_damage_some(subject, chance))
        for n, datagram in enumerate(damaged):
            try:
                events += subject.feed(datagram, n * PERIOD_S)
            except Exception as error:
                error.add_note(f"fed {datagram.hex()}")
                raise
        decode = subject.decode_stream
        for first in range(0, LIFE, STREAM_PACKETS):
            if decode is None:
                break
            stream = b"".join(damaged[first : first + STREAM_PACKETS])
            cuts = sorted(chance.choices(range(len(stream) + 1), k=chance.randrange(1, 12)))
            pieces = [stream[begin:end] for begin, end in pairwise([0, *cuts, len(stream)])]
            assert decode([stream]) == decode(pieces), (stream.hex(), cuts)
        drops.update(subject.drops())
    return events, drops


def _damage_some(subject: Subject, chance: random.Random) -> Iterator[bytes]:
    """Random bytes, good datagrams, and damaged ones, some with their checksums put right."""
    seeds = subject.seeds
    for _ in range(LIFE):
        draw = chance.random()
        if draw < 0.1:
            yield chance.randbytes(chance.randrange(LONGEST if draw < 0.05 else 40))
            continue
        data = bytearray(chance.choice(seeds))
        if draw > 0.15:
            for _ in range(chance.choice((1, 1, 2, 4, 8))):
                _damage(data, chance, seeds)
        yield subject.repair(bytes(data)) if chance.random() < 0.5 else bytes(data)


def _damage(data: bytearray, chance: random.Random, seeds: Sequence[bytes]) -> None:
    place = chance.randrange(len(data) + 1)
    match chance.randrange(8):
        case 0 if place < len(data):
            data[place] ^= 1 << chance.randrange(8)
        case 1 if place < len(data):
            data[place] = chance.randrange(256)
        case 2:
            del data[place:]
        case 3:
            del data[place : place + chance.randrange(1, 9)]
        case 4:
            data[place:place] = chance.randbytes(chance.randrange(1, 9))
        case 5:
            data[place:] = chance.choice(seeds)[place:]
        case 6:
            data += data[place:][:LONGEST]
        case _:
            awkward = chance.choice(_AWKWARD)
            data[place : place + len(awkward)] = awkward


def read_mavlink() -> Subject:
    """The link's own codec, on messages of real autopilots."""
    codec = MavlinkCodec(245, 190)
    return Subject(
        [row.frame for row in FRAMES],
        lambda data, now: len(codec.feed(data, "sender")),
        lambda: codec.dropped,
        repair_mavlink,
        _decode_mavlink,
    )


def _decode_mavlink(pieces: Sequence[bytes]) -> tuple[list[bytes], Counter[str]]:
    codec = MavlinkCodec(245, 190)
    return [bytes(m.get_msgbuf()) for piece in pieces for m in codec.feed(piece)], codec.dropped


CRSF_TELLS = (
    bytes.fromhex("08 004c 0000 000000 50"),
    bytes.fromhex("14 28 2b 64 09 00 05 03 32 64 08"),
    bytes.fromhex("1e 0064 ff38 1ee6"),
    b"\x21ACRO\0",
    bytes.fromhex("3a ea ee 10 00009c40 fffffed4"),
)
"""Telemetry through a module: type and payload of battery, link, attitude, mode and timing."""


def read_rf(kind: str) -> Subject:
    """Frames to a serial RF module: every channel from end to end, and each service."""
    codec = rf.RF_CODECS[kind]().codec()
    decoder = codec.decoder()
    seeds = [codec.encode([0.1 * n - 1.0] * codec.channels) for n in range(21)]
    seeds += [codec.encode([0.0] * codec.channels, service) for service in codec.services]
    if kind == "crsf":
        seeds += [repair_crsf(b"\xea\0" + told + b"\0") for told in CRSF_TELLS]

    def feed(datagram: bytes, now_s: float) -> int:
        heard = decoder.feed(datagram)
        decoder.pause()  # it stands alone on the wire
        return len(heard)

    def decode_stream(pieces: Sequence[bytes]) -> tuple[list[str], dict[str, int]]:
        fresh = codec.decoder()
        return [repr(heard) for piece in pieces for heard in fresh.feed(piece)], fresh.dropped

    return Subject(seeds, feed, lambda: decoder.dropped, repair_crsf, decode_stream)


def repair_crsf(frame: bytes) -> bytes:
    """A damaged frame of CRSF with its length and checksum; other modules' frames have neither."""
    if frame[:1] not in (b"\xee", b"\xc8", b"\xea") or not 4 <= len(frame) <= 64:
        return frame
    body = frame[2:-1]
    return frame[:1] + bytes([len(body) + 1]) + body + bytes([dvb_s2(body)])


def read_board() -> Subject:
    """A flight controller's own port: answers of MSP and of its command line, by the documents."""
    seeds = [
        b"$M>" + rf.encode_request(command, bytes(range(command % 40)))[3:]
        for command in range(1, 200)
    ]
    seeds += [
        b"get thr_expo\r\nthr_expo = 0\r\nAllowed range: 0 - 100\r\n\r\n# ",
        b"aux 0 0 0 1700 2100 0 0\r\n",
    ]
    reader = rf.MspReader()

    def feed(datagram: bytes, now_s: float) -> int:
        answers = reader.feed(datagram)
        for answer in answers:
            if len(answer.payload) >= 10:
                rf.is_armed(answer.payload)
        said = datagram.decode("ascii", "replace")
        rf.find_refusal(said)
        changes = [rf.describe_change(*setting) for setting in rf.find_settings(said).items()]
        return len(answers) + len(changes)

    def repair(datagram: bytes) -> bytes:
        command = datagram[4] if len(datagram) > 4 else 0
        return b"$M>" + rf.encode_request(command, datagram[5:-1][:255])[3:]

    def decode_stream(pieces: Sequence[bytes]) -> object:
        fresh = rf.MspReader()
        return [answer for piece in pieces for answer in fresh.feed(piece)]

    return Subject(seeds, feed, lambda: reader.dropped, repair, decode_stream)


def read_bridge() -> Subject:
    """Fuzz a bridge's input; damage is sealed, or it would not be looked into."""
    nonces = (bytes(range(bridge_codec.NONCE_BYTES)), bytes(bridge_codec.NONCE_BYTES))
    seal, theirs = (bridge_codec.session_seals(b"k" * 32, *nonces)[0] for _ in range(2))
    drops: Counter[str] = Counter()
    command = Command(0.8, (0.1, -0.2, 0.3), 7, 1.0, 1.1)
    ups = [bridge_codec.Up(0.1 * n, 0.1 * n, 5.0, n, 0.2, False, command) for n in range(5)]
    ups += [bridge_codec.Up(1.0, 1.0, 5.0, stopped=True), bridge_codec.Up(1.0, 1.0, 5.0, end=True)]
    ups += [bridge_codec.Up(1.0, 1.0, 5.0, serve=(1, service, 2.0)) for service in rf.Service]

    def repair(datagram: bytes) -> bytes:
        # In the next datagram of the session.
        payload: Any = msgspec.Raw(datagram[21 : -bridge_codec.TAG_BYTES])
        return seal.close(payload)

    return Subject(
        [seal.close(up) for up in ups],
        lambda data, now: int(theirs.open(data, bridge_codec.UPS, drops) is not None),
        lambda: drops,
        repair,
    )


LINKS: dict[str, Callable[[], Subject]] = {
    "mavlink": read_mavlink,
    "dsm": lambda: read_rf("dsm"),
    "crsf": lambda: read_rf("crsf"),
    "betaflight": read_board,
    "rf_bridge": read_bridge,
}
"""Decoders of links; a new link adds its own here."""
