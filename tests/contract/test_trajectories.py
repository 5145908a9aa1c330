"""What every trajectory must keep, by table; then what is particular to some."""

import math
from fractions import Fraction

import msgspec
import numpy as np
import pytest
from hypothesis import assume, example, given, strategies as st

from groundstation.core.geometry import Vec3
from groundstation.core.trajectory import (
    ExcitationConfig,
    LemniscateConfig,
    OwnTrajectoryConfig,
    Reference,
    Trajectory,
    TrajectoryConfig,
)
from groundstation.core.trajectory.shapes import (
    CircleConfig,
    HoldConfig,
    Laps,
    SamplesConfig,
    WaypointsConfig,
)

POINTS = ((0.0, 0.0, -1.0), (2.0, 0.5, -1.0), (2.0, 3.0, -2.0), (-1.0, 2.0, -1.5), (0.0, 0.0, -1.0))
SAMPLED_S = tuple(5.0 + 0.4 * i for i in range(16))
SAMPLED = tuple((math.sin(t), math.cos(0.7 * t), -1.0 - 0.1 * t) for t in SAMPLED_S)
TABLE: dict[str, TrajectoryConfig] = {
    "hold": HoldConfig(position_ned=(1.0, -2.0, -1.5), yaw_deg=30.0),
    "lemniscate of the paper": LemniscateConfig(),
    "large lemniscate, fast": LemniscateConfig(
        scale_m=3.0,
        speed_m_s=2.5,
        altitude_m=2.0,
        rotation_deg=20.0,
        centre_ned=(1.0, -4.0, 0.5),
        yaw_deg=-90.0,
    ),
    "circle": CircleConfig(),
    "circle the other way": CircleConfig(
        radius_m=2.0,
        speed_m_s=3.0,
        altitude_m=1.5,
        start_deg=130.0,
        centre_ned=(0.5, 3.0, -0.2),
        clockwise=False,
    ),
    "straight way held by its speed": WaypointsConfig(
        points_ned=((0.0, 0.0, -1.0), (3.0, -4.0, -2.0))
    ),
    "straight way held by its acceleration": WaypointsConfig(
        points_ned=((0.0, 0.0, -1.0), (0.2, 0.1, -1.1)),
        max_speed_m_s=5.0,
        max_acceleration_m_s2=2.0,
    ),
    "lemniscate with a ramp": LemniscateConfig(ramp_s=3.0, tilt_deg=-30.0, uphill_deg=70.0),
    "two laps of a lemniscate": LemniscateConfig(laps=2, ramp_s=2.0, yaw_deg=20.0),
    "upright circle, one lap with hardly any full speed": CircleConfig(
        radius_m=0.8,
        speed_m_s=1.0,
        altitude_m=2.0,
        laps=1,
        ramp_s=5.0,
        tilt_deg=90.0,
        uphill_deg=-120.0,
    ),
    "waypoints": WaypointsConfig(points_ned=POINTS, max_speed_m_s=1.5, max_acceleration_m_s2=2.0),
    "waypoints, quintic, turning": WaypointsConfig(
        points_ned=POINTS, yaws_deg=(0.0, 90.0, 170.0, -170.0, 0.0), method="quintic"
    ),
    "waypoints, given times, laps": WaypointsConfig(
        points_ned=POINTS, times_s=(10.0, 12.0, 15.5, 19.0, 22.0), laps=2, yaw_deg=-45.0
    ),
    "samples": SamplesConfig(times_s=SAMPLED_S, points_ned=SAMPLED),
    "excitation": ExcitationConfig(highest_hz=1.0, laps=2, yaw_deg=30.0),
    "samples with velocities, from rest": SamplesConfig(
        times_s=SAMPLED_S,
        points_ned=SAMPLED,
        velocities_ned=tuple((math.cos(t), -0.7 * math.sin(0.7 * t), -0.1) for t in SAMPLED_S),
        yaws_deg=tuple(10.0 * t for t in SAMPLED_S),
        ramp_s=1.5,
    ),
}
every = pytest.mark.parametrize("config", TABLE.values(), ids=TABLE.keys())
ENDLESS = {
    name: c
    for name, c in TABLE.items()
    if isinstance(c, LemniscateConfig | CircleConfig) and not (c.ramp_s or c.laps)
}
endless = pytest.mark.parametrize("config", ENDLESS.values(), ids=ENDLESS.keys())

