"""The regression of the answer: what true, standing, mirrored, turned and blown poses come to."""

import math
import random
from collections.abc import Iterable, Iterator

import pytest
from hypothesis import given, strategies as st

from groundstation.core.health.pose_response import (
    OWN_LATERAL,
    OWN_TURN,
    PLANE,
    Alarm,
    HighPass,
    LatenessMonitor,
    OwnMotion,
    Response,
)

# By their numbers: a limit that the test took from the code would bear out any value.
BLOCK_S = 0.05
FADE_IN_S = 0.3
LEAST_DISPLACEMENT_M = 0.0002
LEAST_TURN_RAD = 0.0025
TONE_MEMORY_S = 0.1

DT_S = 0.01
NOISE_M = 0.0003
BLOCK = round(BLOCK_S / DT_S)
"""Poses of a block."""
Pair = tuple[float, float]
ZERO = (0.0, 0.0)
Seen = tuple[Pair, Pair, Pair]
"""Of one pose: what it shows beyond what is asked; what tones ask; what the law's own way asks."""


def swing(time_s: float, size: float = 0.002) -> Pair:
    """Motion that is asked for: three tones that circle."""
    phases = [w * time_s for w in (10.5, 14.0, 18.5)]
    return size * sum(map(math.cos, phases)), size * sum(map(math.sin, phases))


def new_plane() -> Response:
    return Response(PLANE, TONE_MEMORY_S, LEAST_DISPLACEMENT_M, OWN_LATERAL)


def feed(poses: Iterable[Seen], plane: Response | None = None) -> list[Alarm]:
    """The alarm after each block of poses."""
    plane, alarms = plane or new_plane(), []
    for n, seen in enumerate(poses, 1):
        plane.add(*seen, DT_S)
        if n % BLOCK == 0:
            alarms.append(plane.look(NOISE_M))
    return alarms


def asked(
    share: tuple[Pair, Pair],
    *,
    seed: int = 0,
    own_m: float = 0.0,
    own_rad_s: float = 5.0,
    late_s: float = 0.0,
    shows_own: bool = True,
) -> Alarm:
    """Largest alarm of poses that show ``share`` of what is asked, a 2 x 2 matrix, in noise.

    ``own_m`` is the RMS of the law's own motion along each axis [m], at ``own_rad_s``; the poses
    show all or none of it, ``late_s`` later than the model.
    """
    draw, peak_m = random.Random(seed), math.sqrt(2.0) * own_m

    def move(time_s: float) -> Pair:
        return peak_m * math.sin(own_rad_s * time_s), peak_m * math.cos(own_rad_s * time_s)

    def poses() -> Iterator[Seen]:
        for n in range(300):
            time_s = n * DT_S
            u, v = swing(time_s)
            x, y = (a * u + b * v + draw.gauss(0.0, NOISE_M) for a, b in share)
            own, (north, east) = move(time_s), move(time_s - late_s) if shows_own else (0.0, 0.0)
            yield (x - u + north - own[0], y - v + east - own[1]), (u, v), own

    found = feed(poses())
    largest = max(alarm.tones for alarm in found), max(alarm.own for alarm in found)
    return Alarm(*largest, found[-1].is_known)


@pytest.mark.parametrize("seed", range(10))
def test_true_poses_answer(seed: int) -> None:
    alarm = asked(((1.0, 0.0), (0.0, 1.0)), seed=seed)
    assert alarm.is_known
    assert alarm.tones < 0.25
    assert alarm.own == 0.0


@given(st.floats(0.7, 1.3), st.integers(0, 100))
def test_a_scale_that_is_configured_wrong_by_less_than_half_is_accepted(
    scale: float, seed: int
) -> None:
    assert asked(((scale, 0.0), (0.0, scale)), seed=seed).tones < 0.5


@pytest.mark.parametrize(
    ("share", "alarm"),
    [
        (((0.0, 0.0), (0.0, 0.0)), 5.3719),  # stands
        (((0.0, 0.0), (0.0, 1.0)), 5.3102),  # north stands
        (((0.5, 0.5), (0.5, 0.5)), 4.7964),  # north-west stands
        (((-1.0, 0.0), (0.0, 1.0)), 16.044),  # mirrored
        (((0.0, 1.0), (1.0, 0.0)), 14.266),  # swapped
        (((0.1, 0.0), (0.0, 0.1)), 4.2821),  # a tenth
        (((2.0, 0.0), (0.0, 2.0)), 5.5333),  # twice
    ],
)
def test_poses_that_show_something_else_are_accused(share: tuple[Pair, Pair], alarm: float) -> None:
    assert asked(share).tones == pytest.approx(alarm, rel=1e-3)


