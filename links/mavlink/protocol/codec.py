"""MAVLink on the wire: bytes to messages, and requests to frames. Sans-IO.

pymavlink's classes hold the messages, and pymavlink decodes, packs and signs them; its checksums
are fastcrc's, which it finds by itself. Framing is ours, because pymavlink's parser lets a frame
that was cut off swallow the next one:

    byte 0      0xFD (MAVLink 2; 0xFE is MAVLink 1, which has a header of 6 bytes and no flags)
    byte 1      length n of the payload
    byte 2, 3   flags: incompatible (bit 0: 13 bytes of signature follow the frame), compatible
    byte 4      sequence number of the sender
    byte 5, 6   system and component of the sender
    byte 7..9   message number, little-endian
    10 .. 9+n   payload, its trailing zeros left out
    last 2      CRC-16/MCRF4XX over byte 1 .. 9+n and one more byte of the message's definition

Each sender's bytes are one stream: bridges from serial to UDP cut frames anywhere, so the rest of a
frame is looked for in the next datagram from the same address.

Source: mavlink.io/en/guide/serialization.html.
"""

import gc
import re
import sys
from collections import Counter
from enum import IntEnum, IntFlag
from typing import Any, TypeAlias

from pymavlink.dialects.v20 import minimal

from links.mavlink.protocol.signing import Signer

Message: TypeAlias = Any
"""A ``MAVLink_message`` of pymavlink, whose fields no type checker knows."""

PX4: int = minimal.MAV_AUTOPILOT_PX4
"""HEARTBEAT.autopilot of PX4."""
ARDUPILOT: int = minimal.MAV_AUTOPILOT_ARDUPILOTMEGA
"""HEARTBEAT.autopilot of ArduPilot."""
INVALID: int = minimal.MAV_AUTOPILOT_INVALID
"""HEARTBEAT.autopilot of what is none."""
GROUND_STATION: int = minimal.MAV_TYPE_GCS
"""HEARTBEAT.type of a ground station."""
ARMED: int = minimal.MAV_MODE_FLAG_SAFETY_ARMED
"""Bit of HEARTBEAT.base_mode that says that the motors are on."""


class MavCommand(IntEnum):
    """MAV_CMD: what COMMAND_LONG asks for; ARM_DISARM is MAV_CMD_COMPONENT_ARM_DISARM."""

    NAV_LAND = 21
    DO_SET_MODE = 176
    ARM_DISARM = 400
    SET_MESSAGE_INTERVAL = 511
    REQUEST_MESSAGE = 512


class MavFrame(IntEnum):
    """MAV_FRAME: axes of a position, a velocity or an attitude."""

    LOCAL_NED = 1
    BODY_NED = 8
    BODY_FRD = 12
    LOCAL_FRD = 20
    """NED but for its heading, which the vehicle chose at its start: it is our north."""


class MavResult(IntEnum):
    """MAV_RESULT: answer to a command."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5


class MavSeverity(IntEnum):
    """MAV_SEVERITY of a status text: lower is graver."""

    CRITICAL = 2
    WARNING = 4
    INFO = 6


class AttitudeTargetMask(IntFlag):
    """Bits of SET_ATTITUDE_TARGET.type_mask: what does not count."""

    IGNORE_ROLL_RATE = 1
    IGNORE_PITCH_RATE = 2
    IGNORE_YAW_RATE = 4
    IGNORE_THRUST = 64
    IGNORE_ATTITUDE = 128
    IGNORE_EVERYTHING = (
        IGNORE_ROLL_RATE | IGNORE_PITCH_RATE | IGNORE_YAW_RATE | IGNORE_THRUST | IGNORE_ATTITUDE
    )


class EstimatorKind(IntEnum):
    """MAV_ESTIMATOR_TYPE: origin of an estimate."""

    UNKNOWN = 0
    VISION = 2
    VIO = 3
    AUTOPILOT = 8


class EstimatorFlag(IntFlag):
    """ESTIMATOR_STATUS_FLAGS, and EKF_STATUS_FLAGS but for the last: what an estimator knows."""

    ATTITUDE = 1
    VELOCITY_HORIZONTAL = 2
    VELOCITY_VERTICAL = 4
    POSITION_RELATIVE = 8
    POSITION_ABSOLUTE = 16
    HEIGHT_ABSOLUTE = 32
    HEIGHT_ABOVE_GROUND = 64
    CONSTANT_POSITION = 128
    """Estimator without an aid: its position counts as constant."""
    PREDICTED_RELATIVE = 256
    PREDICTED_ABSOLUTE = 512
    GPS_JUMPS = 1024
    """Estimator that is not initialised yet, in ArduPilot's EKF_STATUS_REPORT."""


