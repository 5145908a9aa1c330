"""Codecs of RF transmitter modules, by the names that a configuration gives them: CRSF and DSM.

Sans-IO.

CRSF frames (TBS Crossfire, ExpressLRS):

    byte 0        address or sync: 0xEE to a module, 0xC8
    byte 1        length n of what follows, 2..62
    byte 2        type
    3 .. n        payload
    byte 1+n      CRC-8, polynomial 0xD5, over type and payload

Type 0x16: 16 channels of 11 bits, the first in the lowest bits; 172, 992, 1811 are -100, 0, 100 %
(988, 1500, 2012 µs). ExpressLRS takes channel 5 for armed. Type 0x32, a command: destination,
origin, 0x10 (of this system), what, data, CRC-8 of polynomial 0xBA over type to data, and the CRC
of every frame. 400000 baud, 8N1; the sender's period is 4 ms (16 ms at 115200); a module that hears
nothing for 1 s stops sending.

What comes back, numbers with the high byte first: type 0x08, battery: voltage in 0.1 V, current in
0.1 A, 24 bits of mAh, percent (the document says 10 µV; Betaflight's telemetry/crsf.c sends, and
EdgeTX takes, tenths of a volt). 0x14, link: -dBm of both antennas, percent, dB, antenna, profile,
power, and of the way down. 0x1E, attitude: pitch, roll, yaw in 100 µrad; in Betaflight nose down
counts up (its telemetry/mavlink.c turns it round, telemetry/crsf.c does not). 0x21, mode: text to a
zero byte. 0x3A, addressed, sub-type 0x10: 32 bits of period and of how much too early our frames
come, in 100 ns. Source: TBS crsf-spec 1285bbc5; EdgeTX e2bcbd6c; ExpressLRS 7702d0fe.

Frames to a Spektrum DSM2/DSMX module (MLP4DSM, LP4DSM, DX5e class):

    byte 0            0x80 bind, 0x20 range check; 0x10 DSM2, 0x18 DSMX, neither: a ready-to-fly
                      transmitter's module
    byte 1            model (receivers obey the model they were bound to)
    byte 2+2i, 3+2i   i = 0..5: i << 2 | count >> 8, and the count's low byte

14 bytes, 125000 baud, 8N1, no checksum, every 22 ms. Counts are 10 bits; 96, 512, 928 are -100, 0,
100 % of EdgeTX. An MLP4DSM transmitter was seen to send 86 to 938. On the air it becomes Spektrum's
1100 to 1900 µs. Source: EdgeTX e2bcbd6c, radio/src/pulses/dsm2.cpp; captures on noisebridge.net,
Blade_MLP4DSM_RC.
"""

import math
from collections.abc import Sequence
from enum import IntEnum, IntFlag
from typing import Annotated, Literal

import msgspec
from fastcrc import crc8

from links.core import from_euler_zyx
from links.rf.channel_map import ArmSwitch, ChannelMap, Stick, Throttle
from links.rf.codec import (
    FrameReader,
    RfFrame,
    RfLinkConfig,
    RfTelemetry,
    Service,
    counts,
    position,
)
from links.text import link_notice


class DsmFlag(IntFlag):
    """Flags of a DSM frame: protocol on the air, reduced power for the range check, bind."""

    DSMX = 0x08
    DSM2 = 0x10
    RANGE_CHECK = 0x20
    BIND = 0x80


_KNOWN_FLAGS = int(DsmFlag.DSMX | DsmFlag.DSM2 | DsmFlag.RANGE_CHECK | DsmFlag.BIND)
_PROTOCOLS = {"rtf": DsmFlag(0), "dsm2": DsmFlag.DSM2, "dsmx": DsmFlag.DSM2 | DsmFlag.DSMX}


class DsmCount(IntEnum):
    """Counts of a DSM channel."""

    LOW = 96
    """Count of the position -1, as EdgeTX has it."""
    HIGH = 928
    """Count of the position 1."""
    LARGEST = 1023


Count = Annotated[int, msgspec.Meta(ge=0, le=DsmCount.LARGEST.value)]


