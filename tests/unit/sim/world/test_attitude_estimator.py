"""The attitude estimator on board of simulated vehicles."""

import math

from groundstation.core.geometry import Quat, Vec3, so3
from sim.world import AttitudeEstimator, TrueState, generator, rows
from sim.world.airframe import LOOP_S, WANDER_RAD

GRAVITY = 9.81
ZERO: Vec3 = (0.0, 0.0, 0.0)


def make_estimator(seed: int = 0) -> AttitudeEstimator:
    return AttitudeEstimator(rows(generator(seed, "horizon").standard_normal, 3), GRAVITY)


def truth(
    time_s: float,
    attitude: Quat = so3.IDENTITY,
    velocity: Vec3 = ZERO,
    rates: Vec3 = ZERO,
    *,
    on_ground: bool = False,
) -> TrueState:
    return TrueState(time_s, ZERO, velocity, attitude, rates, GRAVITY, on_ground)


def off_deg(estimated: Quat, true: Quat) -> float:
    return math.degrees(
        math.hypot(*so3.rotation_vector(so3.multiply(so3.conjugate(true), estimated)))
    )


def test_it_is_off_by_some_tenths_of_a_degree_that_wander_slowly() -> None:
    squares, steps = list[float](), list[float]()
    for seed in range(40):
        estimator, last = make_estimator(seed), None
        for n in range(200):
            estimated, _ = estimator.estimate_attitude(truth(0.02 * n, on_ground=True))
            squares.append(off_deg(estimated, so3.IDENTITY) ** 2)
            steps += [off_deg(estimated, last)] if last is not None else []
            last = estimated
    rms = math.sqrt(sum(squares) / len(squares) / 3.0)
    assert 0.7 < rms / math.degrees(WANDER_RAD) < 1.3
    assert sum(steps) / len(steps) < 0.1


def test_it_turns_with_the_body_and_tells_its_newest_loop() -> None:
    estimator, rates = make_estimator(), (0.0, 0.0, math.radians(90.0))

    def at(time_s: float) -> tuple[Quat, Vec3]:
        return estimator.estimate_attitude(
            truth(time_s, so3.from_euler_zyx(0.0, 0.0, time_s * rates[2]), rates=rates)
        )

    before, after = at(250.25 * LOOP_S)[0], at(255.75 * LOOP_S)[0]
    turned = so3.rotation_vector(so3.multiply(so3.conjugate(before), after))[2]
    assert abs(math.degrees(turned) - 1.8) < 0.1  # five turns of the loop
    assert at(2.0)[1] == rates


def test_who_accelerates_for_long_is_taken_for_less_leant() -> None:
    lean = math.radians(15.0)
    for heading, axis in ((0.0, 1), (0.5 * math.pi, 0)):
        estimator, roll_pitch = make_estimator(), (0.0, 0.0, 0.0)
        attitude = (
            so3.from_euler_zyx(lean, 0.0, 0.0) if heading else so3.from_euler_zyx(0.0, -lean, 0.0)
        )
        for n in range(300):
            speed = 0.02 * n * GRAVITY * math.tan(lean)
            velocity = (speed * math.cos(heading), speed * math.sin(heading), 0.0)
            roll_pitch = so3.euler_zyx(
                estimator.estimate_attitude(truth(0.02 * n, attitude, velocity))[0]
            )
        assert 2.0 < 15.0 - abs(math.degrees(roll_pitch[axis])) < 12.0
