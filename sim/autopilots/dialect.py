"""What the dialect of a simulated autopilot has to say, beside what all of them do. Sans-IO."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

from groundstation.core.geometry import Quat, Vec3
from links.mavlink.protocol import Message

ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED = range(5)
"""MAV_RESULT."""
CRITICAL, WARNING, INFO = 2, 4, 6
"""MAV_SEVERITY."""

_IGNORE_THRUST, _IGNORE_ATTITUDE = 64, 128


class SetPoint:
    """One SET_ATTITUDE_TARGET; what its mask takes out is None."""

    def __init__(self, message: Message) -> None:
        """Of a ``message``."""
        mask = message.type_mask
        self.thrust: float | None = None if mask & _IGNORE_THRUST else message.thrust
        rates = (message.body_roll_rate, message.body_pitch_rate, message.body_yaw_rate)
        self.rates: tuple[float | None, ...] = tuple(None if mask & 1 << n else r for n, r in enumerate(rates))
        self.attitude: Quat | None = None if mask & _IGNORE_ATTITUDE else tuple(message.q)

    @property
    def is_finite(self) -> bool:
        """No number in it is infinite or none at all."""
        return all(math.isfinite(x) for x in (self.thrust, *self.rates, *(self.attitude or ())) if x is not None)


def rates_or_zero(set_point: SetPoint) -> Vec3:
    """The body rates of ``set_point`` [rad/s], those that are masked out being zero."""
    p, q, r = (rate or 0.0 for rate in set_point.rates)
    return p, q, r


class Dialect(ABC):
    """PX4's or ArduPilot's. All times are on the event loop's clock [s]."""

    kind: ClassVar[int]
    """Its HEARTBEAT.autopilot."""
    table: ClassVar[Mapping[str, tuple[float, int]]]
    """Its parameters: name → value, MAV_PARAM_TYPE."""
    hover_parameter: ClassVar[str]
    """Its parameter for the thrust that it believes to hover with."""
    land_mode: ClassVar[tuple[int, int]]
    """Main and sub mode that comes down by itself."""
    rates_hz: ClassVar[Mapping[str, float]]
    """What it sends by default [Hz]; 0: what it could send."""
    tells_prearm_enabled: ClassVar[bool] = True
    """Whether SYS_STATUS says that there are pre-arm checks, beside whether they pass."""

    lacks: str
    """What its own pre-arm checks find missing, in its words: it tells that they fail, and does not arm."""

    @property
    @abstractmethod
    def custom_mode(self) -> int:
        """HEARTBEAT.custom_mode of the mode that it is in."""

    @property
    @abstractmethod
    def _silence_due_s(self) -> float:
        """When it acts if no further set-point comes; infinite where it does not wait for any."""

    @abstractmethod
    def _fall_silent(self, now_s: float) -> list[bytes]:
        """Act because set-points stopped; returns frames to send."""

    @abstractmethod
    def _obey(self, set_point: SetPoint, now_s: float) -> list[bytes]:
        """Take a finite set-point; returns frames to send."""

    @abstractmethod
    def _set_mode(self, mode: tuple[int, int], now_s: float) -> tuple[int, list[bytes]]:
        """Answer the main and sub mode of a DO_SET_MODE, and frames to send first."""

    @abstractmethod
    def _refuses_to_arm(self, now_s: float) -> tuple[int, str]:
        """The result and the words that deny arming; ACCEPTED where nothing does."""

    def _passes_checks(self, now_s: float) -> bool:
        """Whether its own pre-arm checks pass in the mode that it is in."""
        return not self.lacks

    @abstractmethod
    def _refuses_to_disarm(self, now_s: float) -> tuple[int, str]:
        """The result and the words that deny disarming; ACCEPTED where nothing does."""

    @abstractmethod
    def _set_interval(self, number: int, interval_us: float, now_s: float) -> tuple[int, list[bytes]]:
        """Answer a SET_MESSAGE_INTERVAL."""

    @property
    @abstractmethod
    def _disarms_by_landing(self) -> bool:
        """Whether it is in a mode that ends with the motors off on the ground."""