class DsmLinkConfig(
    RfLinkConfig, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="dsm"
):
    """A DSM2/DSMX module on a serial port. Its polarity is set at the adapter, not here."""

    baud: Annotated[int, msgspec.Meta(ge=1200, le=6_000_000, description="Its speed [bit/s].")] = (
        125000
    )
    protocol: Annotated[
        Literal["rtf", "dsm2", "dsmx"],
        msgspec.Meta(
            description="What the module shall speak on the air; `rtf` for the module of a "
            "ready-to-fly transmitter."
        ),
    ] = "dsmx"
    model_id: Annotated[
        int,
        msgspec.Meta(ge=0, le=255, description="Receivers obey the model that they were bound to."),
    ] = 0
    low: Annotated[
        Count, msgspec.Meta(description="Count of position -1; 86 as the MLP4DSM transmitter.")
    ] = DsmCount.LOW.value
    high: Annotated[
        Count, msgspec.Meta(description="Count of position 1; 938 as the MLP4DSM transmitter.")
    ] = DsmCount.HIGH.value

    def __post_init__(self) -> None:
        if self.low >= self.high:
            raise ValueError(link_notice("rf.reversed"))
        super().__post_init__()

    def codec(self) -> "DsmCodec":
        """The codec that this configures."""
        return DsmCodec(self)


class DsmCodec:
    """Implements :class:`links.rf.codec.RfCodec`."""

    channels = 6
    services = frozenset((Service.BIND, Service.RANGE_CHECK))
    frame_bytes = 14

    def __init__(self, config: DsmLinkConfig) -> None:
        self._config = config
        self._flags = _PROTOCOLS[config.protocol]

    def greeting(self) -> bytes:
        """Nothing: every frame says all."""
        return b""

    def encode(
        self, positions: Sequence[float], service: Service | None = None, nth: int = 0
    ) -> bytes:
        """The frame for six positions; a service is a flag in every frame while it lasts."""
        config = self._config
        low, high = config.low, config.high
        flags = self._flags | (
            DsmFlag.BIND if service is Service.BIND else DsmFlag.RANGE_CHECK if service else 0
        )
        frame = bytearray((flags, config.model_id))
        for i in range(self.channels):
            count = counts(positions[i], low, high, DsmCount.LARGEST)
            frame += bytes((i << 2 | count >> 8, count & 0xFF))
        return bytes(frame)

    def decoder(self) -> "DsmDecoder":
        """A decoder with the same range of counts."""
        return DsmDecoder(self._config.low, self._config.high)


class DsmDecoder(FrameReader[RfFrame]):
    """Finds frames by their shape: they have neither a first byte of their own nor a checksum."""

    def __init__(self, low: int = DsmCount.LOW, high: int = DsmCount.HIGH) -> None:
        """``low`` and ``high`` are the counts of the positions -1 and 1."""
        super().__init__()
        self._low, self._high = low, high

    def _find_end(self, data: bytes, at: int) -> int | str:
        end = at + DsmCodec.frame_bytes
        if end > len(data):
            return end
        numbered = all(data[at + 2 + 2 * i] >> 2 == i for i in range(DsmCodec.channels))
        return end if numbered and not data[at] & ~_KNOWN_FLAGS else "not_a_frame"

    def _decode_frame(self, frame: bytes) -> RfFrame:
        flags, model_id, *channels = frame
        found = [
            (high & 3) << 8 | low for high, low in zip(channels[::2], channels[1::2], strict=True)
        ]
        service = (
            Service.BIND
            if flags & DsmFlag.BIND
            else Service.RANGE_CHECK
            if flags & DsmFlag.RANGE_CHECK
            else None
        )
        return RfFrame(
            tuple(position(count, self._low, self._high) for count in found), service, model_id
        )


class CrsfFrame(IntEnum):
    """Frame types of CRSF."""

    BATTERY = 0x08
    LINK = 0x14
    RC_CHANNELS = 0x16
    ATTITUDE = 0x1E
    MODE = 0x21
    COMMAND = 0x32
    RADIO = 0x3A


class CrsfAddress(IntEnum):
    """Devices that a CRSF frame is for or from.

    The first byte of a frame, where SYNC is a flight controller's.
    """

    BROADCAST = 0x00
    SYNC = 0xC8
    RADIO = 0xEA
    RECEIVER = 0xEC
    MODULE = 0xEE


class CrsfCommand(IntEnum):
    """Command group of this system, and its commands."""

    BIND = 0x01
    MODEL = 0x05
    THIS_SYSTEM = 0x10


class CrsfRadio(IntEnum):
    """Sub-types of RADIO."""

    TIMING = 0x10
    """Period and offset of our frames."""