FORCE = 21196.0
"""Second parameter of ARM_DISARM that overrides every check: with it, disarming stops the motors in
the air."""

V1: int = minimal.PROTOCOL_MARKER_V1
V2: int = minimal.PROTOCOL_MARKER_V2
"""First bytes of a frame of MAVLink 1 and 2."""
_MAGIC = re.compile(b"[%c%c]" % (V1, V2))
_RESULTS = {
    0: "accepted",
    1: "not possible at this moment",
    2: "not allowed in its present state, or not with these values",
    3: "it does not have this command",
    4: "it tried and failed",
    5: "still under way",
    6: "cancelled",
    7: "it takes this only as COMMAND_LONG",
    8: "it takes this only as COMMAND_INT",
    9: "it does not have this frame of coordinates",
    10: "it obeys another station",
}
"""MAV_RESULT in words (common.xml)."""

_DIALECT = "pymavlink.dialects.v20.ardupilotmega"

MOST_SENDERS = 16
"""Limit of remembered addresses with their unfinished frames: the oldest is forgotten."""


def load_dialect() -> Any:
    """pymavlink's dialect ardupilotmega: all of ``common``, and ArduPilot's own messages.

    Imported where a codec is made: it takes 0.4 s, as 301 classes are made at once.
    """
    is_new = _DIALECT not in sys.modules
    from pymavlink.dialects.v20 import ardupilotmega

    if is_new:
        gc.freeze()  # no garbage collection looks through it: in flight that took 67 ms
    # pymavlink accepts bad checksums where MAV_IGNORE_CRC is set in the environment.
    ardupilotmega.MAVLINK_IGNORE_CRC = 0
    return ardupilotmega


def find_frame_end(data: bytes, start: int) -> int:
    """Return the index after the frame that begins at ``start``.

    0 where no frame can begin there; more than ``len(data)`` where its end has not arrived.
    """
    magic = data[start]
    if magic == V2:
        if start + 3 > len(data):
            return len(data) + 1
        flags = data[start + 2]
        # A later revision of the protocol has flags, and a length, that nobody here can tell.
        if flags & ~minimal.MAVLINK_IFLAG_SIGNED:
            return 0
        return start + 12 + data[start + 1] + (minimal.MAVLINK_SIGNATURE_BLOCK_LEN if flags else 0)
    if magic == V1:
        return start + 8 + data[start + 1] if start + 1 < len(data) else len(data) + 1
    return 0


