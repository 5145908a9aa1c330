"""MAVLink on the wire: bytes to messages, commands to frames. Sans-IO.

    byte 0      0xFD (MAVLink 2; 0xFE is MAVLink 1, which has a header of 6 bytes and no flags)
    byte 1      length n of the payload
    byte 2, 3   flags: incompatible (bit 0: 13 bytes of signature follow the frame), compatible
    byte 4      sequence number of the sender
    byte 5, 6   system and component of the sender
    byte 7..9   message number, little-endian
    10 .. 9+n   payload, its trailing zeros left out
    last 2      CRC-16/MCRF4XX over byte 1 .. 9+n and one more byte that the message's definition gives

Messages are those of the dialect ardupilotmega (links/mavlink/protocol/dialect.py): with ``common`` some of ArduPilot's
have no name.
Source: mavlink.io/en/guide/serialization.html; message definitions of pymavlink 2.4.50.
"""

import struct
from collections import Counter
from typing import Any, TypeAlias

from fastcrc.crc16 import mcrf4xx

from links.mavlink.protocol.dialect import DIALECT, MavlinkMessage
from links.mavlink.protocol.signing import SIGNATURE_BYTES, SIGNED, Signer

Message: TypeAlias = Any
"""A :class:`links.mavlink.protocol.dialect.MavlinkMessage`, whose fields no type checker knows."""

PX4 = 12
"""HEARTBEAT.autopilot of PX4 (MAV_AUTOPILOT_PX4)."""
ARDUPILOT = 3
"""HEARTBEAT.autopilot of ArduPilot (MAV_AUTOPILOT_ARDUPILOTMEGA)."""
INVALID = 8
"""HEARTBEAT.autopilot of what is none (MAV_AUTOPILOT_INVALID)."""
GROUND_STATION = 6
"""HEARTBEAT.type of a ground station (MAV_TYPE_GCS)."""
ARMED = 128
"""Bit of HEARTBEAT.base_mode that says that the motors are on (MAV_MODE_FLAG_SAFETY_ARMED)."""

NAV_LAND = 21
DO_SET_MODE = 176
ARM_DISARM = 400
SET_MESSAGE_INTERVAL = 511
REQUEST_MESSAGE = 512
FORCE = 21196.0
"""Second parameter of ARM_DISARM that overrides every check: with it, disarming stops the motors in the air."""

_V2, _V1 = 0xFD, 0xFE
_ACTIVE = 4
_RESULTS = {
    0: "ACCEPTED", 1: "TEMPORARILY_REJECTED", 2: "DENIED", 3: "UNSUPPORTED", 4: "FAILED", 5: "IN_PROGRESS",
    7: "COMMAND_LONG_ONLY", 8: "COMMAND_INT_ONLY",
}  # fmt: skip
_HEADER = struct.Struct("<BBBBBBBHB")
_ATTITUDE_TARGET = struct.Struct("<BBBBBBBHB I4f3ffBBB")
_ATTITUDE_TARGET_ID, _ATTITUDE_TARGET_CRC_EXTRA = 82, 49
_WHOLE = ("unknown", "unsigned", "bad_signature", "replayed")
_IGNORE_ATTITUDE = 128


def frame_end(data: bytes, start: int) -> int:
    """Where the frame that begins at ``start`` ends.

    0 where no frame can begin there; more than ``len(data)`` where its end has not arrived.
    """
    magic = data[start]
    if magic == _V2:
        if start + 3 > len(data):
            return len(data) + 1
        flags = data[start + 2]
        if flags & ~SIGNED:  # a later revision of the protocol, whose length nobody here can tell
            return 0
        return start + 12 + data[start + 1] + (SIGNATURE_BYTES if flags else 0)
    if magic == _V1:
        return start + 8 + data[start + 1] if start + 1 < len(data) else len(data) + 1
    return 0