@given(st.floats(0.0, 0.02), st.floats(0.0, 0.08), st.floats(4.0, 16.0), st.integers(0, 100))
def test_a_model_that_is_wrong_by_20_ms_of_lag_accuses_nobody(
    late_s: float, own_m: float, own_rad_s: float, seed: int
) -> None:
    """The residual of the law's own motion widens the error."""
    true = ((1.0, 0.0), (0.0, 1.0))
    late = asked(true, seed=seed, own_m=own_m, own_rad_s=own_rad_s, late_s=late_s)
    assert late.tones < 0.5


@pytest.mark.parametrize(("own_m", "alarm"), [(0.02, 1.2873), (0.04, 0.66009)])
def test_the_model_may_be_wrong_by_a_fortieth_of_the_laws_own_motion(
    own_m: float, alarm: float
) -> None:
    found = asked(((0.0, 0.0), (0.0, 0.0)), own_m=own_m)
    assert found.tones == pytest.approx(alarm, rel=1e-3)


@pytest.mark.parametrize("own_m", [0.02, 0.04, 0.08])
def test_poses_that_stand_are_accused_however_far_the_law_moves_by_itself(own_m: float) -> None:
    assert asked(((0.0, 0.0), (0.0, 0.0)), own_m=own_m, shows_own=False).tones >= 1.0


def blown() -> Iterator[Seen]:
    """Poses of a law that holds a place in wind."""
    passes, draw = HighPass(3), random.Random(1)
    wind = truth = speed = command = pushes = seen_before = 0.0
    for _ in range(1200):
        wind += DT_S / 0.5 * (-wind) + 4.0 * math.sqrt(DT_S) * draw.gauss(0.0, 1.0)
        command += DT_S / 0.15 * (-30.0 * truth - 9.0 * speed - command)
        speed += DT_S * (wind + command)
        truth += DT_S * speed
        pushes += DT_S * command
        y, c = passes.step([truth - seen_before, DT_S * pushes], DT_S)
        seen_before = truth
        noise = draw.gauss(0.0, NOISE_M), draw.gauss(0.0, NOISE_M)
        yield (y - c + noise[0], noise[1]), (0.0, 0.0), (c, 0.0)


def test_wind_that_the_law_answers_accuses_nobody() -> None:
    assert max(alarm.own for alarm in feed(blown())[20:]) < 0.5


def running_away(share: float) -> Iterator[Seen]:
    """Poses that show ``share`` of the law's own motion, as it grows."""
    draw = random.Random(2)
    for n in range(150):
        v = 0.0005 * math.exp(n * DT_S / 0.25)
        noise = draw.gauss(0.0, NOISE_M), draw.gauss(0.0, NOISE_M)
        yield ((share - 1.0) * v + noise[0], noise[1]), (0.0, 0.0), (v, 0.0)


def test_a_mirrored_pose_that_runs_away_is_accused_without_any_tone() -> None:
    assert feed(running_away(-1.0))[-1].own >= 1.0
    assert feed(running_away(1.0))[-1].own == 0.0


@pytest.mark.parametrize(
    ("own", "least", "rms", "alarm"),
    [
        (OWN_LATERAL, LEAST_DISPLACEMENT_M, 0.015, 0.0),
        (OWN_LATERAL, LEAST_DISPLACEMENT_M, 0.03, 12.0691),
        (OWN_TURN, LEAST_TURN_RAD, 0.02, 0.0),
        (OWN_TURN, LEAST_TURN_RAD, 0.04, 8.62059),
    ],
)
def test_poses_that_stand_are_doubted_where_the_law_moves_twice_what_wind_could_cancel(
    own: OwnMotion, least: float, rms: float, alarm: float
) -> None:
    draw, poses = random.Random(5), list[Seen]()
    for n in range(300):
        v = math.sqrt(2.0) * rms * math.sin(5.0 * n * DT_S)
        noise = draw.gauss(0.0, NOISE_M), draw.gauss(0.0, NOISE_M)
        poses.append(((-v + noise[0], noise[1]), (0.0, 0.0), (v, 0.0)))
    plane = Response(PLANE, TONE_MEMORY_S, least, own)
    assert feed(poses, plane)[-1].own == pytest.approx(alarm, rel=1e-3)


