"""State of an autopilot by its messages: mode, battery, readiness, texts, estimator. Sans-IO."""

import math
from collections import deque
from typing import Any

import msgspec

from links.core import NEWS_S
from links.mavlink.protocol.codec import (
    ARDUPILOT,
    ARMED,
    GROUND_STATION,
    INVALID,
    PX4,
    EstimatorFlag,
    MavSeverity,
    Message,
    load_dialect,
)
from links.text import printable

PX4_MODES = {
    1: "MANUAL",
    2: "ALTCTL",
    3: "POSCTL",
    4: "AUTO",
    5: "ACRO",
    6: "OFFBOARD",
    7: "STABILIZED",
    8: "RATTITUDE",
}
"""Main mode, bits 16 to 23 of HEARTBEAT.custom_mode."""
PX4_AUTO = {2: "TAKEOFF", 3: "LOITER", 4: "MISSION", 5: "RTL", 6: "LAND", 9: "PRECLAND"}
"""Sub mode of AUTO, bits 24 to 31."""
ARDUPILOT_MODES = {
    0: "STABILIZE", 1: "ACRO", 2: "ALT_HOLD", 3: "AUTO", 4: "GUIDED", 5: "LOITER", 6: "RTL",
    7: "CIRCLE", 9: "LAND",
    13: "SPORT", 15: "AUTOTUNE", 16: "POSHOLD", 17: "BRAKE", 18: "THROW", 20: "GUIDED_NOGPS",
    21: "SMART_RTL",
}  # fmt: skip
"""HEARTBEAT.custom_mode of Copter."""
ESTIMATE = {PX4: "ESTIMATOR_STATUS", ARDUPILOT: "EKF_STATUS_REPORT"}
"""Message with the status of the estimator. Its flags mean the same in both but for bit 1024: a
jump of the GPS in PX4, an estimator that has not begun in ArduPilot."""
ESTIMATE_HZ = 2.0
"""Requested rate of the estimator's status [Hz]."""
_SPEED = EstimatorFlag.VELOCITY_HORIZONTAL | EstimatorFlag.VELOCITY_VERTICAL
_PLACE = EstimatorFlag.POSITION_RELATIVE | EstimatorFlag.POSITION_ABSOLUTE
_HEIGHT = EstimatorFlag.HEIGHT_ABSOLUTE | EstimatorFlag.HEIGHT_ABOVE_GROUND
_DOUBTED = EstimatorFlag.CONSTANT_POSITION | EstimatorFlag.GPS_JUMPS
FOLLOWING = ("OFFBOARD", "GUIDED", "GUIDED_NOGPS")
"""Modes in which an autopilot follows set-points."""


class Vitals:
    """Newest mode, battery, readiness and estimator status of an autopilot.

    Times are on the event loop's clock [s].
    """

    def __init__(self) -> None:
        self.mode = ""
        """Name of its mode; empty before the first heartbeat, and of an unknown autopilot."""
        self.mode_s = -math.inf
        """Time of the newest heartbeat [s]."""
        self.battery_v: float | None = None
        self.battery_share: float | None = None
        self.ready: bool | None = None
        """Whether its pre-arm checks pass; None where it does not report it, or lacks
        set-points."""
        self._kind = -1
        self._has_position = False
        self._estimator_s = -math.inf
        """Time of the newest estimator status [s]."""

    def take_message(self, message: Message, now_s: float) -> None:
        """Take one message of the autopilot."""
        match message.get_type():
            case "HEARTBEAT":
                self._kind = message.autopilot
                self.mode, self.mode_s = mode_name(self._kind, message.custom_mode), now_s
            case "SYS_STATUS":
                volts, percent = message.voltage_battery, message.battery_remaining
                self.battery_v = None if volts in (0, 0xFFFF) else 1e-3 * volts
                self.battery_share = 0.01 * percent if 0 <= percent <= 100 else None
                self.ready = self._ready(
                    message.onboard_control_sensors_enabled, message.onboard_control_sensors_health
                )
            case "ESTIMATOR_STATUS" | "EKF_STATUS_REPORT":
                self._has_position, self._estimator_s = has_position(message.flags), now_s

    def could_land(self, now_s: float) -> bool:
        """Return whether its newest status reports a position, so that its mode LAND lands better
        than a bring-down.
        """
        return self._has_position and now_s - self._estimator_s < NEWS_S

    def _ready(self, enabled: int, health: int) -> bool | None:
        """Return whether the pre-arm checks pass, by the sensors in SYS_STATUS; None if not known.

        PX4 1.16 reports it by health alone, and in OFFBOARD it lacks the set-points that come only
        when it is armed.
        """
        prearm = load_dialect().MAV_SYS_STATUS_PREARM_CHECK
        passes = bool(health & prearm)
        if self._kind == PX4:
            return None if not passes and self.mode in (*FOLLOWING, "") else passes
        return passes if enabled & prearm else None

    def foreign(self, since_s: float) -> str:
        """Return the mode of a heartbeat since ``since_s`` [s] that follows no set-points; else
        empty.
        """
        return self.mode if self.mode_s >= since_s and self.mode not in (*FOLLOWING, "") else ""


def has_position(flags: int) -> bool:
    """Return whether the flags of ``ESTIMATE`` report speed, height and a horizontal position."""
    known = flags & _SPEED == _SPEED and bool(flags & _PLACE) and bool(flags & _HEIGHT)
    return known and not flags & _DOUBTED