STEP_S = 2.0**-6
"""A power of two: with times in whole 2^-20 s, up to 1e5 s, all differences of times are exact."""
WEIGHTS = (4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0)
"""The central first difference of order 8."""
times = st.integers(0, int(1e5) << 20).map(lambda n: n / 2**20)
early = st.integers(0, 20 << 20).map(lambda n: n / 2**20)


def vectors(reference: Reference) -> tuple[Vec3, Vec3, Vec3, Vec3]:
    motion = reference.position_ned, reference.velocity_ned
    return *motion, reference.acceleration_ned, reference.jerk_ned


def differences(trajectory: Trajectory, time_s: float) -> list[Vec3]:
    """Differences in time of position, velocity and acceleration."""
    slopes = [[0.0, 0.0, 0.0] for _ in range(3)]
    for k, weight in enumerate(WEIGHTS, start=1):
        later = vectors(trajectory.at(time_s + k * STEP_S))
        before = vectors(trajectory.at(time_s - k * STEP_S))
        for order in range(3):
            for axis in range(3):
                slopes[order][axis] += weight * (later[order][axis] - before[order][axis]) / STEP_S
    return [(x, y, z) for x, y, z in slopes]


@every
@given(time_s=st.one_of(times, early))
def test_each_derivative_is_the_difference_of_the_one_before(
    config: TrajectoryConfig, time_s: float
) -> None:
    trajectory = config.build()
    if trajectory.duration_s is not None or (isinstance(config, Laps) and config.ramp_s):
        # From the fourth on derivatives may jump there: differences may not reach across, but where
        # all is smooth.
        assume(all(abs(time_s - joint) > 4 * STEP_S for joint in trajectory.joints_s))
    exact = vectors(trajectory.at(time_s))[1:]
    turned = sum(
        weight
        * (trajectory.at(time_s + k * STEP_S).yaw_rad - trajectory.at(time_s - k * STEP_S).yaw_rad)
        / STEP_S
        for k, weight in enumerate(WEIGHTS, start=1)
    )
    assert trajectory.at(time_s).yaw_rate_rad_s == pytest.approx(turned, abs=1e-9)
    for got, expected in zip(differences(trajectory, time_s), exact, strict=True):
        # Rounding of positions within 10 m over the step, and the ninth derivative of the fastest
        # curve.
        assert math.dist(got, expected) < 1e-8


@every
@given(time_s=st.floats(-1e5, 1e5))
@example(time_s=0.0)
@example(time_s=-1.0)
@example(time_s=1e5)
def test_every_time_has_a_finite_reference_and_position_at_agrees(
    config: TrajectoryConfig, time_s: float
) -> None:
    trajectory = config.build()
    reference = trajectory.at(time_s)
    assert all(math.isfinite(x) for vector in vectors(reference) for x in vector)
    assert math.dist(trajectory.position_at(time_s), reference.position_ned) < 1e-14
    turns = isinstance(config, WaypointsConfig | SamplesConfig) and config.yaws_deg is not None
    if not turns and not isinstance(config, ExcitationConfig | OwnTrajectoryConfig):
        assert reference.yaw_rad == math.radians(config.yaw_deg)
        assert reference.yaw_rate_rad_s == 0.0


@every
def test_nothing_jumps_where_the_curve_closes_starts_or_ends(config: TrajectoryConfig) -> None:
    trajectory = config.build()
    places = list(trajectory.joints_s)
    if isinstance(config, LemniscateConfig | CircleConfig):
        # Half a period is where whole periods are taken off the time.
        period_s = config.build().period_s
        places += [period_s / 2, period_s, 3 * period_s / 2]
    for joint in places:
        before, after = trajectory.at(joint - 1e-9), trajectory.at(joint + 1e-9)
        assert after.yaw_rad == pytest.approx(before.yaw_rad, abs=1e-6)
        at_end = joint in (0.0, trajectory.duration_s)
        smooth = 4
        if at_end and config == TABLE["samples"]:
            smooth = 1  # samples without a ramp begin and end as they do
        elif at_end and is_quintic(config):
            smooth = 3  # quintics let jerk step there
        for a, b in list(zip(vectors(before), vectors(after), strict=True))[:smooth]:
            assert math.dist(a, b) < 1e-6


def is_quintic(config: TrajectoryConfig) -> bool:
    return isinstance(config, WaypointsConfig) and config.method == "quintic"


