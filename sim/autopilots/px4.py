"""A simulated autopilot that behaves towards a ground station as PX4 1.16 was seen to do. Sans-IO.

- OFFBOARD is accepted while disarmed whether or not set-points come; arming is denied until they have come for 1 s.
- Set-points that stop: the last one is held for COM_OF_LOSS_T, then it lands by itself; when they come
  again, it follows them again.
- It denies to disarm until it has stood on the ground for 1-2 s; disarming by force works always.
- SET_ATTITUDE_TARGET: an attitude that is not masked out wins over the rates; a masked thrust is no thrust.
- SYS_STATUS tells by its health bit alone that the pre-arm checks pass; in OFFBOARD without a stream they don't.
- Telemetry as on its ONBOARD link, changed by SET_MESSAGE_INTERVAL.
"""

import math
from collections.abc import Mapping
from typing import ClassVar

from links.mavlink.protocol import PX4
from sim.autopilots.base import Descend, HoldAttitude, SimulatedAutopilot
from sim.autopilots.dialect import (
    ACCEPTED,
    CRITICAL,
    DENIED,
    FAILED,
    INFO,
    PX4_PARAMETERS,
    TEMPORARILY_REJECTED,
    SetPoint,
    rates_or_zero,
)

OFFBOARD, LOITER, LAND, POSCTL = (6, 0), (4, 3), (4, 6), (3, 0)
"""PX4's main and sub mode."""
STREAM_GAP_S = 0.5
"""Set-points further apart are no stream [s]: 2 Hz."""
HOVER_MEMORY_S, HOVER_RANGE = 1.0, 0.3
"""Over which it learns its hover thrust from what it is told to push in the air [s], and how far from MPC_THR_HOVER."""
STREAM_S = 1.0
"""A stream counts after this long [s]."""


class Px4Autopilot(SimulatedAutopilot):
    """PX4 in AUTO.LOITER; ``hover`` is its MPC_THR_HOVER."""

    kind: ClassVar[int] = PX4
    table: ClassVar[Mapping[str, tuple[float, int]]] = PX4_PARAMETERS
    hover_parameter: ClassVar[str] = "MPC_THR_HOVER"
    land_mode: ClassVar[tuple[int, int]] = LAND
    tells_prearm_enabled: ClassVar[bool] = False
    rates_hz: ClassVar[Mapping[str, float]] = {
        "HEARTBEAT": 1.0,
        "ESTIMATOR_STATUS": 1.0,
        "SYS_STATUS": 2.0,
        "ATTITUDE_QUATERNION": 50.0,
        "LOCAL_POSITION_NED": 30.0,
        "ODOMETRY": 30.0,
        "TIMESYNC": 10.0,
    }

    _intended = LOITER
    _setpoint_s = -math.inf
    _stream_since_s = math.inf
    _learnt: float | None = None

    @property
    def _hover(self) -> float:
        """As MPC_USE_HTE has it: learnt in the air, and MPC_THR_HOVER before."""
        return super()._hover if self._learnt is None else self._learnt

    @property
    def mode(self) -> tuple[int, int]:
        """Main and sub mode that it is in."""
        return LAND if self.failsafe else self._intended

    @property
    def custom_mode(self) -> int:
        """Main mode in byte 2, sub mode in byte 3."""
        main, sub = self.mode
        return main << 16 | sub << 24

    @property
    def _disarms_by_landing(self) -> bool:
        return self.mode in (LAND, POSCTL)  # COM_DISARM_LAND, as does a pilot

    def reboot(self, now_s: float) -> None:
        """Begin anew."""
        super().reboot(now_s)
        self._intended = LOITER
        self._setpoint_s, self._stream_since_s = -math.inf, math.inf

    def take_over(self, now_s: float) -> None:
        """A pilot takes it by the remote control, and lands it by hand."""
        self._intended = POSCTL
        self._fly_by(Descend(self._hover, now_s, brakes=self._knows), now_s)

    # ---- set-points

    def _obey(self, set_point: SetPoint, now_s: float) -> list[bytes]:
        frames: list[bytes] = []
        elapsed = now_s - self._setpoint_s
        if now_s - self._setpoint_s > STREAM_GAP_S:
            self._stream_since_s = now_s
        self._setpoint_s = now_s
        if self.failsafe:
            self.failsafe = False
            frames += self._say(INFO, "Offboard signal regained")
        if self.armed and self._intended == OFFBOARD:
            thrust = min(max(set_point.thrust or 0.0, 0.0), 1.0)
            attitude = set_point.attitude
            self._fly_by(HoldAttitude(attitude, thrust) if attitude is not None and any(attitude) else None, now_s)
            if self._pilot is None:
                self._airframe.act(now_s, thrust, rates_or_zero(set_point))
            self._airframe.release(now_s)
            self._learn(thrust, elapsed, now_s)
        return frames

    def _learn(self, thrust: float, elapsed_s: float, now_s: float) -> None:
        if elapsed_s > STREAM_GAP_S or self._airframe.truth(now_s).on_ground:
            return
        told = self.parameters[self.hover_parameter]
        hover = self._hover + (thrust - self._hover) * elapsed_s / (elapsed_s + HOVER_MEMORY_S)
        self._learnt = min(max(hover, (1.0 - HOVER_RANGE) * told), (1.0 + HOVER_RANGE) * told)

    @property
    def _silence_due_s(self) -> float:
        if not self.armed or self.failsafe or self._intended != OFFBOARD:
            return math.inf
        return self._setpoint_s + self.parameters["COM_OF_LOSS_T"]

    def _fall_silent(self, now_s: float) -> list[bytes]:
        self.failsafe = True
        self._fly_by(Descend(self._hover, now_s, brakes=self._knows), now_s)
        return self._say(CRITICAL, "Failsafe activated: no offboard signal, landing")

    def _streaming(self, now_s: float) -> bool:
        return now_s - self._setpoint_s <= STREAM_GAP_S and now_s - self._stream_since_s >= STREAM_S

    # ---- commands

    def _set_mode(self, mode: tuple[int, int], now_s: float) -> tuple[int, list[bytes]]:
        if mode not in (OFFBOARD, LOITER, LAND) or (mode == LOITER and self.armed):
            return DENIED, []
        if mode == OFFBOARD and self.armed and not self._streaming(now_s):
            return TEMPORARILY_REJECTED, []
        self._intended = mode
        self.failsafe = False
        if mode == LAND and self.armed:
            self._fly_by(Descend(self._hover, now_s, brakes=self._knows), now_s)
        return ACCEPTED, []

    def _refuses_to_arm(self, now_s: float) -> tuple[int, str]:
        if self._intended != OFFBOARD or not self._streaming(now_s):
            return TEMPORARILY_REJECTED, "Arming denied: Resolve system health failures first"
        return ACCEPTED, ""

    def _passes_checks(self, now_s: float) -> bool:
        return super()._passes_checks(now_s) and (self._intended != OFFBOARD or self._streaming(now_s))

    def _refuses_to_disarm(self, now_s: float) -> tuple[int, str]:
        return (ACCEPTED, "") if self._has_landed(now_s) else (TEMPORARILY_REJECTED, "Disarming denied: not landed")

    def _set_interval(self, number: int, interval_us: float, now_s: float) -> tuple[int, list[bytes]]:
        return ACCEPTED if self._streams.set(number, interval_us, now_s) else FAILED, []