def test_the_high_pass_takes_out_a_constant_acceleration() -> None:
    passes, y = HighPass(3), 0.0
    for n in range(400):
        t = n * DT_S
        (y,) = passes.step([0.5 * 5.0 * ((t + DT_S) ** 2 - t * t)], DT_S)
    assert abs(y) < 0.002  # the ramp within a step is not told


@pytest.mark.parametrize("late_s", [0.0, 0.03, 0.1, 0.2, 0.3, 0.4])
def test_turns_that_come_late_are_told_by_how_much(late_s: float) -> None:
    monitor, draw = LatenessMonitor(), random.Random(3)
    for n in range(300):
        t = n * DT_S
        x, y = swing(t - late_s, 0.01)
        seen = (x + draw.gauss(0.0, 0.002), y + draw.gauss(0.0, 0.002))
        monitor.add(t, seen, swing(t, 0.01), DT_S)
    assert monitor.late_s == pytest.approx(late_s if late_s >= 0.1 else 0.0)


def test_a_still_vehicle_is_not_late() -> None:
    monitor, draw = LatenessMonitor(), random.Random(4)
    for n in range(300):
        noise = (draw.gauss(0.0, LEAST_TURN_RAD), draw.gauss(0.0, LEAST_TURN_RAD))
        monitor.add(n * DT_S, noise, (0.0, 0.0), DT_S)
    assert monitor.late_s == 0.0


def test_windows_that_became_too_short_say_nothing_any_more() -> None:
    plane, tones = new_plane(), [swing(n * DT_S) for n in range(300)]
    mirrored: list[Seen] = [((-u, -v), (u, v), (0.0, 0.0)) for u, v in tones]
    alarm = feed(mirrored, plane)[-1]
    assert alarm.tones >= 1.0
    for _ in range(60):  # blocks without time
        plane.add((0.0, 0.0), (0.0, 0.0), (0.0, 0.0), 1e-4)
        alarm = plane.look(NOISE_M)
    assert alarm == Alarm(0.0, 0.0, False)


def test_tones_that_have_ended_convict_nobody_by_the_scatter_of_a_calmer_time() -> None:
    draw = random.Random(3)

    def poses() -> Iterator[Seen]:
        for n in range(round(4.0 / DT_S)):
            time_s = n * DT_S
            tones = swing(time_s) if time_s < 1.0 else (0.0, 0.0)
            gust = 0.003 * math.sin(20.0 * time_s) if 0.7 < time_s < 1.0 else 0.0  # a push ends
            noise = draw.gauss(0.0, NOISE_M), draw.gauss(0.0, NOISE_M)
            yield (gust + noise[0], noise[1]), tones, (0.0, 0.0)

    after_s = 1.7
    assert max(alarm.tones for alarm in feed(poses())[round(after_s / BLOCK_S) :]) == 0.0


def test_tones_that_have_just_begun_convict_nobody_by_the_scatter_of_a_calmer_time() -> None:
    """New wind makes the poses suspect, and so begins the tones: in that instant it may undo them.
    A pose that stands is accused within half a second all the same.
    """
    draw, begun_s = random.Random(4), 2.0

    def poses() -> Iterator[Seen]:
        for n in range(round((begun_s + 0.5) / DT_S)):
            since_s = n * DT_S - begun_s
            u, v = swing(since_s, 0.006 * min(since_s / FADE_IN_S, 1.0)) if since_s > 0.0 else ZERO
            noise = draw.gauss(0.0, NOISE_M), draw.gauss(0.0, NOISE_M)
            yield (noise[0] - u, noise[1] - v), (u, v), ZERO

    alarms = [alarm.tones for alarm in feed(poses())]
    begun = round(begun_s / BLOCK_S)
    assert max(alarms[: begun + round(0.2 / BLOCK_S)]) < 0.5
    assert alarms[-1] >= 1.0