class CrsfCount(IntEnum):
    """Counts of a CRSF channel."""

    LOW = 172
    """Count of the position -1."""
    HIGH = 1811
    """Count of the position 1."""
    LARGEST = 1984


_ADDRESSES = frozenset(CrsfAddress)
"""First bytes that a CRSF frame may have."""
_LENGTHS = range(2, 63)
"""Values of a CRSF frame's length byte."""
_CHANNEL_BYTES = 22
"""Length of the packed channels [bytes]."""


class CrsfLinkConfig(
    RfLinkConfig,
    frozen=True,
    kw_only=True,
    forbid_unknown_fields=True,
    tag_field="kind",
    tag="crsf",
):
    """An ExpressLRS or TBS Crossfire transmitter module on a serial port."""

    baud: Annotated[
        int,
        msgspec.Meta(
            ge=1200,
            le=6_000_000,
            description="Its speed [bit/s]; an ExpressLRS module finds it out.",
        ),
    ] = 400000
    period_s: Annotated[
        float, msgspec.Meta(ge=0.001, le=0.1, description="Time between two frames [s].")
    ] = 0.004
    map: ChannelMap = ChannelMap(
        roll=Stick(channel=1),
        pitch=Stick(channel=2),
        thrust=Throttle(channel=3),
        yaw=Stick(channel=4, full_rate_deg_s=300.0),
        arm=ArmSwitch(channel=5),
    )
    lead_s: Annotated[
        float,
        msgspec.Meta(
            ge=0.0,
            le=0.02,
            description="How long before its frame leaves a command is asked for [s]. One that "
            "comes later waits for the next frame.",
        ),
    ] = 0.002
    attitude_pitch: Annotated[
        Literal["nose_down", "nose_up"],
        msgspec.Meta(
            description="Which way pitch counts up in the attitude that comes back: as in "
            "Betaflight, or as in ArduPilot."
        ),
    ] = "nose_down"
    address: Annotated[
        Literal["module", "sync"],
        msgspec.Meta(description="First byte of a frame of channels: 0xEE or 0xC8."),
    ] = "module"
    model_id: Annotated[
        Annotated[int, msgspec.Meta(ge=0, le=63)] | None,
        msgspec.Meta(
            description="Model that the module is told when the port opens; ExpressLRS then obeys "
            "only a receiver of that model."
        ),
    ] = None

    def codec(self) -> "CrsfCodec":
        """The codec that this configures."""
        return CrsfCodec(self)


class CrsfCodec:
    """Implements :class:`links.rf.codec.RfCodec`."""

    channels = 16
    services = frozenset((Service.BIND,))
    frame_bytes = 26

    def __init__(self, config: CrsfLinkConfig) -> None:
        self._model = config.model_id
        self._address = CrsfAddress.MODULE if config.address == "module" else CrsfAddress.SYNC
        self._pitch = 1.0 if config.attitude_pitch == "nose_up" else -1.0

    def greeting(self) -> bytes:
        """The model that is selected, where one is configured."""
        return b"" if self._model is None else _command(CrsfCommand.MODEL, self._model)

    def encode(
        self, positions: Sequence[float], service: Service | None = None, nth: int = 0
    ) -> bytes:
        """The frame for 16 positions; the order to bind takes the place of one frame."""
        if service is Service.BIND and nth == 0:
            return _command(CrsfCommand.BIND)
        packed = 0
        for i, at in enumerate(positions):
            packed |= counts(at, CrsfCount.LOW, CrsfCount.HIGH, CrsfCount.LARGEST) << (11 * i)
        return _frame(
            self._address, CrsfFrame.RC_CHANNELS, packed.to_bytes(_CHANNEL_BYTES, "little")
        )

    def decoder(self) -> "CrsfDecoder":
        """A decoder."""
        return CrsfDecoder(self._pitch)


