"""Thrust and body rates to the positions of a transmitter's channels, and back. Pure.

A position is -1..1, what transmitters call -100 % to +100 %; a codec makes counts of it. Channels
count from 1.
"""

import math
from collections.abc import Sequence
from typing import Annotated, NamedTuple

import msgspec

from links.core import signal, thrust
from links.text import link_notice

Channel = Annotated[int, msgspec.Meta(ge=1, le=16)]
Position = Annotated[float, msgspec.Meta(ge=-1.0, le=1.0)]
Rates = tuple[float, float, float]


class Throttle(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The channel of the thrust."""

    channel: Annotated[Channel, msgspec.Meta(description="Its number.")]
    low: Annotated[
        Position,
        msgspec.Meta(description="Position for no thrust; also what leaves while disarmed."),
    ] = -1.0
    high: Annotated[
        Position,
        msgspec.Meta(
            description="Position for the vehicle's full thrust; below `low` where the receiver "
            "wants the channel reversed."
        ),
    ] = 1.0
    curve: Annotated[
        Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] | None,
        msgspec.Meta(
            description="f of thrust = f u² + (1 - f) u, from the position's share u of the throw "
            "to the motors' thrust, in place of vehicle.thrust_curve; 0 where the "
            "flight controller straightens the curve."
        ),
    ] = None

    def __post_init__(self) -> None:
        if self.low == self.high:
            raise ValueError(link_notice("rf.no_travel"))


class Stick(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The channel of one body rate."""

    channel: Annotated[Channel, msgspec.Meta(description="Its number.")]
    full_rate_deg_s: Annotated[
        float,
        msgspec.Meta(
            ge=15.0,
            le=20000.0,
            description="Body rate at full stick, as it is set on board [deg/s]; no faster one can "
            "be sent.",
        ),
    ] = 200.0
    reverse: Annotated[
        bool,
        msgspec.Meta(
            description="Whether a positive rate (right roll, nose up, clockwise from above) takes "
            "a lower position."
        ),
    ] = False
    trim: Annotated[
        Position, msgspec.Meta(description="Position at which the vehicle does not turn.")
    ] = 0.0
    failsafe: Annotated[
        Position | None, msgspec.Meta(description="Position while disarmed; without it: `trim`.")
    ] = None


class ArmSwitch(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The channel that arms the flight controller."""

    channel: Annotated[Channel, msgspec.Meta(description="Its number.")]
    armed: Annotated[Position, msgspec.Meta(description="Position that arms.")] = 1.0
    disarmed: Annotated[Position, msgspec.Meta(description="Position that disarms.")] = -1.0

    def __post_init__(self) -> None:
        if self.armed == self.disarmed:
            raise ValueError(link_notice("rf.never_disarms"))


class Fixed(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A channel that always stays where it is, such as a flight mode."""

    channel: Annotated[Channel, msgspec.Meta(description="Its number.")]
    position: Annotated[Position, msgspec.Meta(description="Where it stays.")]


class Copy(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A channel that follows the throttle between two limits, as on the MLP4DSM transmitter."""

    channel: Annotated[Channel, msgspec.Meta(description="Its number.")]
    low: Annotated[Position, msgspec.Meta(description="Its lowest position.")] = -1.0
    high: Annotated[Position, msgspec.Meta(description="Its highest position.")] = 1.0


class ChannelMap(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Meaning of each channel; default is Spektrum's order: throttle, aileron, elevator, rudder."""

    thrust: Throttle = Throttle(channel=1)
    roll: Stick = Stick(channel=2)
    pitch: Stick = Stick(channel=3)
    yaw: Stick = Stick(channel=4, full_rate_deg_s=300.0)
    arm: Annotated[
        ArmSwitch | None,
        msgspec.Meta(
            description="The channel that arms; without it, whatever the vehicle itself does."
        ),
    ] = None
    throttle_copy: Annotated[
        Copy | None, msgspec.Meta(description="A channel that follows the throttle.")
    ] = None
    fixed: Annotated[
        tuple[Fixed, ...],
        msgspec.Meta(
            description="Channels that stay where they are; every channel that nobody names stays "
            "at 0."
        ),
    ] = ()

    def __post_init__(self) -> None:
        numbers = self.channels
        twice = sorted({number for number in numbers if numbers.count(number) > 1})
        if twice:
            raise ValueError(link_notice("rf.channel_twice", channel=twice[0]))

    @property
    def channels(self) -> list[int]:
        """Numbers of all channels that are named."""
        named = (
            self.thrust,
            self.roll,
            self.pitch,
            self.yaw,
            self.arm,
            self.throttle_copy,
            *self.fixed,
        )
        return [part.channel for part in named if part is not None]


class Sticks(NamedTuple):
    """Thrust and rates that stick positions command."""

    thrust_n: float
    """[N]"""
    rates_rad_s: Rates
    """Body rates [rad/s], FRD."""
    armed: bool
    """Whether the arm channel arms; True without one."""


class Channels:
    """Conversion between commands and positions by the map of one vehicle."""

    def __init__(self, channel_map: ChannelMap, *, count: int, thrust_max_n: float) -> None:
        """``count`` channels in all; ``thrust_max_n`` is the thrust at full throttle [N]."""
        self._map = channel_map
        self._thrust_max = thrust_max_n
        rest = [0.0] * count
        for part in channel_map.fixed:
            rest[part.channel - 1] = part.position
        self._sticks = (channel_map.roll, channel_map.pitch, channel_map.yaw)
        # Position = trim + gain * rate.
        self._gains = [
            (-1.0 if s.reverse else 1.0) / math.radians(s.full_rate_deg_s) for s in self._sticks
        ]
        self._rest = rest
        self._idle = {armed: self._make_idle(armed) for armed in (False, True)}

    def flying(self, thrust_n: float, rates_rad_s: Rates) -> list[float]:
        """Return the positions for a thrust [N] and body rates [rad/s, FRD], armed, and clamped to
        the channels' range.
        """
        m, out = self._map, self._rest.copy()
        throttle = m.thrust
        share = signal(thrust_n / self._thrust_max, throttle.curve or 0.0)
        self._set_throttle(out, throttle.low + (throttle.high - throttle.low) * share)
        for stick, gain, rate in zip(self._sticks, self._gains, rates_rad_s, strict=True):
            out[stick.channel - 1] = min(max(stick.trim + gain * rate, -1.0), 1.0)
        if m.arm is not None:
            out[m.arm.channel - 1] = m.arm.armed
        return out

    def idle(self, *, armed: bool) -> list[float]:
        """Return positions without thrust: the failsafe values, or if ``armed`` no rates and the
        arm channel's armed position.
        """
        return self._idle[armed]

    def read(self, positions: Sequence[float]) -> Sticks:
        """Return the thrust and rates of ``positions``; the inverse of :meth:`flying`."""
        m = self._map
        throttle = m.thrust
        share = (positions[throttle.channel - 1] - throttle.low) / (throttle.high - throttle.low)
        roll, pitch, yaw = (
            (positions[stick.channel - 1] - stick.trim) / gain
            for stick, gain in zip(self._sticks, self._gains, strict=True)
        )
        armed = True
        if m.arm is not None:
            at = positions[m.arm.channel - 1]
            armed = abs(at - m.arm.armed) < abs(at - m.arm.disarmed)
        thrust_n = self._thrust_max * thrust(min(max(share, 0.0), 1.0), throttle.curve or 0.0)
        return Sticks(thrust_n, (roll, pitch, yaw), armed)

    def _make_idle(self, armed: bool) -> list[float]:
        m, out = self._map, self._rest.copy()
        self._set_throttle(out, m.thrust.low)
        for stick in self._sticks:
            out[stick.channel - 1] = (
                stick.trim if armed or stick.failsafe is None else stick.failsafe
            )
        if m.arm is not None:
            out[m.arm.channel - 1] = m.arm.armed if armed else m.arm.disarmed
        return out

    def _set_throttle(self, out: list[float], position: float) -> None:
        m = self._map
        out[m.thrust.channel - 1] = position
        if m.throttle_copy is not None:
            out[m.throttle_copy.channel - 1] = min(
                max(position, m.throttle_copy.low), m.throttle_copy.high
            )