@every
def test_everything_has_happened_by_its_last_joint(config: TrajectoryConfig) -> None:
    trajectory = config.build()
    assert trajectory.joints_s[0] == 0.0
    assert list(trajectory.joints_s) == sorted(trajectory.joints_s)
    if trajectory.duration_s is not None:
        assert trajectory.joints_s[-1] == trajectory.duration_s
        end = trajectory.at(trajectory.duration_s)
        assert vectors(end)[1:] == ((0.0, 0.0, 0.0),) * 3
    elif isinstance(config, Laps):
        last, turn_s = trajectory.joints_s[-1], config.build().period_s
        later = vectors(trajectory.at(last + 0.1))
        for a, b in zip(later, vectors(trajectory.at(last + 0.1 - turn_s)), strict=True):
            assert math.dist(a, b) < 1e-9


@every
def test_the_config_file_builds_the_same_trajectory(config: TrajectoryConfig) -> None:
    written = msgspec.to_builtins(config)
    assert msgspec.convert(written, TrajectoryConfig) == config


def speed(trajectory: Trajectory, time_s: float) -> float:
    return math.hypot(*trajectory.at(time_s).velocity_ned)


@endless
@given(time_s=times)
def test_the_speed_is_constant_and_the_height_too(
    config: LemniscateConfig | CircleConfig, time_s: float
) -> None:
    trajectory = config.build()
    assert speed(trajectory, time_s) == pytest.approx(config.speed_m_s, rel=1e-14)
    assert trajectory.at(time_s).position_ned[2] == config.centre_ned[2] - config.altitude_m


@endless
@given(time_s=times, turns=st.integers(1, 20))
def test_the_curve_closes_after_its_period(
    config: LemniscateConfig | CircleConfig, time_s: float, turns: int
) -> None:
    trajectory = config.build()
    again = trajectory.at(time_s + turns * trajectory.period_s)
    for a, b in zip(vectors(again), vectors(trajectory.at(time_s)), strict=True):
        # The sum of times is rounded: 1.5e-11 s at 1e5 s, at a few m/s and m/s².
        assert math.dist(a, b) < 1e-9
    assert trajectory.duration_s is None


VARPI = Fraction("2.62205755429211981046483958989111941368275495143162")
"""The lemniscate constant; the period is 2 ϖ scale / V."""


def amplitude(u: float) -> float:
    """am(u | m = -1) by its Fourier series, whose nome is -exp(-π) (DLMF 22.11, 22.16.9)."""
    q = -math.exp(-math.pi)
    x = math.pi * u / float(VARPI)
    return x + sum(
        2.0 * q**n / (n * (1.0 + q ** (2 * n))) * math.sin(2 * n * x) for n in range(1, 14)
    )


def lemniscate_point(phi: float) -> tuple[float, float]:
    """The formula of the paper, turned by -45°."""
    x = math.sin(phi) * math.cos(phi) / (1.0 + math.sin(phi) ** 2)
    y = math.cos(phi) / (1.0 + math.sin(phi) ** 2)
    half = math.sqrt(0.5)
    return half * (x + y), half * (y - x)


@given(time_s=times)
def test_the_lemniscate_is_the_formula_of_the_paper_to_rounding(time_s: float) -> None:
    trajectory = LemniscateConfig().build()
    # The time is reduced here in exact fractions, by a constant of 50 digits.
    reduced = Fraction(time_s) % (2 * VARPI / Fraction(1, 2))
    north, east = lemniscate_point(amplitude(0.5 * float(reduced)))
    # The period as a double is off by half a unit in its last place, once a turn: 1e-16 of the way
    # flown.
    tolerance = 2e-15 + 1.2e-16 * 0.5 * time_s
    assert math.dist(trajectory.position_at(time_s), (north, east, -1.0)) < tolerance


coordinate = st.floats(-100.0, 100.0)
point = st.tuples(coordinate, coordinate, coordinate)


@given(
    start=point, end=point, max_speed=st.floats(0.05, 20.0), max_acceleration=st.floats(0.05, 20.0)
)
def test_a_straight_way_keeps_both_limits_and_reaches_one_of_them(
    start: Vec3, end: Vec3, max_speed: float, max_acceleration: float
) -> None:
    assume(math.dist(start, end) > 1e-3)
    way = WaypointsConfig(
        points_ned=(start, end), max_speed_m_s=max_speed, max_acceleration_m_s2=max_acceleration
    ).build()
    fractions = [i / 200 for i in range(201)]
    hardest = max(math.hypot(*way.at(x * way.duration_s).acceleration_ned) for x in fractions)
    fastest = max(speed(way, x * way.duration_s) for x in fractions)
    assert 0.995 < max(fastest / max_speed, hardest / max_acceleration) <= 1.0


