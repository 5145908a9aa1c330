"""Dialects of simulated autopilots: how ArduCopter 4.8-dev and PX4 1.16 were seen to treat a ground
station. Sans-IO.

ArduCopter:

- GUIDED (4) or GUIDED_NOGPS (20) follow SET_ATTITUDE_TARGET; other modes ignore it. No stream is
  needed to arm.
- GUIDED needs a position: with EK3_SRC1_POSXY 0 (none) it is refused, in the words of the
  firmware's sources.
- Thrust means thrust, of a leaning vehicle too: with other GUID_OPTIONS, or with ATC_ANGLE_BOOST,
  our link does not arm it.
- A set-point without thrust, or with some but not all rates, is no set-point: it hovers where it
  is.
- Armed, its rotors stand for 2 s and more; then the first thrust above zero spools them up for
  MOT_SPOOL_TIME, if it stands on the ground, and thrust means thrust. Before that first thrust a
  set-point without any does nothing.
- Set-points that stop: the last one is held for GUID_TIMEOUT, then it levels out and keeps its
  height; the mode stays and HEARTBEAT tells nothing. The next set-point is followed again.
- Once it has flown, it refuses to disarm also on the ground; mode LAND comes down and
  disarms by itself.
- It has no ODOMETRY; nothing comes more often than 250 Hz, and it says so.

PX4:

- OFFBOARD is accepted while disarmed whether or not set-points come; arming is denied until they
  have come for 1 s.
- Set-points that stop: the last one is held for COM_OF_LOSS_T, then it lands by itself; when they
  come again, it follows them again.
- It denies to disarm until it has stood on the ground for 1-2 s; disarming by force works always.
- SET_ATTITUDE_TARGET: an attitude that is not masked out wins over the rates; a masked thrust is no
  thrust.
- SYS_STATUS tells by its health bit alone that the pre-arm checks pass; in OFFBOARD without a
  stream they don't.
- Telemetry as on its ONBOARD link, changed by MavCommand.SET_MESSAGE_INTERVAL.
"""

import math
from collections.abc import Mapping
from enum import IntEnum
from typing import ClassVar

from links.mavlink.protocol import ARDUPILOT, PX4, MavResult, MavSeverity
from sim.autopilots.autopilot import SetPoint, SimulatedAutopilot, rates_or_zero
from sim.autopilots.onboard_pilots import Climb, Descend, HoldAttitude
from sim.autopilots.parameters import ARDUPILOT_PARAMETERS, PX4_PARAMETERS


class CopterMode(IntEnum):
    """HEARTBEAT.custom_mode of Copter."""

    STABILIZE = 0
    GUIDED = 4
    LAND = 9
    GUIDED_NOGPS = 20


FOLLOWING = (CopterMode.GUIDED, CopterMode.GUIDED_NOGPS)
SHORTEST_US = 4000.0
"""Shortest interval of a message [µs]."""
ARMING_DELAY_S = 2.4
"""Time between arming and the first turn of the rotors [s]: 2 s (ARMING_DELAY_SEC of ArduCopter's
config.h), on a slow clock."""


