"""Excitation tones: small known motions beside the law's, to which true poses respond. Sans-IO.

In a hold and in a landing the law moves the vehicle so little that a frozen pose looks like a good
hold. The tones move it by known amounts: roll and pitch rate circle at three frequencies, thrust
oscillates at a fourth. They are above the loop's bandwidth (4 to 6 rad/s), so that wind and law
hardly change them, and they are scaled by the vehicle's lag, so that every vehicle makes the same
tilt. Their motion follows from the commands through lag and delay in closed form. It is subtracted
from the state for the law: otherwise the law would brake it, and the response would mix with that
to wind.
"""

import cmath
import math
from typing import NamedTuple

from groundstation.core.control.demand_limits import DemandLimits
from groundstation.core.geometry import FLOATS, ZERO, Vec3, rotate, subtract
from groundstation.core.messages import Estimate
from groundstation.core.vehicle import ActuatorCommand, Motion, Vehicle

TILT_TONES_RAD_S = (10.5, 14.0, 18.5)
"""Frequencies of the tones in roll and pitch [rad/s]: above the loop's bandwidth (6), but not far,
as the motion decreases with their square. No two are multiples of one another, so that no latency
below 1 s hides all of them."""
TILT_RATE_RAD_S = 0.19
"""Amplitude of the body rate of each tone, after the lag [rad/s]: 1.0, .8 and .6 degrees of tilt,
1.8 mm RMS of horizontal motion, of the 3 mm RMS that a hold may have."""
THRUST_TONE_RAD_S = 12.0
"""Frequency of the tone in thrust [rad/s]; as for the tilt."""
THRUST_SHARE = 0.03
"""Amplitude of the tone in thrust, after the lag, as a share of the thrust [-]: 2 mm of height,
which is THRUST_SHARE g / THRUST_TONE_RAD_S²."""
FADE_IN_S = 0.3
"""Time in which the tones fade in and out [s]: a step would add a transient to the settled motion.
Chosen."""
SUSPECT_LEVEL = 3.0
"""Factor on all amplitudes while the poses are suspect [-]: the response is known after .6 s, not
1.2 s, at the cost of 5 mm RMS."""


class ToneMotion(NamedTuple):
    """Motion of the vehicle by the tones at one instant."""

    position: Vec3
    """[m, NED]."""
    velocity: Vec3
    """[m/s, NED]."""
    tilt: tuple[float, float]
    """Roll and pitch [rad]."""
    rates: tuple[float, float]
    """Roll and pitch rate [rad/s]."""
    thrust_share: float
    """Thrust of the tone as a share of the thrust without [-]."""


NO_MOTION = ToneMotion(ZERO, ZERO, (0.0, 0.0), (0.0, 0.0), 0.0)
"""Motion without tones."""


