"""The pilot in a loop with the model of a vehicle: the numbers of its flights.

A change of how it flies changes them, and nothing else does:
``python -m tests.unit.groundstation.core.test_pilot_loop`` prints those of today.
"""

import math
import random
from collections import deque
from typing import NamedTuple

import pytest

from groundstation.core.control import HOLDING, TRACKING, TRANSIT, Gains
from groundstation.core.geometry import FLOATS, IDENTITY, ZERO, add, add_scaled, so3
from groundstation.core.messages import Estimate, Pose
from groundstation.core.pilot import Pilot
from groundstation.core.trajectory import LemniscateConfig
from groundstation.core.vehicle import ActuatorCommand, Motion, Vehicle, integrate

G = 9.81
PERIOD_S = 0.02
COAST_S = 0.25
LATE = Vehicle(command_delay_s=PERIOD_S, rate_delay_s=PERIOD_S)
SPOOLED_UP = 20
LIFT_OFF = 35
"""Numbers of the frames of the first thrust that lifts, and of the lift-off."""
PROFILES = {LIFT_OFF: TRANSIT, 225: HOLDING, 250: TRACKING, 400: TRANSIT}
"""Profile from a frame on."""
Span = tuple[float, float]
NEVER = (math.inf, math.inf)


class Scene(NamedTuple):
    """Spans of a flight in which something is wrong [s]."""

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
    jitter_s: float = 0.0
    """Error of the poses' stamps, 1σ [s]."""
    vehicle: Vehicle = Vehicle()
    gains: Gains = Gains()


def flown(scene: Scene) -> list[float]:
    """Means over 9 s of flight in wind, heavier than it is configured, and its last commands."""
    vehicle, draws, rows = scene.vehicle, random.Random(1), list[list[float]]()
    flies, hover_n = Pilot(vehicle, scene.gains, COAST_S, 0.0), vehicle.mass_kg * G
    state, health = flies.state, flies.state.health
    position, attitude, lifted_m, mirror_m, surprise = ZERO, IDENTITY, 0.0, 0.0, 0.0
    motion = Motion(position, ZERO, attitude, hover_n, ZERO)
    drives = deque(3 * [ActuatorCommand(0.9 * hover_n, ZERO)], maxlen=3)
    flies.set_on_floor()
    estimate = Estimate(0.0, motion, ZERO, ZERO)
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
        shown = add_scaled(motion.position, draws.gauss(0.0, scene.jitter_s), motion.velocity)
        position = position if frozen else add(add(shown, noise), (0.0, aside_m, 0.0))
        attitude = (
            attitude
            if stiff
            else so3.multiply(so3.from_euler_zyx(0.0, 0.0, yaw_rad), motion.attitude)
        )
        if n % scene.every == 0 and not silent:
            pose = Pose(n, time_s, time_s, position, attitude)
            surprise = state.estimator.consistency(pose) if n > 0 else 0.0
            flies.estimate_state(pose)
        flies.take_autopilot_attitude(time_s, motion.attitude)
        if n in PROFILES:
            flies.use_profile(PROFILES[n])
        if n == LIFT_OFF:
            lifted_m = flies.lift_off(time_s, 1.05, -motion.velocity[2]).position_ned[2]
            flies.follow(LemniscateConfig(speed_m_s=0.3, altitude_m=3.0).build(), time_s)
        if n < LIFT_OFF:
            thrust_n = (0.9 if n < SPOOLED_UP else 1.3) * hover_n
            command = flies.idle(time_s, thrust_n)
            drives.append(ActuatorCommand(thrust_n, ZERO))
        else:
            flies.set_uplink_lost(unheard)
            flies.set_ground_contact(touch)
            if state.descent is None and (health.has_failed or time_s - state.newest_s >= COAST_S):
                flies.descend(0.3, blind=True)
            tick = flies.compute_command(time_s)
            command, estimate = tick.command, tick.estimate
            drives.append(tick.decision.drive)
        if n < SPOOLED_UP:
            continue
        now = drives[-2 if vehicle is LATE else -1]._replace(
            rates=drives[-3 if vehicle is LATE else -1].rates
        )
        motion = integrate(
            FLOATS, motion, now, PERIOD_S, mass=1.05 * vehicle.mass_kg, gravity=G,
            disturbance=(3.6 if gust else 0.6, -0.4, 0.3), drag=vehicle.drag_per_s,
            thrust_lag=vehicle.thrust_lag_s, rate_lag=vehicle.rate_lag_s,
        )  # fmt: skip
        if motion.position[2] > 0.01:
            break
        falls = sum(part.thrust_n * part.duration_s for part in command.bring_down)
        rows.append([
            *motion.position, state.speed_aside_m_s, now.thrust, math.hypot(*now.rates),
            falls, state.noise_m, *estimate.disturbance, estimate.effectiveness, surprise,
            *(state.mean_disturbance.value or ZERO), health.alarm, health.push_alarm,
            health.is_suspect, health.has_failed, state.is_blind,
        ])  # fmt: skip
    ends = flies.last_command(9.5, PERIOD_S), flies.plan_open_loop_descent(9.5, PERIOD_S)
    means = [sum(column) / len(rows) for column in zip(*rows, strict=True)]
    return [*means, *(end.thrust_n for end in ends), len(ends[1].bring_down), lifted_m]