class ArduPilotAutopilot(SimulatedAutopilot):
    """ArduCopter in STABILIZE; ``hover`` is its MOT_THST_HOVER."""

    kind: ClassVar[int] = ARDUPILOT
    table: ClassVar[Mapping[str, tuple[float, int]]] = ARDUPILOT_PARAMETERS
    hover_parameter: ClassVar[str] = "MOT_THST_HOVER"
    land_mode: ClassVar[tuple[int, int]] = (CopterMode.LAND, 0)
    rates_hz: ClassVar[Mapping[str, float]] = {
        "HEARTBEAT": 1.0,
        "EKF_STATUS_REPORT": 0.0,
        "SYS_STATUS": 2.0,
        "ATTITUDE_QUATERNION": 0.0,
        "LOCAL_POSITION_NED": 4.0,
        "TIMESYNC": 0.1,
    }

    mode: int = CopterMode.STABILIZE
    _setpoint_s = math.inf
    _levelling = False
    _has_flown = False
    _armed_s = -math.inf
    _spooled_s = math.inf
    """When its rotors follow thrust; never before the first thrust."""

    @property
    def custom_mode(self) -> int:
        """The mode's number."""
        return self.mode

    @property
    def _disarms_by_landing(self) -> bool:
        return self.mode == CopterMode.LAND

    # ---- set-points

    def _follow(self, set_point: SetPoint, now_s: float) -> list[bytes]:
        if not self.armed or self.mode not in FOLLOWING:
            return []
        self._setpoint_s = now_s
        self._levelling = False
        if not self._spools_up(set_point, now_s):
            return []
        masked = [rate is None for rate in set_point.rates]
        attitude = set_point.attitude
        if attitude is not None and not any(attitude):
            attitude = None
        if (
            set_point.thrust is None
            or (any(masked) and not all(masked))
            or (all(masked) and attitude is None)
        ):
            self._setpoint_s = math.inf  # no set-point that could stop
            self._fly_by(Climb(self._hover, 0.0, now_s), now_s)
        else:
            thrust = min(max(set_point.thrust, 0.0), 1.0)
            self._fly_by(HoldAttitude(attitude, thrust) if attitude is not None else None, now_s)
            if self._pilot is None:
                self._airframe.act(now_s, thrust, rates_or_zero(set_point))
        self._airframe.release(now_s)
        self._has_flown = self._has_flown or not self._airframe.truth(now_s).on_ground
        return []

    def _spools_up(self, set_point: SetPoint, now_s: float) -> bool:
        """Whether its rotors follow set-points by now."""
        if (
            math.isinf(self._spooled_s)
            and (set_point.thrust or 0.0) > 0.0
            and now_s >= self._armed_s + ARMING_DELAY_S
        ):
            stands = self._airframe.truth(now_s).on_ground
            self._spooled_s = now_s + (self.parameters["MOT_SPOOL_TIME"] if stands else 0.0)
        return now_s >= self._spooled_s

    @property
    def _silence_due_s(self) -> float:
        if not self.armed or self.mode not in FOLLOWING or self._levelling:
            return math.inf
        return self._setpoint_s + self.parameters["GUID_TIMEOUT"]

    def _on_silence(self, now_s: float) -> list[bytes]:
        self._levelling = True
        self._fly_by(Climb(self._hover, 0.0, now_s), now_s)
        return []

    # ---- commands

    def _set_mode(self, mode: tuple[int, int], now_s: float) -> tuple[int, list[bytes]]:
        if mode[0] not in (CopterMode.STABILIZE, CopterMode.LAND, *FOLLOWING):
            return MavResult.FAILED, self._say(
                MavSeverity.CRITICAL, "Mode change failed: no such mode"
            )
        if mode[0] == CopterMode.GUIDED and not self.parameters["EK3_SRC1_POSXY"]:
            return MavResult.FAILED, self._say(
                MavSeverity.WARNING, "Mode change to GUIDED failed: requires position"
            )
        self.mode = mode[0]
        self._setpoint_s = math.inf
        self._levelling = False
        if self.armed and self.mode == CopterMode.LAND:
            self._fly_by(Descend(self._hover, now_s, brakes=self._has_own_estimate), now_s)
        return MavResult.ACCEPTED, []

    def _answer_arming(self, now_s: float) -> tuple[int, str]:
        if self.mode == CopterMode.LAND:
            return MavResult.FAILED, "Arm: Land mode not armable"
        if self.mode == CopterMode.STABILIZE:
            return MavResult.FAILED, "Arm: RC not found"
        self._has_flown = False
        self._armed_s, self._spooled_s = now_s, math.inf
        return MavResult.ACCEPTED, ""

    def _answer_disarming(self, now_s: float) -> tuple[int, str]:
        return (MavResult.FAILED if self._has_flown else MavResult.ACCEPTED), ""

    def _set_interval(
        self, number: int, interval_us: float, now_s: float
    ) -> tuple[int, list[bytes]]:
        said: list[bytes] = []
        if 0.0 < interval_us < SHORTEST_US:
            said = self._say(
                MavSeverity.INFO,
                f"SET_MESSAGE_INTERVAL: {1e6 / interval_us:.0f} Hz is too fast, 250 Hz it is",
            )
            interval_us = SHORTEST_US
        return MavResult.ACCEPTED if self._streams.set(
            number, interval_us, now_s
        ) else MavResult.DENIED, said


