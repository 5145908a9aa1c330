"""A simulated autopilot that behaves towards a ground station as PX4 1.16 was seen to do. Sans-IO.

- OFFBOARD is accepted while disarmed whether or not set-points come; arming is denied until they have come for 1 s.
- Set-points that stop: the last one is held for 1 s (COM_OF_LOSS_T), then it lands by itself; when they come
  again, it follows them again.
- It denies to disarm until it has stood on the ground for 1-2 s; disarming by force works always.
- SET_ATTITUDE_TARGET: an attitude that is not masked out wins over the rates; a masked thrust is no thrust.
- Telemetry as on its ONBOARD link, changed by SET_MESSAGE_INTERVAL.
"""

import math
from collections.abc import Callable

from groundstation.ops import Vec3
from links.mavlink_codec import (
    ARM_DISARM,
    ARMED,
    DO_SET_MODE,
    FORCE,
    PX4,
    SET_MESSAGE_INTERVAL,
    MavlinkCodec,
    Message,
)
from sim.airframe import Airframe
from sim.autopilot_pilot import Descend, HoldAttitude, Pilot
from sim.autopilot_streams import SAME_INSTANT_S, Streams, builders

OFFBOARD, LOITER, LAND = (6, 0), (4, 3), (4, 6)
"""PX4's main and sub mode."""
STREAM_GAP_S = 0.5
"""Set-points further apart are no stream [s]: 2 Hz."""
STREAM_S = 1.0
"""A stream counts after this long [s]."""
LOSS_S = 1.0
"""COM_OF_LOSS_T: how long the last set-point is held [s]."""
LANDED_S = 1.0
"""How long it must stand on the ground to believe it [s]; it looks once a second."""
CONTROL_S = 0.01
"""Period of its own control loop [s]."""
ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED = range(5)

_CUSTOM_MODE_ENABLED = 1
_QUADROTOR = 2
_STANDBY, _ACTIVE, _CRITICAL = 3, 4, 5
_SEVERITY_CRITICAL, _SEVERITY_INFO = 2, 6
_IGNORE_THRUST, _IGNORE_ATTITUDE = 64, 128
_TEXT_BYTES = 50