class MavlinkCodec:
    """One end of a MAVLink connection.

    No bytes make it raise; what it can't use is counted in ``dropped``.
    """

    def __init__(self, system_id: int = 0, component_id: int = 0) -> None:
        """Speak as ``system_id`` / ``component_id`` (1..255); without them it only reads."""
        self.dialect: Any = load_dialect()
        """pymavlink's message classes and numbers."""
        self.system_id = system_id
        self.component_id = component_id
        self.received = 0
        """Messages understood."""
        self.dropped: Counter[str] = Counter()
        """Counts by reason: garbage (bytes that begin no frame), bad_crc, unknown (frames),
        truncated (frames whose rest did not come). With a signer also unsigned, bad_signature,
        replayed."""
        self._reader = self.dialect.MAVLink(None)  # without a key: the signer judges signatures
        self._writer = self.dialect.MAVLink(None, system_id, component_id)
        self.signer: Signer | None = None
        """Gives the stamps of what is packed and judges what is read, where there is a key."""
        self._unfinished: dict[object, bytes] = {}

    # ---- what arrives

    def feed(self, data: bytes, source: object = None, *, used: bool = True) -> list[Message]:
        """The messages that ``data`` brings to an end: the next bytes of a stream, cut anywhere.

        With a ``source``, ``data`` is a datagram of that address, whose bytes are a stream of their
        own. What was unfinished there is truncated if this datagram begins with a whole frame.
        Messages of an address that is not ``used`` are not counted, and their stamps not kept.
        """
        unfinished = self._unfinished.pop(source, b"")
        if unfinished and source is not None and self._begins_with_frame(data):
            is_whole = find_frame_end(unfinished, 0) == len(unfinished)
            self.dropped["unknown" if is_whole else "truncated"] += 1
            unfinished = b""
        messages, rest = self._read(unfinished + data, used=used)
        if rest:
            self._unfinished[source] = rest  # never more than one frame: at most 293 bytes
            if len(self._unfinished) > MOST_SENDERS:
                self._unfinished.pop(next(iter(self._unfinished)))
                self.dropped["truncated"] += 1
        return messages

    def forget(self) -> None:
        """The streams have ended: what of a frame has come of them will not be completed."""
        self._unfinished.clear()

    def _begins_with_frame(self, data: bytes) -> bool:
        """Whether a whole frame with a right checksum is at the beginning of ``data``."""
        end = find_frame_end(data, 0) if data else 0
        if not 0 < end <= len(data):
            return False
        message = self._decode_frame(data[:end])
        return message is not None and not self._is_unknown(message)

    def _read(self, data: bytes, *, used: bool) -> tuple[list[Message], bytes]:
        """The messages in ``data``, and the beginning of a frame that has not come to its end."""
        messages: list[Message] = []
        start, size = 0, len(data)
        while start < size:
            end = find_frame_end(data, start)
            if end > size:
                break
            if not end:
                begins = _MAGIC.search(data, start + 1)
                end = begins.start() if begins else size
                self.dropped["garbage"] += end - start
                start = end
                continue
            message = self._decode_frame(data[start:end])
            if message is not None and self._is_unknown(message):
                # Its checksum can't be checked: it is a frame if the next one begins behind it.
                if end == size:
                    break
                if data[end] not in (V1, V2):
                    message = None
            if message is None:  # no frame began here; a true one may begin inside
                self.dropped["bad_crc"] += 1
                start += 1
                continue
            if not self._refuse(message, data[start:end], used=used):
                messages.append(message)
            start = end
        return messages, data[start:]

    def decode(self, frame: bytes) -> tuple[Message | None, str]:
        """The message in one whole frame (see :func:`find_frame_end`), or None and the counted
        reason.
        """
        message = self._decode_frame(frame)
        if message is None:
            self.dropped["bad_crc"] += 1
            return None, "bad_crc"
        fault = self._refuse(message, frame, used=True)
        return (None, fault) if fault else (message, "")

    def _refuse(self, message: Message, frame: bytes, *, used: bool) -> str:
        """Why ``message``, whose ``frame`` is right, is not used; empty where it is; counted."""
        fault = "" if self.signer is None else self.signer.refuse(frame, keep=used)
        if fault == "unsigned" and message.get_type() == "RADIO_STATUS":
            fault = ""  # telemetry radios insert it by themselves, and know no key
        if not fault and self._is_unknown(message):
            fault = "unknown"
        if fault:
            self.dropped[fault] += 1
        else:
            self.received += used
        return fault

    def _is_unknown(self, message: Message) -> bool:
        """Whether the dialect has no such message."""
        return isinstance(message, self.dialect.MAVLink_unknown)

    def _decode_frame(self, frame: bytes) -> Message | None:
        """The message in one whole frame; None where its checksum is wrong."""
        try:
            return self._reader.decode(bytearray(frame))
        except self.dialect.MAVError:
            return None

    # ---- what leaves

    def pack(self, message: Message) -> bytes:
        """The frame of any message, with the next sequence number.

        Raises:
            struct.error: a whole number does not fit its field, or an array is too short.
            OverflowError: a number is larger than a 32-bit float can hold.
        """
        writer = self._writer
        writer.signing.sign_outgoing = self.signer is not None
        if self.signer is not None:
            writer.signing.secret_key = self.signer.key
            writer.signing.timestamp = self.signer.next_stamp()
        frame: bytes = message.pack(writer)
        writer.seq = (writer.seq + 1) % 256
        return frame

    def heartbeat(self) -> bytes:
        """HEARTBEAT of a ground station; due once a second."""
        return self.pack(
            self._writer.heartbeat_encode(GROUND_STATION, INVALID, 0, 0, minimal.MAV_STATE_ACTIVE)
        )

    def attitude_target(
        self,
        time_s: float,
        system: int,
        component: int,
        thrust: float,
        rates_rad_s: tuple[float, float, float],
    ) -> bytes:
        """SET_ATTITUDE_TARGET: ``thrust`` 0..1, body rates FRD [rad/s], attitude ignored.

        ``time_s`` [s] goes out as time_boot_ms modulo 2³².

        Raises:
            OverflowError: a number is larger than a 32-bit float can hold.
        """
        boot_ms = int(time_s * 1e3) & 0xFFFFFFFF
        level = (1.0, 0.0, 0.0, 0.0)
        target = self.dialect.MAVLink_set_attitude_target_message
        mask = AttitudeTargetMask.IGNORE_ATTITUDE
        return self.pack(target(boot_ms, system, component, mask, level, *rates_rad_s, thrust))

    def command(
        self, system: int, component: int, command: int, *params: float, confirmation: int = 0
    ) -> bytes:
        """COMMAND_LONG with up to seven parameters, the rest 0.

        ``confirmation`` counts its repetitions.
        """
        seven = (*params, *(0.0,) * (7 - len(params)))
        return self.pack(
            self.dialect.MAVLink_command_long_message(
                system, component, command, confirmation, *seven
            )
        )

    def parameter_request(self, system: int, component: int, name: str) -> bytes:
        """PARAM_REQUEST_READ of the parameter ``name`` (at most 16 letters)."""
        return self.pack(
            self.dialect.MAVLink_param_request_read_message(
                system, component, name.encode("ascii"), -1
            )
        )

    def parameter_set(
        self, system: int, component: int, name: str, number: float, kind: int
    ) -> bytes:
        """PARAM_SET of ``name`` to ``number``, in the autopilot's encoding of ``kind``."""
        return self.pack(
            self.dialect.MAVLink_param_set_message(
                system, component, name.encode("ascii"), number, kind
            )
        )

    def timesync_question(self, ours_ns: int) -> bytes:
        """TIMESYNC that asks for the other's time, with our own [ns]."""
        return self.pack(self.dialect.MAVLink_timesync_message(0, ours_ns))

    def timesync_reply(self, request: Message, time_s: float) -> bytes:
        """TIMESYNC that answers ``request`` with our clock ``time_s`` [s]."""
        # 0 would be a question again, and two clocks at 0 would never stop asking.
        ours_ns = int(time_s * 1e9) or 1
        return self.pack(self.dialect.MAVLink_timesync_message(ours_ns, request.ts1))

    def message_number(self, name: str) -> int:
        """The number of the message called ``name``, such as ODOMETRY."""
        return int(getattr(self.dialect, f"MAVLINK_MSG_ID_{name}"))

    def describe_result(self, result: int) -> str:
        """A COMMAND_ACK.result in words, with its name."""
        words = _RESULTS.get(result, "an answer that nobody here knows")
        return f"{words}, {self.value_name('MAV_RESULT', result)}"

    def value_name(self, enum: str, value: int) -> str:
        """The name of a ``value`` of ``enum``, such as MAV_TYPE_QUADROTOR.

        Where it has none, both.
        """
        entry = self.dialect.enums[enum].get(value)
        if entry is None or entry.name.endswith("_ENUM_END"):
            return f"{enum} {value}"
        return str(entry.name)