class CrsfDecoder(FrameReader[RfFrame]):
    """Finds frames by their address, length and checksum."""

    def __init__(self, pitch: float) -> None:
        """``pitch``: 1 where the nose up counts up in attitudes, else -1."""
        super().__init__()
        self._pitch = pitch

    def _find_end(self, data: bytes, at: int) -> int | str:
        if at + 2 > len(data):
            return at + 2
        size = data[at + 1]
        if data[at] not in _ADDRESSES or size not in _LENGTHS:
            return "not_a_frame"
        end = at + 2 + size
        if end <= len(data) and crc8.dvb_s2(data[at + 2 : end - 1]) != data[end - 1]:
            return "bad_checksum"
        return end

    def _decode_frame(self, frame: bytes) -> RfFrame:
        kind, payload = frame[2], frame[3:-1]
        if kind == CrsfFrame.RC_CHANNELS and len(payload) >= _CHANNEL_BYTES:
            packed = int.from_bytes(payload[:_CHANNEL_BYTES], "little")
            found = (packed >> (11 * i) & 0x7FF for i in range(CrsfCodec.channels))
            return RfFrame(tuple(position(count, CrsfCount.LOW, CrsfCount.HIGH) for count in found))
        is_order = (
            kind == CrsfFrame.COMMAND
            and len(payload) >= 5
            and payload[2] == CrsfCommand.THIS_SYSTEM
        )
        if is_order and _command_crc(bytes((kind, *payload[:-1]))) == payload[-1]:
            if payload[3] == CrsfCommand.BIND:
                return RfFrame(None, Service.BIND)
            if payload[3] == CrsfCommand.MODEL and len(payload) == 6:
                return RfFrame(None, None, payload[4])
        if kind == CrsfFrame.ATTITUDE and len(payload) >= 6:
            pitch, roll, yaw = (
                1e-4 * int.from_bytes(payload[k : k + 2], "big", signed=True) for k in (0, 2, 4)
            )
            return RfFrame(
                None, tells=RfTelemetry(attitude=from_euler_zyx(roll, self._pitch * pitch, yaw))
            )
        return RfFrame(None, tells=_decode_telemetry(kind, payload))


def _decode_telemetry(kind: int, payload: bytes) -> RfTelemetry | None:
    size = len(payload)
    if kind == CrsfFrame.BATTERY and size >= 8:
        volts = 0.1 * int.from_bytes(payload[:2], "big")
        # No voltage: nobody measures it, and nobody knows the charge.
        return (
            RfTelemetry(battery_v=volts, battery_share=min(payload[7], 100) / 100)
            if volts
            else RfTelemetry()
        )
    if kind == CrsfFrame.LINK and size >= 10:
        first, second, percent, noise = payload[:4]
        strongest = min((x for x in (first, second) if x), default=0)
        snr = noise - 256 if noise > 127 else noise
        return RfTelemetry(
            uplink_share=min(percent, 100) / 100, uplink_dbm=-strongest, uplink_snr_db=snr
        )
    if kind == CrsfFrame.MODE:
        text = payload.split(b"\0")[0].decode("ascii", "replace")
        return RfTelemetry(mode="".join(c for c in text if c.isprintable()))
    if kind == CrsfFrame.RADIO and size >= 11 and payload[2] == CrsfRadio.TIMING:
        return RfTelemetry(early_s=1e-7 * int.from_bytes(payload[7:11], "big", signed=True))
    return None


def encode_attitude(pitch: float, roll: float, yaw: float) -> bytes:
    """The frame by which a module hands on an attitude [rad]."""
    angles = (round(1e4 * math.remainder(angle, math.tau)) for angle in (pitch, roll, yaw))
    return _frame(
        CrsfAddress.RADIO,
        CrsfFrame.ATTITUDE,
        b"".join(angle.to_bytes(2, "big", signed=True) for angle in angles),
    )


def _command(what: int, *data: int) -> bytes:
    payload = bytes((CrsfAddress.MODULE, CrsfAddress.RADIO, CrsfCommand.THIS_SYSTEM, what, *data))
    checksum = _command_crc(bytes((CrsfFrame.COMMAND, *payload)))
    return _frame(CrsfAddress.SYNC, CrsfFrame.COMMAND, payload + bytes((checksum,)))


def _frame(address: int, kind: int, payload: bytes) -> bytes:
    body = bytes((kind,)) + payload
    return bytes((address, len(body) + 1)) + body + bytes((crc8.dvb_s2(body),))


def _command_crc(data: bytes) -> int:
    """Return the CRC-8 inside a command: polynomial 0xBA, which no library has."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ (0xBA if crc & 0x80 else 0)) & 0xFF
    return crc


RF_CODECS: dict[str, type[RfLinkConfig]] = {"dsm": DsmLinkConfig, "crsf": CrsfLinkConfig}

RfConfig = DsmLinkConfig | CrsfLinkConfig
"""The configuration of one of them."""
