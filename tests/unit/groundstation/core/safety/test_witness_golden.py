"""The second witness on recordings of PX4 and ArduPilot in flight (tests/golden/README.md).

There the poses are the autopilot's own, so that both agree; lies are made of them.
"""

import math
import random
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from groundstation.core.geometry import Quat, so3
from groundstation.core.messages import Pose
from groundstation.core.safety import Witness
from groundstation.pose import TlogReader
from links.core import Attitude
from links.mavlink.protocol import attitude_of

GOLDEN = Path(__file__).parents[4] / "golden"
BOTH = pytest.mark.parametrize("name", ["px4_takeoff", "ardupilot_landing"])
FLIES_S = {"px4_takeoff": 8.0, "ardupilot_landing": 0.0}
"""It flies from then on, after the recording's begin."""
BEGUN_S = 5.0
"""The recording's begin, on our clock. One that flies already stood level until a second before."""

Meddle = Callable[[float, Quat], Quat]


@cache
def recorded(name: str) -> list[Pose | Attitude]:
    """Every attitude, as a pose and as the autopilot's own; on our clock."""
    seen = list[tuple[float, Attitude, int]]()
    for record in TlogReader((GOLDEN / f"{name}.tlog").read_bytes()):
        message = record.message
        if message.get_type() == "ODOMETRY":
            w, x, y, z = message.q
            rates = (message.rollspeed, message.pitchspeed, message.yawspeed)
            seen.append((message.time_usec * 1e-6, Attitude(0.0, (w, x, y, z), rates), message.reset_counter))
        else:
            told = attitude_of(message, 0.0, None)
            if told is not None:
                seen.append((message.time_boot_ms * 1e-3, told, 0))
    events = list[Pose | Attitude]()
    for n in range(0 if FLIES_S[name] else int(50 * (BEGUN_S - 1.0))):
        time_s = 0.02 * n
        events.append(Attitude(time_s, so3.IDENTITY, (0.0, 0.0, 0.0)))
        events.append(Pose(n, time_s, time_s, (0.0, 0.0, 0.0), so3.IDENTITY))
    for n, (stamp_s, told, resets) in enumerate(seen):
        time_s = BEGUN_S + stamp_s - seen[0][0]
        if n % 2 == 0:
            events.append(Attitude(time_s, told.attitude, told.rates_rad_s))
        events.append(Pose(n, time_s, time_s, (0.0, 0.0, 0.0), told.attitude, reset_count=resets))
    return events


def shares(name: str, meddle: Meddle, late_s: float = 0.0) -> list[tuple[float, float]]:
    """The statistic as a share of its threshold, by the time on our clock [s]."""
    witness, armed, found = Witness(), False, list[tuple[float, float]]()
    for what in recorded(name):
        if what.time_s >= BEGUN_S + FLIES_S[name] and not armed:
            armed = True
            witness.arm()
        if isinstance(what, Pose):
            time_s = what.time_s + late_s
            attitude = meddle(what.time_s, what.attitude)
            witness.pose(Pose(what.id, time_s, time_s, what.position_ned, attitude, reset_count=what.reset_count))
        else:
            witness.attitude(what)
        told = witness.verdict(what.time_s)
        if told is not None:
            found.append((what.time_s, told.share))
    return found


def true(_time_s: float, attitude: Quat) -> Quat:
    return attitude


def noisy() -> Meddle:
    rng, noise = random.Random(2), math.radians(0.4)
    return lambda _time_s, attitude: so3.rotate(
        attitude, (rng.gauss(0.0, noise), rng.gauss(0.0, noise), rng.gauss(0.0, noise))
    )


def askew(_time_s: float, attitude: Quat) -> Quat:
    return so3.multiply(attitude, so3.from_euler_zyx(math.radians(3.0), math.radians(-3.0), math.radians(10.0)))


@BOTH
@pytest.mark.parametrize("late_s", [-0.1, -0.05, 0.0, 0.05, 0.1])
def test_true_poses_are_not_doubted_with_clocks_up_to_a_tenth_of_a_second_apart(name: str, late_s: float) -> None:
    found = shares(name, true, late_s)
    assert len(found) > 900
    assert max(share for _, share in found) < 0.5


@BOTH
@pytest.mark.parametrize("make", [noisy, lambda: askew], ids=["noisy", "askew"])
def test_noise_and_a_body_mounted_askew_are_not_doubted(name: str, make: Callable[[], Meddle]) -> None:
    assert max(share for _, share in shares(name, make())) < 0.9


def mirrored(roll: float, pitch: float) -> Meddle:
    def meddle(_time_s: float, attitude: Quat) -> Quat:
        a, b, c = so3.euler_zyx(attitude)
        return so3.from_euler_zyx(roll * a, pitch * b, c)

    return meddle


def body_turned(yaw_deg: float) -> Meddle:
    return lambda _time_s, attitude: so3.multiply(attitude, so3.from_euler_zyx(0.0, 0.0, math.radians(yaw_deg)))


LIES: dict[str, Meddle] = {
    "level for ever": lambda _time_s, _attitude: so3.IDENTITY,
    "mirrored": mirrored(-1.0, -1.0),
    "yaw 90° off": body_turned(90.0),
    "yaw 180° off": body_turned(180.0),
}


@BOTH
@pytest.mark.parametrize("lie", LIES.values(), ids=LIES)
def test_lies_are_doubted_once_the_vehicle_leans(name: str, lie: Meddle) -> None:
    leans_s = next(
        what.time_s
        for what in recorded(name)
        if isinstance(what, Attitude)
        and what.time_s > BEGUN_S + FLIES_S[name]
        and math.acos(so3.third_column(what.attitude)[2]) > math.radians(5.0)
    )
    doubted_s = next(time_s for time_s, share in shares(name, lie) if share >= 1.0)
    assert doubted_s < leans_s + 0.4