@given(start=point, end=point)
def test_a_straight_way_rests_at_both_ends(start: Vec3, end: Vec3) -> None:
    assume(math.dist(start, end) > 1e-3)
    way = WaypointsConfig(points_ned=(start, end)).build()
    for where, times_s in ((start, (-1.0, 0.0)), (end, (way.duration_s, way.duration_s + 1.0))):
        for time_s in times_s:
            place, *motion = vectors(way.at(time_s))
            assert math.dist(place, where) < 1e-9
            assert max(math.hypot(*one) for one in motion) < 1e-9


TWO = [[0, 0, -1], [1, 0, -1]]


@pytest.mark.parametrize(
    ("kind", "settings", "words"),
    [
        ("spiral", {}, "spiral"),
        ("lemniscate", {"scale_m": 0.0}, ">= 0.001"),
        ("lemniscate", {"speed_m_s": math.nan}, ">= 0.001"),
        ("circle", {"radius_m": math.inf}, "<= 100.0"),
        ("hold", {"position_ned": [0.0, 0.0]}, "length 3"),
        ("hold", {"position_ned": [0.0, math.nan, 0.0]}, ">= -100.0"),
        ("samples", {"times_s": [0.0, 1.0]}, "points_ned"),
        ("circle", {"radius": 1.0}, "unknown field `radius`"),
        ("circle", {"laps": 2}, "laps: needs ramp_s above 0"),
        ("lemniscate", {"laps": 1, "ramp_s": 11.0}, "ramp_s: expected at most 10.5 s"),
        ("lemniscate", {"ramp_s": 1e-300}, "ramp_s: expected 0 or at least 0.001 s, got 1e-300"),
        ("circle", {"tilt_deg": 91.0}, "<= 90.0"),
        ("waypoints", {"points_ned": TWO[:1]}, "length >= 2"),
        ("waypoints", {"points_ned": [TWO[0], TWO[0]]}, r"points_ned\[1\]: the same as the one"),
        ("waypoints", {"points_ned": TWO, "laps": 2}, "last point must be the first"),
        ("waypoints", {"points_ned": TWO, "times_s": [0]}, "times_s: expected one for each"),
        ("waypoints", {"points_ned": TWO, "times_s": [3, 3]}, r"times_s\[1\]: expected at"),
        ("waypoints", {"points_ned": TWO, "yaws_deg": [3]}, "yaws_deg: expected one for"),
        ("samples", {"points_ned": TWO, "times_s": [0, 1], "ramp_s": 1.5}, "at most 1 s"),
        ("samples", {"points_ned": [], "times_s": [0, 1], "file": "a.csv"}, "only a configuration"),
    ],
)
def test_a_bad_setting_is_refused_in_words(
    kind: str, settings: dict[str, object], words: str
) -> None:
    with pytest.raises(msgspec.ValidationError, match=words):
        msgspec.convert({"kind": kind, **settings}, TrajectoryConfig)


def test_an_excitation_moves_each_axis_at_frequencies_of_its_own_and_equally_hard() -> None:
    config, count = ExcitationConfig(highest_hz=8.0), 2000
    trajectory = config.build()
    seen = [trajectory.at(config.period_s * (1.0 + i / count)) for i in range(count)]
    columns = np.array([[*one.acceleration_ned, one.yaw_rate_rad_s] for one in seen])
    spectra = 2.0 / count * np.abs(np.fft.rfft(columns, axis=0)).T
    multiples = [np.flatnonzero(axis > 1e-3) for axis in spectra]
    assert [one.tolist() for one in multiples] == [
        [8, 24, 40, 60, 76, 92, 108, 128, 144, 160],
        [9, 25, 41, 57, 73, 93, 109, 125, 141, 157],
        [10, 26, 42, 58, 74, 94, 110, 126, 142, 158],
        [11, 27, 43, 59, 75],
    ]
    for axis, own in zip(spectra, multiples, strict=True):
        assert axis[own] == pytest.approx(axis[own[0]])
    hardest = max(math.hypot(*one.acceleration_ned) for one in seen)
    assert hardest == pytest.approx(config.acceleration_m_s2, rel=0.01)
    swing_rad = max(abs(one.yaw_rad) for one in seen)
    assert math.degrees(swing_rad) == pytest.approx(config.yaw_swing_deg, rel=0.01)