def mode_name(autopilot: int, custom_mode: int) -> str:
    """Return the mode's name on ``autopilot`` (MAV_AUTOPILOT); empty where it is not known."""
    if autopilot == ARDUPILOT:
        return ARDUPILOT_MODES.get(custom_mode, f"mode {custom_mode}")
    if autopilot != PX4:
        return ""
    main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
    # Main mode 0 counts as following set-points.
    name = PX4_MODES.get(main, f"mode {main}" if main else "")
    return f"{name}.{PX4_AUTO.get(sub, sub)}" if name == "AUTO" else name


GAP = "[…]"
"""Mark in a text of the autopilot where a part of it was lost."""
REMEMBERED_TEXTS = 20
"""Number of texts that are kept, and can still be completed [-]. Chosen."""
QUOTED_TEXTS = 3
"""Largest number of texts that are quoted where it refuses something [-]. Chosen."""


class StatusText(msgspec.Struct):
    """Text of one part, or of several in their order; a missing part is marked."""

    whose: tuple[int, int, int, int]
    """System and component of its sender, STATUSTEXT.id (0 of a text of one part) and severity."""
    text: bytes = b""
    newest: tuple[int, bytes] = (-1, b"")
    """Newest part: STATUSTEXT.chunk_seq, and its bytes."""
    is_whole: bool = False

    def add(self, part: int, text: bytes, *, is_full: bool) -> None:
        """Take one part; each but the last ``is_full``."""
        self.text += text if part == self.newest[0] + 1 else GAP.encode() + text
        self.newest = part, text
        self.is_whole = not self.whose[2] or not is_full

    def show(self) -> str:
        """Return the text for screens, with marks for missing parts."""
        text = self.text.decode(errors="replace")  # a letter may be split between two parts
        return printable(text.strip() if self.is_whole else text.strip() + GAP)


class AutopilotTexts:
    """Newest texts of an autopilot (STATUSTEXT); parts are joined by sender and id."""

    def __init__(self) -> None:
        self._texts: deque[StatusText] = deque(maxlen=REMEMBERED_TEXTS)

    def take_message(self, message: Message) -> None:
        """Take one STATUSTEXT."""
        whose = message.get_srcSystem(), message.get_srcComponent(), message.id, message.severity
        part = message.chunk_seq if message.id else 0
        # pymavlink decodes ASCII alone.
        raw = bytes(getattr(message, "_text_raw", b"")) or message.text.encode()
        words = raw.partition(b"\0")[0]
        for text in reversed(self._texts) if message.id else ():
            if text.whose == whose and text.newest == (part, words):
                return  # a network may deliver a datagram twice
            if text.whose == whose and text.newest[0] < part:
                break
        else:  # a restarted autopilot counts its texts anew
            text = StatusText(whose)
            self._texts.append(text)
        text.add(part, words, is_full=len(words) == max(message.array_lengths))

    @property
    def newest(self) -> str:
        """The newest text, or an empty string."""
        return self._texts[-1].show() if self._texts else ""

    def complaints(self) -> str:
        """Return the last warnings and errors, newest last, each once; empty without any."""
        texts = [text.show() for text in self._texts if text.whose[3] <= MavSeverity.WARNING]
        newest = list(dict.fromkeys(reversed(texts)))[:QUOTED_TEXTS]
        return "; ".join(f"“{text}”" for text in reversed(newest))


STALE_HEARTBEAT_S = 0.5
"""A disarmed HEARTBEAT within this time after arming is ignored [s]: it may have left before."""


def is_autopilot(heartbeat: Message) -> bool:
    """Return whether a heartbeat is an autopilot's: no ground station, companion or camera."""
    return bool(heartbeat.type != GROUND_STATION and heartbeat.autopilot != INVALID)


class HeartbeatMonitor:
    """Monitor of one autopilot's heartbeats. Times are on the event loop's clock [s]."""

    def __init__(self, timeout_s: float) -> None:
        """Start without a heartbeat; ``timeout_s`` [s] without one is silence."""
        self.kind: int | None = None
        """HEARTBEAT.autopilot of the first heartbeat after a silence; None before any."""
        self.vehicle = 0
        """HEARTBEAT.type of that heartbeat."""
        self.address: Any = None
        """Address that it sends from; None where it is not known, or the wire has only one end."""
        self._timeout = timeout_s
        self._heard_s = -math.inf
        self._armed_s: float | None = None

    @property
    def armed(self) -> bool:
        """Whether its motors count as on."""
        return self._armed_s is not None

    def believe_armed(self, since_s: float | None) -> None:
        """Take the motors for on since ``since_s`` [s], or for off (None), until a heartbeat says
        so.
        """
        self._armed_s = since_s

    def silence_s(self, now_s: float) -> float:
        """Return the time since its newest heartbeat [s]; infinite before the first, and after its
        wire was lost.
        """
        return now_s - self._heard_s

    def is_silent(self, now_s: float) -> bool:
        """Return whether its heartbeats have been missing for longer than the timeout."""
        return self.silence_s(now_s) > self._timeout

    def lose(self) -> None:
        """Forget it, as its wire was lost: the next heartbeat may be another autopilot's."""
        self.address = None
        self._armed_s = None
        self._heard_s = -math.inf

    def beat(self, heartbeat: Message, now_s: float) -> bool:
        """Take a heartbeat; return whether it is the first, or the first after a silence."""
        news = self.kind is None or self.is_silent(now_s)
        self._heard_s = now_s
        if news:
            self.kind, self.vehicle = heartbeat.autopilot, heartbeat.type
        return news

    def take_armed(self, heartbeat: Message, now_s: float) -> None:
        """Take from a heartbeat whether its motors are on."""
        if heartbeat.base_mode & ARMED:
            if self._armed_s is None:
                self._armed_s = now_s
        elif self._armed_s is not None and now_s - self._armed_s > STALE_HEARTBEAT_S:
            self._armed_s = None