class ExcitationTones:
    """Tones of one flight. Times are on the event loop's clock [s]."""

    def __init__(self, vehicle: Vehicle, gravity: float) -> None:
        """Scale the tones for the configured ``vehicle``; ``gravity`` is g [m/s²]."""
        self._gravity = gravity
        self._most_rates = DemandLimits(FLOATS, vehicle).rates
        self._rate_delay = (
            vehicle.command_delay_s + vehicle.rate_delay_s + 0.5 * vehicle.frame_period_s
        )
        self._thrust_delay = (
            vehicle.command_delay_s + vehicle.thrust_delay_s + 0.5 * vehicle.frame_period_s
        )
        lag = vehicle.rate_lag_s
        self._rate_scale = math.hypot(1.0, TILT_TONES_RAD_S[1] * lag)
        self._thrust_scale = math.hypot(1.0, THRUST_TONE_RAD_S * vehicle.thrust_lag_s)
        # Frequency [rad/s], the same times i, and complex amplitude of the tilt [rad].
        self._tilts = [
            (w, 1j * w, self._rate_scale * TILT_RATE_RAD_S / (1j * w * (1.0 + 1j * w * lag)))
            for w in TILT_TONES_RAD_S
        ]
        lift_lag = 1.0 + 1j * THRUST_TONE_RAD_S * vehicle.thrust_lag_s
        # Complex amplitude of the downward acceleration [m/s²].
        self._lift = -gravity * THRUST_SHARE * self._thrust_scale / lift_lag
        self._since_s, self._level, self._target = -math.inf, 0.0, 0.0
        self._last = NO_MOTION

    def set_level(self, time_s: float, target: float) -> None:
        """Fade the factor on all amplitudes to ``target`` [-], from ``time_s`` on."""
        if target != self._target:
            self._level = self.level_at(time_s)
            self._since_s, self._target = time_s, target

    def has_room(self, drive: ActuatorCommand) -> bool:
        """Whether ``drive`` leaves room for tones: its roll and pitch rates are within the
        vehicle's limits.

        At a limit a tone would only take from the law, and its motion would not be that of
        :meth:`motion`.
        """
        roll, pitch, _ = drive.rates
        most_roll, most_pitch, _ = self._most_rates
        return abs(roll) < most_roll and abs(pitch) < most_pitch

    def level_at(self, time_s: float) -> float:
        """Return the factor on all amplitudes at ``time_s`` [-]."""
        done = min(max((time_s - self._since_s) / FADE_IN_S, 0.0), 1.0)
        return self._level + (self._target - self._level) * done

    def add_to(self, drive: ActuatorCommand, time_s: float) -> ActuatorCommand:
        """Return ``drive`` with the tones of a command that is sent at ``time_s``.

        Limits are not applied.
        """
        level = self.level_at(time_s)
        if level == 0.0:
            return drive
        thrust, (roll, pitch, yaw) = drive
        k = level * self._rate_scale * TILT_RATE_RAD_S
        phases = [w * time_s for w in TILT_TONES_RAD_S]
        swing = level * self._thrust_scale * THRUST_SHARE * math.cos(THRUST_TONE_RAD_S * time_s)
        rates = (roll + k * sum(map(math.cos, phases)), pitch + k * sum(map(math.sin, phases)), yaw)
        return ActuatorCommand(thrust * (1.0 + swing), rates)

    def motion(self, time_s: float, yaw_rad: float) -> ToneMotion:
        """Return the settled motion by the tones at ``time_s`` of a vehicle with heading
        ``yaw_rad``.

        Roll + i pitch is one rotating complex number. At heading 0 the acceleration north + i east
        is i g (roll + i pitch).
        """
        level = self.level_at(time_s)
        if level == 0.0:
            return NO_MOTION
        g, commanded_s = self._gravity, time_s - self._rate_delay
        position = velocity = tilt = rate = 0j
        for w, turning, amplitude in self._tilts:
            now = amplitude * cmath.exp(turning * commanded_s)
            tilt, rate = tilt + now, rate + turning * now
            position, velocity = position - 1j * g * now / (w * w), velocity + g * now / w
        heading, w = level * cmath.exp(1j * yaw_rad), THRUST_TONE_RAD_S
        position, velocity = heading * position, heading * velocity
        tilt, rate = level * tilt, level * rate
        lift = level * self._lift * cmath.exp(1j * w * (time_s - self._thrust_delay))
        return ToneMotion(
            (position.real, position.imag, -lift.real / (w * w)),
            (velocity.real, velocity.imag, (lift / (1j * w)).real),
            (tilt.real, tilt.imag),
            (rate.real, rate.imag),
            -lift.real / g,
        )

    def advance(self, time_s: float, yaw_rad: float) -> tuple[Vec3, tuple[float, float]]:
        """Return displacement [m, NED] and turn in roll and pitch [rad] by the tones since the last
        call.
        """
        last, self._last = self._last, self.motion(time_s, yaw_rad)
        (a, b), (c, d) = self._last.tilt, last.tilt
        return subtract(self._last.position, last.position), (a - c, b - d)

    def take_out(self, estimate: Estimate, yaw_rad: float) -> Estimate:
        """Return ``estimate`` without the motion by the tones."""
        tone, motion = self.motion(estimate.time_s, yaw_rad), estimate.motion
        if tone is NO_MOTION:
            return estimate
        (roll, pitch), (roll_rate, pitch_rate) = tone.tilt, tone.rates
        without = Motion(
            subtract(motion.position, tone.position),
            subtract(motion.velocity, tone.velocity),
            rotate(motion.attitude, (-roll, -pitch, 0.0)),  # exact for small angles
            motion.thrust / (1.0 + tone.thrust_share),
            subtract(motion.rates, (roll_rate, pitch_rate, 0.0)),
        )
        return estimate._replace(motion=without)