class Px4Mode:
    """Main and sub modes of PX4 that the simulated one has."""

    OFFBOARD = (6, 0)
    LOITER = (4, 3)
    LAND = (4, 6)
    POSCTL = (3, 0)


STREAM_GAP_S = 0.5
"""Largest interval of set-points in a stream [s]: PX4 requires 2 Hz."""
HOVER_MEMORY_S = 1.0
"""Time constant with which the hover thrust is learnt from the commanded one in the air [s].
Chosen."""
HOVER_RANGE = 0.3
"""Largest difference of the learnt hover thrust from MPC_THR_HOVER, as a share of it [-].
Chosen."""
STREAM_S = 1.0
"""Age from which a stream allows OFFBOARD and arming [s]: PX4 requires 1 s."""


class Px4Autopilot(SimulatedAutopilot):
    """PX4 in AUTO.LOITER; ``hover`` is its MPC_THR_HOVER."""

    kind: ClassVar[int] = PX4
    table: ClassVar[Mapping[str, tuple[float, int]]] = PX4_PARAMETERS
    hover_parameter: ClassVar[str] = "MPC_THR_HOVER"
    land_mode: ClassVar[tuple[int, int]] = Px4Mode.LAND
    reports_prearm_enabled: ClassVar[bool] = False
    rates_hz: ClassVar[Mapping[str, float]] = {
        "HEARTBEAT": 1.0,
        "ESTIMATOR_STATUS": 1.0,
        "SYS_STATUS": 2.0,
        "ATTITUDE_QUATERNION": 50.0,
        "LOCAL_POSITION_NED": 30.0,
        "ODOMETRY": 30.0,
        "TIMESYNC": 10.0,
    }

    _intended = Px4Mode.LOITER
    _setpoint_s = -math.inf
    _stream_since_s = math.inf
    _learnt: float | None = None

    @property
    def _hover(self) -> float:
        """Hover thrust, learnt in the air (MPC_USE_HTE); MPC_THR_HOVER before."""
        return super()._hover if self._learnt is None else self._learnt

    @property
    def mode(self) -> tuple[int, int]:
        """Its present main and sub mode."""
        return Px4Mode.LAND if self.failsafe else self._intended

    @property
    def custom_mode(self) -> int:
        """Main mode in byte 2, sub mode in byte 3."""
        main, sub = self.mode
        return main << 16 | sub << 24

    @property
    def _disarms_by_landing(self) -> bool:
        return self.mode in (Px4Mode.LAND, Px4Mode.POSCTL)  # COM_DISARM_LAND, as does a pilot

    def reboot(self, now_s: float) -> None:
        """Boot again in AUTO.LOITER, without set-points."""
        super().reboot(now_s)
        self._intended = Px4Mode.LOITER
        self._setpoint_s, self._stream_since_s = -math.inf, math.inf

    def take_over(self, now_s: float) -> None:
        """Hand it to a pilot with a remote control, who lands it by hand."""
        self._intended = Px4Mode.POSCTL
        self._fly_by(Descend(self._hover, now_s, brakes=self._has_own_estimate), now_s)

    # ---- set-points

    def _follow(self, set_point: SetPoint, now_s: float) -> list[bytes]:
        frames: list[bytes] = []
        elapsed = now_s - self._setpoint_s
        if now_s - self._setpoint_s > STREAM_GAP_S:
            self._stream_since_s = now_s
        self._setpoint_s = now_s
        if self.failsafe:
            self.failsafe = False
            frames += self._say(MavSeverity.INFO, "Offboard signal regained")
        if self.armed and self._intended == Px4Mode.OFFBOARD:
            thrust = min(max(set_point.thrust or 0.0, 0.0), 1.0)
            attitude = set_point.attitude
            self._fly_by(
                HoldAttitude(attitude, thrust) if attitude is not None and any(attitude) else None,
                now_s,
            )
            if self._pilot is None:
                self._airframe.act(now_s, thrust, rates_or_zero(set_point))
            self._airframe.release(now_s)
            self._learn(thrust, elapsed, now_s)
        return frames

    def _learn(self, thrust: float, elapsed_s: float, now_s: float) -> None:
        if elapsed_s > STREAM_GAP_S or self._airframe.truth(now_s).on_ground:
            return
        configured = self.parameters[self.hover_parameter]
        hover = self._hover + (thrust - self._hover) * elapsed_s / (elapsed_s + HOVER_MEMORY_S)
        self._learnt = min(
            max(hover, (1.0 - HOVER_RANGE) * configured), (1.0 + HOVER_RANGE) * configured
        )

    @property
    def _silence_due_s(self) -> float:
        if not self.armed or self.failsafe or self._intended != Px4Mode.OFFBOARD:
            return math.inf
        return self._setpoint_s + self.parameters["COM_OF_LOSS_T"]

    def _on_silence(self, now_s: float) -> list[bytes]:
        self.failsafe = True
        self._fly_by(Descend(self._hover, now_s, brakes=self._has_own_estimate), now_s)
        return self._say(MavSeverity.CRITICAL, "Failsafe activated: no offboard signal, landing")

    def _streaming(self, now_s: float) -> bool:
        return now_s - self._setpoint_s <= STREAM_GAP_S and now_s - self._stream_since_s >= STREAM_S

    # ---- commands

    def _set_mode(self, mode: tuple[int, int], now_s: float) -> tuple[int, list[bytes]]:
        if mode not in (Px4Mode.OFFBOARD, Px4Mode.LOITER, Px4Mode.LAND) or (
            mode == Px4Mode.LOITER and self.armed
        ):
            return MavResult.DENIED, []
        if mode == Px4Mode.OFFBOARD and self.armed and not self._streaming(now_s):
            return MavResult.TEMPORARILY_REJECTED, []
        self._intended = mode
        self.failsafe = False
        if mode == Px4Mode.LAND and self.armed:
            self._fly_by(Descend(self._hover, now_s, brakes=self._has_own_estimate), now_s)
        return MavResult.ACCEPTED, []

    def _answer_arming(self, now_s: float) -> tuple[int, str]:
        if self._intended != Px4Mode.OFFBOARD or not self._streaming(now_s):
            return (
                MavResult.TEMPORARILY_REJECTED,
                "Arming denied: Resolve system health failures first",
            )
        return MavResult.ACCEPTED, ""

    def _passes_checks(self, now_s: float) -> bool:
        return super()._passes_checks(now_s) and (
            self._intended != Px4Mode.OFFBOARD or self._streaming(now_s)
        )

    def _answer_disarming(self, now_s: float) -> tuple[int, str]:
        return (
            (MavResult.ACCEPTED, "")
            if self._has_landed(now_s)
            else (MavResult.TEMPORARILY_REJECTED, "Disarming denied: not landed")
        )

    def _set_interval(
        self, number: int, interval_us: float, now_s: float
    ) -> tuple[int, list[bytes]]:
        return MavResult.ACCEPTED if self._streams.set(
            number, interval_us, now_s
        ) else MavResult.FAILED, []