FLIGHTS: dict[str, tuple[Scene, list[float]]] = {
    "nothing wrong": (Scene(),
         [-0.0637165, -0.0689484, -2.59655, 0.327235, 0.854079, 0.553355, 1.36593, 0.000311994,
          0.578143, -0.385304, 0.27047, 0.952403, 2.56442, 0.573432, -0.383107, 0.258752, 0.0,
          0.0657805, 0.0, 0.0, 0.0, 0.808773, 0.339606, 37, -0.0318597]),
    "commands that are late, rates later still": (Scene(vehicle=LATE),
         [-0.0656265, -0.0724946, -2.58029, 0.325815, 0.853938, 0.608309, 1.36539, 0.000312028,
          0.57565, -0.38261, 0.223761, 0.948064, 2.55935, 0.571211, -0.378565, 0.209881, 0.0,
          0.0657798, 0.0, 0.0, 0.0, 0.809156, 0.339598, 37, -0.029739]),
    "few poses": (Scene(every=5),
         [-0.0634211, -0.0684766, -2.59604, 0.327588, 0.854129, 0.471695, 1.36577, 0.000335108,
          0.589027, -0.391539, 0.446559, 0.968919, 1.78697, 0.58141, -0.390146, 0.43253, 0.0,
          0.063789, 0.0, 0.0, 0.0, 0.808488, 0.339682, 37, -0.0322227]),
    "stamps with jitter": (Scene(jitter_s=0.003),
         [-0.0657686, -0.0685948, -2.59717, 0.324724, 0.854085, 0.667545, 1.36435, 0.00143836,
          0.59475, -0.390208, 0.418364, 0.966628, 3.44907, 0.60491, -0.391113, 0.396948, 0.0,
          0.0858676, 0.0, 0.0, 0.0, 0.808212, 0.339603, 37, -0.0325605]),
    "jitter that is configured": (Scene(jitter_s=0.003, gains=Gains(pose_jitter_s=0.002)),
         [-0.0638808, -0.0682994, -2.60219, 0.327142, 0.854173, 0.745918, 1.37087, 0.0018197,
          0.589287, -0.392168, 0.453466, 0.968807, 3.86199, 0.588777, -0.389314, 0.459194, 0.0,
          0.0727285, 0.0, 0.0, 0.0, 0.808305, 0.339768, 37, -0.0318652]),
    "positions that freeze": (Scene(frozen_s=(5.5, 5.8)),
         [-0.01034, 0.0295971, -2.27852, 0.258693, 0.853921, 0.790717, 1.37184, 0.000312764,
          0.613365, -0.385615, 0.263959, 0.952007, 548.878, 0.598929, -0.383089, 0.253419, 0.0,
          0.112367, 0.0131868, 0.424176, 0.147253, 0.808786, 0.339176, 27, -0.0318597]),
    "attitudes that freeze": (Scene(stiff_s=(5.5, 7.0)),
         [-0.00800008, -0.0771878, -2.21497, 0.26461, 0.840036, 1.09257, 1.26904, 0.000316799,
          0.580002, -0.372452, 0.265522, 0.952184, 70570.4, 0.575086, -0.374631, 0.255919,
          0.597479, 0.0743562, 0.00440529, 0.370044, 0.370044, 0.805862, 0.848276, 2, -0.0318597]),
    "no poses for a while": (Scene(silent_s=(5.5, 6.1)),
         [0.0797721, 0.0450887, -2.38899, 0.242263, 0.852089, 0.684503, 1.31894, 0.000308089,
          0.576657, -0.383779, 0.262635, 0.95205, 2.49102, 0.572513, -0.382134, 0.252613, 0.0,
          0.0636772, 0.10989, 0.0, 0.0395604, 0.808788, 0.33944, 29, -0.0318597]),
    "positions that jump and come back": (Scene(jumped_s=(5.5, 5.6)),
         [-0.0636919, -0.0689703, -2.59656, 0.327343, 0.854079, 0.547296, 1.36596, 0.000313259,
          0.577911, -0.385007, 0.269282, 0.952277, 2361.29, 0.573279, -0.382911, 0.257582, 0.0,
          0.0655, 0.0, 0.0, 0.0, 0.808776, 0.339613, 37, -0.0318597]),
    "positions that drift": (Scene(drifting_s=(5.5, 7.0)),
         [-0.0500669, -0.280935, -2.50856, 0.319041, 0.85267, 0.903274, 1.21322, 0.000316832,
          0.581666, -0.360089, 0.351176, 0.960645, 5707.38, 0.575543, -0.367193, 0.340161, 0.0,
          0.0673134, 0.221978, 0.0, 0.10989, 0.808927, 0.33899, 32, -0.0318597]),
    "positions that are mirrored": (Scene(mirrored_s=(5.5, 7.0)),
         [0.0909821, -0.334918, -2.18307, 0.396363, 0.843878, 1.12476, 1.26019, 0.000314119,
          0.574641, -0.252837, 0.257168, 0.951829, 971838.0, 0.570651, -0.301631, 0.247462,
          0.273435, 0.991618, 0.0216346, 0.329327, 0.329327, 0.805934, 0.02, 1.0, -0.0318597]),
    "headings that turn": (Scene(turning_s=(5.5, 7.0)),
         [0.182428, 0.083964, -2.21369, 0.25314, 0.841186, 0.934619, 1.2654, 0.000315183,
          0.574802, -0.37994, 0.265079, 0.951991, 395685.0, 0.573297, -0.38053, 0.252923,
          0.486216, 0.0675108, 0.0332594, 0.381375, 0.365854, 0.817344, 0.848591, 3, -0.0318597]),
    "no uplink": (Scene(unheard_s=(5.5, 6.5)),
         [-0.0624904, -0.0695607, -2.57481, 0.326892, 0.854077, 0.50325, 1.36573, 0.000312008,
          0.577586, -0.385026, 0.266275, 0.952301, 2.55513, 0.57306, -0.383033, 0.256862, 0.0,
          0.0645693, 0.0, 0.0, 0.0, 0.808766, 0.339542, 37, -0.0318597]),
    "a gust": (Scene(gust_s=(5.5, 6.5)),
         [-0.0632206, -0.0692016, -2.59656, 0.336529, 0.862485, 0.885316, 1.36821, 0.000311961,
          0.909577, -0.385433, 0.274678, 0.952789, 3.11326, 0.800533, -0.383216, 0.262834, 0.0,
          0.0911786, 0.112088, 0.0, 0.0, 0.808776, 0.339626, 37, -0.0318597]),
    "contact": (Scene(touch_s=(0.8, 1.1)),
         [-0.0663591, -0.0723433, -2.59648, 0.323568, 0.853879, 0.554275, 1.36784, 0.000311994,
          0.580182, -0.388738, 0.32124, 0.956872, 2.56449, 0.575264, -0.390649, 0.317981, 0.0,
          0.0657805, 0.0, 0.0, 0.0, 0.808738, 0.339686, 37, -0.0318597]),
}  # fmt: skip
"""What is wrong, and the means: position [m], speed aside [m/s], thrust [N], body rate [rad/s],
impulse of the bring-down [N s], noise [m], disturbance [m/s²], thrust scale and squared innovation
[-], mean disturbance [m/s²], alarms [-], and shares of the time of suspect, failed and unused
poses; then thrust of a last command and of a descent on the model [N], its number of parts, and the
position at lift-off [m]."""


@pytest.mark.parametrize(("scene", "numbers"), FLIGHTS.values(), ids=FLIGHTS)
def test_a_pilots_flights_have_these_numbers(scene: Scene, numbers: list[float]) -> None:
    assert flown(scene) == pytest.approx(numbers, rel=1e-5, abs=1e-12)


if __name__ == "__main__":  # the numbers of today
    for name, (scene, _) in FLIGHTS.items():
        print(name, [float(f"{number:.6g}") for number in flown(scene)])