class MavlinkCodec:
    """One end of a MAVLink connection. No bytes make it raise; what it can't use is counted in ``dropped``."""

    def __init__(self, system_id: int, component_id: int) -> None:
        """Speak as ``system_id`` / ``component_id`` (1..255)."""
        self.dialect: Any = DIALECT
        """The message classes, by pymavlink's names."""
        self.system_id = system_id
        self.component_id = component_id
        self.received = 0
        """Messages understood."""
        self.dropped: Counter[str] = Counter()
        """By reason: garbage (bytes that begin no frame), truncated, bad_crc, malformed, unknown (frames).

        With a signer also unsigned, bad_signature, replayed."""
        self.signer: Signer | None = None
        """Signs what is packed and judges what is read, where there is a key."""
        self._sequence = 0
        self._pending = b""

    def feed(self, data: bytes) -> list[Message]:
        """The messages that ``data``, the next bytes of a stream cut anywhere, brings to an end."""
        data = self._pending + data
        messages, used = self._scan(data, resynchronise=True)
        self._pending = data[used:]  # never more than one frame: at most 280 bytes
        return messages

    def forget(self) -> None:
        """The stream has ended: what of a frame has come of it will not be completed."""
        self._pending = b""

    def feed_datagram(self, data: bytes) -> list[Message]:
        """The messages in one datagram, which holds whole frames; what follows garbage in it is dropped."""
        messages, used = self._scan(data, resynchronise=False)
        if used < len(data):
            if frame_end(data, used):
                self.dropped["truncated"] += 1
            else:
                self.dropped["garbage"] += len(data) - used
        return messages

    def _scan(self, data: bytes, resynchronise: bool) -> tuple[list[Message], int]:
        """The messages in ``data`` and the number of bytes done with."""
        messages: list[Message] = []
        start, size = 0, len(data)
        while start < size:
            end = frame_end(data, start)
            if end > size:
                break
            if end:
                message, fault = self.decode(data[start:end])
                if message is not None:
                    messages.append(message)
                # In a stream, a checksum that fails means that no frame began here; a true one may begin inside.
                if not (resynchronise and fault) or fault in _WHOLE:
                    start = end
                    continue
            elif not resynchronise:
                break
            else:
                self.dropped["garbage"] += 1
            start += 1
        return messages, start

    def decode(self, frame: bytes) -> tuple[Message | None, str]:
        """The message in one whole frame, or None and the reason, which is counted."""
        message, fault = _read(frame)
        if not fault and self.signer is not None:
            fault = self.signer.refuse(frame)
        if not fault and message is None:
            fault = "unknown"
        if fault:
            self.dropped[fault] += 1
            return None, fault
        self.received += 1
        return message, ""

    def _next(self) -> int:
        """The sequence number of the next frame."""
        sequence = self._sequence
        self._sequence = (sequence + 1) & 0xFF
        return sequence

    def pack(self, message: Message) -> bytes:
        """The frame of any message, with the next sequence number.

        Raises:
            struct.error: a whole number does not fit its field, or an array is too short.
            OverflowError: a number is larger than a 32-bit float can hold.
        """
        payload, number, extra = message.pack_payload(), message.msg_number, message.crc_extra
        header = _HEADER.pack(
            _V2, len(payload), 0, 0, self._next(), self.system_id, self.component_id, number & 0xFFFF, number >> 16
        )
        body = header + payload
        frame = body + mcrf4xx(body[1:] + bytes([extra])).to_bytes(2, "little")
        return frame if self.signer is None else self.signer.sign(frame, extra)

    def heartbeat(self) -> bytes:
        """HEARTBEAT of a ground station; due once a second."""
        d = self.dialect
        return self.pack(d.MAVLink_heartbeat_message(GROUND_STATION, INVALID, 0, 0, _ACTIVE, 3))

    def attitude_target(
        self, time_s: float, system: int, component: int, thrust: float, rates_rad_s: tuple[float, float, float]
    ) -> bytes:
        """SET_ATTITUDE_TARGET to ``system`` / ``component``: ``thrust`` 0..1, body rates FRD [rad/s], attitude ignored.

        ``time_s`` [s] goes out as time_boot_ms modulo 2³². Packed by hand, as it leaves with every command:
        the same bytes in less time.

        Raises:
            OverflowError: a number is larger than a 32-bit float can hold.
        """
        body = _ATTITUDE_TARGET.pack(
            _V2, 39, 0, 0, self._next(), self.system_id, self.component_id, _ATTITUDE_TARGET_ID, 0,
            int(time_s * 1e3) & 0xFFFFFFFF, 1.0, 0.0, 0.0, 0.0, *rates_rad_s, thrust,
            system, component, _IGNORE_ATTITUDE,
        )  # fmt: skip
        frame = body + mcrf4xx(body[1:] + bytes([_ATTITUDE_TARGET_CRC_EXTRA])).to_bytes(2, "little")
        return frame if self.signer is None else self.signer.sign(frame, _ATTITUDE_TARGET_CRC_EXTRA)

    def command(self, system: int, component: int, command: int, *params: float, confirmation: int = 0) -> bytes:
        """COMMAND_LONG with up to seven parameters, the rest 0; ``confirmation`` counts its repetitions."""
        seven = (*params, *(0.0,) * (7 - len(params)))
        return self.pack(self.dialect.MAVLink_command_long_message(system, component, command, confirmation, *seven))

    def parameter_request(self, system: int, component: int, name: str) -> bytes:
        """PARAM_REQUEST_READ of the parameter ``name`` (at most 16 letters)."""
        return self.pack(self.dialect.MAVLink_param_request_read_message(system, component, name.encode("ascii"), -1))

    def parameter_set(self, system: int, component: int, name: str, number: float, kind: int) -> bytes:
        """PARAM_SET of ``name`` to ``number``, already in the autopilot's encoding of ``kind`` (MAV_PARAM_TYPE)."""
        return self.pack(self.dialect.MAVLink_param_set_message(system, component, name.encode("ascii"), number, kind))

    def timesync_question(self, ours_ns: int) -> bytes:
        """TIMESYNC that asks for the other's time, with our own [ns]."""
        return self.pack(self.dialect.MAVLink_timesync_message(0, ours_ns))

    def timesync_reply(self, request: Message, time_s: float) -> bytes:
        """TIMESYNC that answers ``request`` with our clock ``time_s`` [s]."""
        ours_ns = int(time_s * 1e9) or 1  # 0 would be a question again, and two clocks at 0 would never stop asking
        return self.pack(self.dialect.MAVLink_timesync_message(ours_ns, request.ts1))

    def message_number(self, name: str) -> int:
        """The number of the message called ``name``, such as ODOMETRY."""
        return int(self.dialect.number(name))

    def result_name(self, result: int) -> str:
        """The name of a COMMAND_ACK.result, such as MAV_RESULT_DENIED."""
        name = _RESULTS.get(result)
        return f"MAV_RESULT_{name}" if name is not None else f"MAV_RESULT {result}"


def _read(frame: bytes) -> tuple[MavlinkMessage | None, str]:
    """The message in one whole frame, None where the dialect has no such one; and what is wrong with the frame."""
    if frame[0] == _V2:
        head, tail = 10, 2 + SIGNATURE_BYTES if frame[2] & SIGNED else 2
        number = frame[7] | frame[8] << 8 | frame[9] << 16 if len(frame) >= head + tail else -1
    else:
        head, tail = 6, 2
        number = frame[5] if len(frame) >= head + tail else -1
    if number < 0 or frame[0] not in (_V1, _V2) or frame[1] != len(frame) - head - tail:
        return None, "malformed"
    kind = DIALECT.kind(number)
    if kind is None:
        return None, ""
    end = len(frame) - tail
    if mcrf4xx(frame[1:end] + kind.crc_byte) != frame[end] | frame[end + 1] << 8:
        return None, "bad_crc"
    wire = kind.wire
    payload, size = frame[head:end], wire.size
    if len(payload) != size:
        payload = payload[:size].ljust(size, b"\0")  # zeros at the end are left out; what was added later is not read
    return kind(*kind.from_wire(wire.unpack(payload)), frame), ""