class Px4Autopilot:
    """The autopilot of one ``airframe``. All times are on the event loop's clock [s] and never go backwards."""

    def __init__(
        self,
        airframe: Airframe,
        *,
        lose: Callable[[], bool] = lambda: False,
        hover: float = 0.5,
        system_id: int = 1,
    ) -> None:
        """Disarmed, in AUTO.LOITER, booting at the first poll.

        ``lose`` tells of each set-point whether it got lost on the air; ``hover`` is its MPC_THR_HOVER (0..1).
        """
        self.codec = MavlinkCodec(system_id, 1)
        self.armed = False
        self.failsafe = False
        """True while it lands because set-points stopped."""
        self._airframe = airframe
        self._lose = lose
        self._hover = hover
        self._intended = LOITER
        self._streams = Streams({}, 0.0)
        self._build = builders(self.codec, airframe)
        self._heartbeat_number: int = self.codec.dialect.MAVLINK_MSG_ID_HEARTBEAT
        self._build[self._heartbeat_number] = lambda now_s, boot_s: self._heartbeat()
        self._boot_s = -math.inf
        self._setpoint_s = -math.inf
        self._stream_since_s = math.inf
        self._ground_since_s: float | None = None
        self._pilot: Pilot | None = None
        self._pilot_due_s = math.inf
        self._said = 0

    @property
    def mode(self) -> tuple[int, int]:
        """Main and sub mode that it is in."""
        return LAND if self.failsafe else self._intended

    @property
    def next_due_s(self) -> float:
        """When ``poll`` has something to do, if nothing is received before."""
        due = min(self._streams.next_due_s, self._pilot_due_s)
        if self.armed and self.mode == OFFBOARD:
            due = min(due, self._setpoint_s + LOSS_S)
        return due if self._boot_s > -math.inf else -math.inf

    def poll(self, now_s: float) -> list[bytes]:
        """Do what is due by ``now_s``; returns frames to send."""
        if self._boot_s == -math.inf:
            self._boot(now_s)
        frames: list[bytes] = []
        by_now = now_s + SAME_INSTANT_S
        if self.armed and self.mode == OFFBOARD and by_now >= self._setpoint_s + LOSS_S:
            self.failsafe = True
            self._fly_by(Descend(self._hover, now_s), now_s)
            frames += self._say(_SEVERITY_CRITICAL, "Failsafe activated: no offboard signal, landing")
        if self._pilot is not None and by_now >= self._pilot_due_s:
            frames += self._control(self._pilot, now_s)
        for number in self._streams.take(now_s):
            frames.append(self.codec.pack(self._build[number](now_s, now_s - self._boot_s)))
            if number == self._heartbeat_number:
                self._has_landed(now_s)
        return frames

    def receive(self, datagram: bytes, now_s: float) -> list[bytes]:
        """Take one datagram; returns frames to send back."""
        frames: list[bytes] = []
        for message in self.codec.feed_datagram(datagram):
            match message.get_type():
                case "SET_ATTITUDE_TARGET":
                    if self._is_for_us(message) and not self._lose():
                        frames += self._take_setpoint(message, now_s)
                case "COMMAND_LONG":
                    if self._is_for_us(message):
                        frames += self._command(message, now_s)
                case "TIMESYNC":
                    if message.tc1 == 0:
                        frames.append(self.codec.timesync_reply(message, now_s - self._boot_s))
        return frames

    # ---- set-points

    def _take_setpoint(self, message: Message, now_s: float) -> list[bytes]:
        mask = message.type_mask
        thrust = 0.0 if mask & _IGNORE_THRUST else message.thrust
        rates: Vec3 = (
            0.0 if mask & 1 else message.body_roll_rate,
            0.0 if mask & 2 else message.body_pitch_rate,
            0.0 if mask & 4 else message.body_yaw_rate,
        )
        attitude = None if mask & _IGNORE_ATTITUDE else tuple(message.q)
        if not all(map(math.isfinite, (thrust, *rates, *(attitude or ())))):
            return []
        frames: list[bytes] = []
        if now_s - self._setpoint_s > STREAM_GAP_S:
            self._stream_since_s = now_s
        self._setpoint_s = now_s
        if self.failsafe:
            self.failsafe = False
            frames += self._say(_SEVERITY_INFO, "Offboard signal regained")
        if self.armed and self._intended == OFFBOARD:
            thrust = min(max(thrust, 0.0), 1.0)
            self._fly_by(HoldAttitude(attitude, thrust) if attitude is not None and any(attitude) else None, now_s)
            if self._pilot is None:
                self._airframe.act(now_s, thrust, rates)
            self._airframe.release(now_s)
        return frames

    def _fly_by(self, pilot: Pilot | None, now_s: float) -> None:
        self._pilot = pilot
        self._pilot_due_s = now_s if pilot is not None else math.inf

    def _streaming(self, now_s: float) -> bool:
        return now_s - self._setpoint_s <= STREAM_GAP_S and now_s - self._stream_since_s >= STREAM_S

    def _control(self, pilot: Pilot, now_s: float) -> list[bytes]:
        """One turn of its own control loop."""
        self._pilot_due_s = now_s + CONTROL_S
        self._airframe.act(now_s, *pilot.fly(self._airframe.truth(now_s)))
        if self.mode == LAND and self._has_landed(now_s):
            return self._disarm(now_s, "Disarmed by landing")
        return []

    def _has_landed(self, now_s: float) -> bool:
        """The land detector; it looks once a second, more often while landing by itself."""
        if not self._airframe.truth(now_s).on_ground:
            self._ground_since_s = None
            return False
        if self._ground_since_s is None:
            self._ground_since_s = now_s
        return now_s - self._ground_since_s >= LANDED_S

    # ---- commands

    def _is_for_us(self, message: Message) -> bool:
        return message.target_system in (0, self.codec.system_id) and message.target_component in (0, 1)

    def _command(self, message: Message, now_s: float) -> list[bytes]:
        said: list[bytes] = []
        match message.command:
            case c if c == DO_SET_MODE:
                result = self._set_mode((_whole(message.param2), _whole(message.param3)), now_s)
            case c if c == ARM_DISARM:
                result, words = self._arm(now_s) if message.param1 == 1.0 else self._try_to_disarm(message, now_s)
                said += words
            case c if c == SET_MESSAGE_INTERVAL:
                known = self._streams.set(_whole(message.param1), message.param2, now_s)
                result = ACCEPTED if known else FAILED
            case _:
                result = UNSUPPORTED
        ack = self.codec.dialect.MAVLink_command_ack_message(
            message.command, result, 0, 0, message.get_srcSystem(), message.get_srcComponent()
        )
        return [*said, self.codec.pack(ack)]

    def _set_mode(self, mode: tuple[int, int], now_s: float) -> int:
        if mode not in (OFFBOARD, LOITER, LAND) or (mode == LOITER and self.armed):
            return DENIED
        if mode == OFFBOARD and self.armed and not self._streaming(now_s):
            return TEMPORARILY_REJECTED
        self._intended = mode
        self.failsafe = False
        if mode == LAND and self.armed:
            self._fly_by(Descend(self._hover, now_s), now_s)
        return ACCEPTED

    def _arm(self, now_s: float) -> tuple[int, list[bytes]]:
        if self.armed:
            return ACCEPTED, []
        if self._intended != OFFBOARD or not self._streaming(now_s):
            denied = self._say(_SEVERITY_CRITICAL, "Arming denied: Resolve system health failures first")
            return TEMPORARILY_REJECTED, denied
        self.armed = True
        self._ground_since_s = None
        self._airframe.power(now_s, True)
        return ACCEPTED, self._say(_SEVERITY_INFO, "Armed by external command")

    def _try_to_disarm(self, message: Message, now_s: float) -> tuple[int, list[bytes]]:
        if not self.armed:
            return ACCEPTED, []
        if message.param2 != FORCE and not self._has_landed(now_s):
            return TEMPORARILY_REJECTED, self._say(_SEVERITY_CRITICAL, "Disarming denied: not landed")
        return ACCEPTED, self._disarm(now_s, "Disarmed by external command")

    def _disarm(self, now_s: float, words: str) -> list[bytes]:
        self.armed = False
        self.failsafe = False
        self._fly_by(None, now_s)
        self._airframe.power(now_s, False)
        return self._say(_SEVERITY_INFO, words)

    # ---- what it says

    def _boot(self, now_s: float) -> None:
        d = self.codec.dialect
        self._boot_s = now_s
        rates_hz = {
            self._heartbeat_number: 1.0,
            d.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 50.0,
            d.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 30.0,
            d.MAVLINK_MSG_ID_ODOMETRY: 30.0,
            d.MAVLINK_MSG_ID_TIMESYNC: 10.0,
        }
        self._streams = Streams(rates_hz, now_s)

    def _heartbeat(self) -> Message:
        main, sub = self.mode
        base = _CUSTOM_MODE_ENABLED | (ARMED if self.armed else 0)
        status = _CRITICAL if self.failsafe else _ACTIVE if self.armed else _STANDBY
        return self.codec.dialect.MAVLink_heartbeat_message(_QUADROTOR, PX4, base, main << 16 | sub << 24, status, 3)

    def _say(self, severity: int, text: str) -> list[bytes]:
        """STATUSTEXT; a text that does not fit comes in numbered pieces."""
        pieces = [text[i : i + _TEXT_BYTES] for i in range(0, len(text), _TEXT_BYTES)]
        self._said += 1
        statustext = self.codec.dialect.MAVLink_statustext_message
        return [
            self.codec.pack(statustext(severity, piece.encode("ascii"), self._said & 0xFFFF, n))
            for n, piece in enumerate(pieces)
        ]


def _whole(number: float) -> int:
    """A parameter that stands for a whole number; -1 where it does not."""
    return int(number) if math.isfinite(number) else -1
