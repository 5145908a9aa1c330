"""The pilot in a loop with the model of a vehicle: the numbers of its flights.

A change of how it flies changes them, and nothing else does.
"""

import math
import random
from collections import deque
from typing import NamedTuple

import pytest

from groundstation.core.control import HOLDING, TRACKING, TRANSIT, Gains
from groundstation.core.geometry import FLOATS, IDENTITY, ZERO, add, so3
from groundstation.core.messages import Pose
from groundstation.core.pilot import Pilot
from groundstation.core.trajectory import LemniscateConfig
from groundstation.core.vehicle import ActuatorCommand, Motion, Vehicle, integrate

G, PERIOD_S, COAST_S = 9.81, 0.02, 0.25
LATE = Vehicle(command_delay_s=PERIOD_S, rate_delay_s=PERIOD_S)
LIFT_OFF = 25
"""Number of the frame of the lift-off."""
PROFILES = {LIFT_OFF: TRANSIT, 225: HOLDING, 250: TRACKING, 400: TRANSIT}
"""Profile from a frame on."""
Span = tuple[float, float]
NEVER = (math.inf, math.inf)


class Scene(NamedTuple):
    """From when to when something is wrong [s]."""

    frozen_s: Span = NEVER
    """The poses' positions stay the same."""
    stiff_s: Span = NEVER
    """Their attitudes do."""
    silent_s: Span = NEVER
    """There are no poses."""
    jumped_s: Span = NEVER
    """Positions are 0.3 m aside."""
    drifting_s: Span = NEVER
    """They go aside at 0.3 m/s."""
    mirrored_s: Span = NEVER
    """East is west."""
    turning_s: Span = NEVER
    """Headings turn at 0.5 rad/s."""
    unheard_s: Span = NEVER
    """The uplink is lost."""
    gust_s: Span = NEVER
    """The wind is stronger by 3 m/s²."""
    touch_s: Span = NEVER
    """The vehicle may touch the floor."""
    every: int = 1
    """Frames from pose to pose [-]."""
    vehicle: Vehicle = Vehicle()


def flown(scene: Scene) -> list[float]:
    """Means over 9 s of flight in wind, heavier than it is configured, and its last commands."""
    vehicle, draws, rows = scene.vehicle, random.Random(1), list[list[float]]()
    flies, hover_n = Pilot(vehicle, Gains(), COAST_S, 0.0), vehicle.mass_kg * G
    state, health = flies.state, flies.state.health
    position, attitude, lifted_m, mirror_m = ZERO, IDENTITY, 0.0, 0.0
    motion = Motion(position, ZERO, attitude, hover_n, ZERO)
    drives = deque(3 * [ActuatorCommand(hover_n, ZERO)], maxlen=3)
    flies.set_on_floor()
    for n in range(475):
        time_s = n * PERIOD_S
        frozen, stiff, silent, jumped, drifting, mirrored, turning, unheard, gust, touch = (
            begin_s <= time_s < end_s for begin_s, end_s in scene[:10]
        )
        noise = (draws.gauss(0.0, 0.0003), draws.gauss(0.0, 0.0003), draws.gauss(0.0, 0.0003))
        aside_m = 0.3 * jumped + (0.3 * (time_s - scene.drifting_s[0]) if drifting else 0.0)
        mirror_m = mirror_m if mirrored else motion.position[1]
        aside_m += 2.0 * (mirror_m - motion.position[1])
        yaw_rad = 0.5 * (time_s - scene.turning_s[0]) if turning else 0.0
        position = position if frozen else add(add(motion.position, noise), (0.0, aside_m, 0.0))
        attitude = (
            attitude
            if stiff
            else so3.multiply(so3.from_euler_zyx(0.0, 0.0, yaw_rad), motion.attitude)
        )
        if n % scene.every == 0 and not silent:
            flies.estimate_state(Pose(n, time_s, time_s, position, attitude))
        flies.take_autopilot_attitude(time_s, motion.attitude)
        if n in PROFILES:
            flies.use_profile(PROFILES[n])
        if n < LIFT_OFF:
            flies.idle(time_s, 0.9 * hover_n)
            continue
        if n == LIFT_OFF:
            lifted_m = flies.lift_off(time_s, 1.05, 0.3).position_ned[2]
            motion = motion._replace(position=(0.0, 0.0, -0.05), velocity=(0.0, 0.0, -0.3))
            flies.follow(LemniscateConfig(speed_m_s=0.3, altitude_m=3.0).build(), time_s)
        flies.set_uplink_lost(unheard)
        flies.set_ground_contact(touch)
        if state.descent is None and (health.has_failed or time_s - state.newest_s >= COAST_S):
            flies.descend(0.3, blind=True)
        tick = flies.compute_command(time_s)
        drives.append(tick.decision.drive)
        now = drives[-2 if vehicle is LATE else -1]._replace(
            rates=drives[-3 if vehicle is LATE else -1].rates
        )
        motion = integrate(
            FLOATS, motion, now, PERIOD_S, mass=1.05 * vehicle.mass_kg, gravity=G,
            disturbance=(3.6 if gust else 0.6, -0.4, 0.3), drag=vehicle.drag_per_s,
            thrust_lag=vehicle.thrust_lag_s, rate_lag=vehicle.rate_lag_s,
        )  # fmt: skip
        if motion.position[2] > 0.0:
            break
        falls = sum(part.thrust_n * part.duration_s for part in tick.command.bring_down)
        rows.append([
            *motion.position, now.thrust, math.hypot(*now.rates), falls, state.noise_m,
            *tick.estimate.disturbance, tick.estimate.effectiveness,
            *(state.mean_disturbance.value or ZERO), health.alarm, health.push_alarm,
            health.is_suspect, health.has_failed, state.is_blind,
        ])  # fmt: skip
    ends = flies.last_command(9.5, PERIOD_S), flies.surrender(9.5, PERIOD_S)
    means = [sum(column) / len(rows) for column in zip(*rows, strict=True)]
    return [*means, *(end.thrust_n for end in ends), len(ends[1].bring_down), lifted_m]


FLIGHTS: dict[str, tuple[Scene, list[float]]] = {
    "nothing wrong": (Scene(),
         [-0.117122, -0.0925175, -2.64672, 0.851451, 0.740626, 1.43752, 0.000734066, 0.755511,
          -0.382961, 0.49386, 0.961536, 1.1546, -0.344548, 0.778184, 0.0, 0.0612363, 0.111111,
          0.0, 0.0, 0.799618, 0.341295, 37, 0.000653861]),
    "commands that are late, rates later still": (Scene(vehicle=LATE),
         [-0.120414, -0.093389, -2.63136, 0.851299, 0.81292, 1.4298, 0.000734191, 0.746162,
          -0.402663, 0.447592, 0.958601, 1.11825, -0.425535, 0.709422, 0.0, 0.0612306, 0.111111,
          0.0, 0.0, 0.798364, 0.341053, 37, -0.0101544]),
    "few poses": (Scene(every=5),
         [-0.0915481, -0.0837067, -2.65234, 0.851221, 0.440212, 1.40557, 0.00161593, 0.596764,
          -0.38641, 0.303488, 0.954116, 0.570307, -0.343104, 0.263961, 0.0, 0.0580424, 0.0, 0.0,
          0.0, 0.811244, 0.339523, 37, 0.000136814]),
    "positions that freeze": (Scene(frozen_s=(5.5, 5.8)),
         [-0.278969, -0.00951437, -2.42027, 0.85061, 0.971686, 1.45584, 0.000761496, 0.830303,
          -0.373179, 0.513326, 0.960674, 1.20552, -0.338356, 0.787861, 0.0, 0.105547, 0.122222,
          0.428889, 0.148889, 0.800398, 0.345425, 20, 0.000653861]),
    "attitudes that freeze": (Scene(stiff_s=(5.5, 6.1)),
         [-0.300967, -0.0620262, -2.37702, 0.843221, 1.29, 1.30263, 0.000770789, 0.850858,
          -0.358974, 0.552867, 0.961301, 1.19399, -0.331578, 0.801311, 0.710884, 0.0773511,
          0.111111, 0.38, 0.38, 0.819238, 0.862355, 2, 0.000653861]),
    "no poses for a while": (Scene(silent_s=(5.5, 6.1)),
         [-0.106096, 0.0239504, -2.46716, 0.849027, 0.871669, 1.39236, 0.000749256, 0.795804,
          -0.377608, 0.506019, 0.960381, 1.18065, -0.341209, 0.782099, 0.0, 0.0603085, 0.222222,
          0.0, 0.04, 0.800777, 0.342345, 29, 0.000653861]),
    "positions that jump and come back": (Scene(jumped_s=(5.5, 5.6)),
         [-0.117164, -0.0925149, -2.64671, 0.851465, 0.732317, 1.43746, 0.000737836, 0.755823,
          -0.382928, 0.492754, 0.961438, 1.15482, -0.344472, 0.777074, 0.0, 0.0613408, 0.111111,
          0.0, 0.0, 0.799867, 0.341292, 37, 0.000653861]),
    "positions that drift": (Scene(drifting_s=(5.5, 7.0)),
         [-0.142624, -0.3137, -2.58316, 0.850553, 1.10901, 1.27552, 0.000748543, 0.789481,
          -0.352633, 0.602199, 0.969669, 1.1643, -0.326475, 0.867808, 0.0, 0.062921, 0.337778,
          0.0, 0.115556, 0.797487, 0.342444, 34, 0.000653861]),
    "positions that are mirrored": (Scene(mirrored_s=(5.5, 7.0)),
         [-0.117404, -0.389221, -2.21051, 0.845046, 1.3433, 1.25797, 0.000800875, 0.85852,
          -0.2573, 0.556398, 0.961491, 1.23676, -0.266968, 0.831534, 0.222901, 1.04222, 0.142506,
          0.334152, 0.334152, 0.819238, 0.02, 1.0, 0.000653861]),
    "headings that turn": (Scene(turning_s=(5.5, 7.0)),
         [-0.206379, 0.153463, -2.4012, 0.845238, 1.14128, 1.30636, 0.000773598, 0.858026,
          -0.365484, 0.546191, 0.960457, 1.19858, -0.337234, 0.795237, 0.488487, 0.0627228,
          0.144444, 0.391111, 0.366667, 0.792212, 0.345557, 17, 0.000653861]),
    "no uplink": (Scene(unheard_s=(5.5, 6.5)),
         [-0.121028, -0.0934018, -2.63268, 0.851537, 0.717989, 1.43952, 0.000734069, 0.78371,
          -0.379562, 0.508752, 0.961304, 1.17175, -0.342497, 0.786904, 0.0, 0.0601732, 0.111111,
          0.0, 0.0, 0.799611, 0.34182, 37, 0.000653861]),
    "a gust": (Scene(gust_s=(5.5, 6.5)),
         [-0.115428, -0.0916072, -2.64686, 0.860688, 1.1425, 1.44088, 0.000734141, 1.09015,
          -0.388111, 0.517109, 0.963695, 1.38394, -0.347366, 0.800218, 0.0, 0.0856308, 0.335556,
          0.0, 0.0, 0.799577, 0.341246, 37, 0.000653861]),
    "contact": (Scene(touch_s=(0.8, 1.1)),
         [-0.167657, -0.115607, -2.62751, 0.853746, 0.798577, 1.43634, 0.000734067, 0.74169,
          -0.391633, 0.508898, 0.96348, 1.12221, -0.362137, 0.786465, 0.0, 0.0612344, 0.111111,
          0.0, 0.0, 0.799593, 0.341182, 37, 0.000653861]),
}  # fmt: skip
"""What is wrong, and the means: position [m], thrust [N], body rate [rad/s], impulse of the
bring-down [N s], noise [m], disturbance [m/s²], thrust scale [-], mean disturbance [m/s²], alarms
[-], and shares of the time of suspect, failed and unused poses; then thrust of a last command and
of a descent on the model [N], its number of parts, and the position at lift-off [m]."""


@pytest.mark.parametrize(("scene", "numbers"), FLIGHTS.values(), ids=FLIGHTS)
def test_a_pilots_flights_have_these_numbers(scene: Scene, numbers: list[float]) -> None:
    assert flown(scene) == pytest.approx(numbers, rel=1e-5, abs=1e-12)
