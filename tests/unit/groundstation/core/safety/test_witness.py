"""The second witness: what it says of true poses, and of poses that lie (tests/witness_scenes.py)."""

import math
import random
import re
from dataclasses import replace
from itertools import pairwise

import pytest

from groundstation.core.geometry import Quat, Vec3, so3
from groundstation.core.messages import Pose
from groundstation.core.safety import Agreement, Witness
from groundstation.core.safety.witness import LASTS_S, REPEATS_S, SILENT_S
from tests.witness_scenes import ARMED_S, ZERO, Lie, Motion, Scene, doubted_s, heard, largest, warned

STRUCK_S = 14.0
IN_S = 0.4
"""So soon after the vehicle has moved it must doubt."""
SEEN_LEAN_DEG = 3.0
FAST, QUICK = Motion((25.0, 25.0, 40.0), (1.1, 0.9, 0.7)), Motion((6.0, 6.0, 10.0), (3.0, 2.5, 1.0))
CALM = Motion((0.5, 0.5, 1.0))
MOTIONS = pytest.mark.parametrize("motion", [Motion(), FAST, QUICK, CALM], ids=["flown", "fast", "quick", "calm"])

TRUE: dict[str, Scene] = {
    "as it is": Scene(),
    "a body mounted askew": Scene(askew_deg=(4.0, -4.0, 14.0)),
    "a noisy tracker": Scene(noise_deg=0.7),
    "a slow tracker": Scene(pose_hz=25.0),
    "clocks apart": Scene(clocks_apart_s=0.1),
    "clocks apart the other way": Scene(clocks_apart_s=-0.1),
    "telemetry that jitters": Scene(told_jitter_s=0.1),
    "telemetry that jitters without stamps": Scene(told_jitter_s=0.09, stamped=False),
    "late telemetry without stamps": Scene(told_late_s=0.09, stamped=False),
    "a slow telemetry radio": Scene(told_hz=12.5, told_late_s=0.1, told_jitter_s=0.1),
    "a radio": Scene(told_hz=10.0, told_late_s=0.03, told_jitter_s=0.025, stamped=False, gyros=False),
    "half the telemetry lost": Scene(told_loss=0.5),
    "an estimator that wanders": Scene(slow_error_deg=2.0),
    "an estimator that is pulled upright": Scene(pulled_upright=0.2),
    "gyros that feel the rotors": Scene(vibration_deg_s=15.0),
    "a heading that is reset": Scene(resets=((13.5, 19.0), (15.0, -90.0), (16.0, 3.0))),
    "a tracker that drops out": Scene(dropouts=((13.0, 13.1), (14.0, 14.3), (16.0, 16.8))),
}


@pytest.mark.parametrize("scene", TRUE.values(), ids=TRUE)
@MOTIONS
def test_it_does_not_doubt_poses_that_are_true(scene: Scene, motion: Motion) -> None:
    assert largest(replace(scene, motion=motion)) < 0.9


def held_from(motion: Motion, flicker_rad: float) -> Lie:
    """For ever what was seen as it was struck, but not bit for bit."""
    rng = random.Random(5)

    def lie(_time_s: float, _attitude: Quat) -> Quat:
        x, y, z = (rng.gauss(0.0, flicker_rad) for _ in range(3))
        return so3.rotate(motion.attitude(STRUCK_S), (x, y, z))

    return lie


def carried(time_s: float, _attitude: Quat) -> Quat:
    """Somebody walks by with the other body."""
    return Motion((20.0, 15.0, 60.0), (0.8, 0.6, 0.3)).attitude(time_s)


def resting(_time_s: float, _attitude: Quat) -> Quat:
    return so3.from_euler_zyx(0.01, -0.01, 2.0)


def flipped(roll: float, pitch: float, yaw: float) -> Lie:
    def lie(_time_s: float, attitude: Quat) -> Quat:
        a, b, c = so3.euler_zyx(attitude)
        return so3.from_euler_zyx(roll * a, pitch * b, yaw * c)

    return lie


def body_turned(yaw_deg: float) -> Lie:
    return lambda _time_s, attitude: so3.multiply(attitude, so3.from_euler_zyx(0.0, 0.0, math.radians(yaw_deg)))


def yaw_turning(time_s: float, attitude: Quat) -> Quat:
    return so3.multiply(attitude, so3.from_euler_zyx(0.0, 0.0, math.radians(25.0) * (time_s - STRUCK_S)))


STRIKES: dict[str, Lie] = {
    "frozen with flicker": held_from(Motion(), 1e-9),
    "frozen with noise": held_from(Motion(), 2e-3),
    "another body, resting": resting,
    "another body, carried": carried,
    "roll mirrored": flipped(-1.0, 1.0, 1.0),
    "pitch mirrored": flipped(1.0, -1.0, 1.0),
}


@pytest.mark.parametrize("lie", STRIKES.values(), ids=STRIKES)
def test_poses_that_begin_to_lie_in_flight_are_doubted_at_once(lie: Lie) -> None:
    doubted = doubted_s(Scene(lies=((STRUCK_S, lie),)))
    assert doubted is not None
    assert STRUCK_S < doubted < STRUCK_S + IN_S


def test_a_few_attitudes_a_second_are_enough() -> None:
    doubted = doubted_s(Scene(told_hz=12.5, told_late_s=0.05, lies=((STRUCK_S, resting),)))
    assert doubted is not None
    assert STRUCK_S < doubted < STRUCK_S + IN_S


def test_a_heading_that_turns_by_itself_is_doubted() -> None:
    doubted = doubted_s(Scene(lies=((STRUCK_S, yaw_turning),)))
    assert doubted is not None
    assert STRUCK_S < doubted < STRUCK_S + 2.0 * IN_S


AXES: dict[str, Lie] = {
    "yaw 90° off": body_turned(90.0),
    "yaw -90° off": body_turned(-90.0),
    "yaw 180° off": body_turned(180.0),
    "roll mirrored": flipped(-1.0, 1.0, 1.0),
    "pitch mirrored": flipped(1.0, -1.0, 1.0),
    "all mirrored": flipped(-1.0, -1.0, -1.0),
}


@pytest.mark.parametrize("lie", AXES.values(), ids=AXES)
@pytest.mark.parametrize("motion", [Motion(), Motion((9.0, 8.0, 0.0), (0.12, 0.1, 0.1)), FAST], ids=str)
def test_axes_that_were_never_right_are_doubted_as_soon_as_the_vehicle_leans(lie: Lie, motion: Motion) -> None:
    doubted = doubted_s(Scene(motion=motion, lies=((0.0, lie),)))
    assert doubted is not None
    rolls, pitches = lie is not AXES["pitch mirrored"], lie is not AXES["roll mirrored"]
    leans_s = next(
        0.01 * n
        for n in range(2000)
        if math.hypot(*(angle for angle, so in zip(motion.angles(0.01 * n), (rolls, pitches), strict=False) if so))
        > math.radians(SEEN_LEAN_DEG)
    )
    assert leans_s - 1.0 < doubted < leans_s + IN_S


@pytest.mark.parametrize("late_s", [0.3, 0.4])
@pytest.mark.parametrize("motion", [Motion(), FAST], ids=["flown", "fast"])
def test_poses_much_older_than_they_say_are_doubted_as_it_begins_to_swing(motion: Motion, late_s: float) -> None:
    lies = ((0.0, lambda time_s, _attitude: motion.attitude(time_s - late_s)),)
    doubted = doubted_s(Scene(motion=motion, lies=lies))
    assert doubted is not None
    assert doubted < ARMED_S + 1.0 + IN_S


def test_what_moves_neither_tilts_nor_turns_it_can_not_see() -> None:
    straight_up = Motion(ZERO)
    assert largest(Scene(motion=straight_up, lies=((0.0, resting),))) < 0.9


def askew_from(begin_s: float, end_s: float) -> Lie:
    """From then to then [s] the tracked body leans by 13° more."""
    by = so3.from_euler_zyx(math.radians(13.0), 0.0, 0.0)
    return lambda time_s, attitude: so3.multiply(attitude, by) if begin_s <= time_s < end_s else attitude


@pytest.mark.parametrize("radio", [False, True], ids=["mavlink", "crsf"])
def test_a_tilt_that_stays_apart_in_flight_is_told_once_and_again_only_after_a_long_agreement(radio: bool) -> None:
    wire = Scene(told_hz=10.0, told_late_s=0.03, stamped=False, gyros=False) if radio else Scene()
    ((when, says),) = warned(replace(wire, lies=((0.0, askew_from(STRUCK_S, 99.0)),)))
    assert STRUCK_S + LASTS_S < when < STRUCK_S + LASTS_S + 2.0 * IN_S
    by = re.search(r"the poses disagree by at least (\d+) degrees of tilt: land, and check", says)
    assert by is not None and 8 <= int(by[1]) <= 14
    for agrees_s, lines in ((1.0, 1), (REPEATS_S + 1.0, 2)):
        again = STRUCK_S + 4.0 + agrees_s
        lies = ((0.0, askew_from(STRUCK_S, STRUCK_S + 4.0)), (again, askew_from(again, 99.0)))
        assert len(warned(replace(wire, until_s=again + 4.0, lies=lies))) == lines


def test_a_tilt_that_is_apart_for_less_is_not_told() -> None:
    assert warned(Scene(lies=((0.0, askew_from(STRUCK_S, STRUCK_S + 0.8 * LASTS_S)),))) == []


def test_it_stops_doubting_poses_that_are_true_again() -> None:
    said = heard(Scene(lies=((STRUCK_S, resting), (16.0, lambda time_s, _: Motion().attitude(time_s)))))
    told = said[-1][1]
    assert told is not None
    assert told.doubts_s is None
    worst = max(told.share for when, told in said if told is not None and when < 16.0)
    assert worst > 2.0


def test_since_when_it_doubts_does_not_move_while_it_does() -> None:
    said = [told for when, told in heard(Scene(lies=((STRUCK_S, resting),))) if told is not None and when > 14.3]
    assert said[0].doubts_s is not None
    steps = [(a.doubts_s, b.doubts_s) for a, b in pairwise(said) if a.doubts_s is not None and b.doubts_s is not None]
    assert steps
    assert all(a == b or b > 14.3 for a, b in steps)


@pytest.mark.parametrize("silent", ["poses", "autopilot"])
def test_silence_is_no_witness(silent: str) -> None:
    witness = Witness()
    now = 0.0
    for now, what in Scene(until_s=8.0, lies=((3.0, carried),)).events():
        if isinstance(what, Pose):
            if now < 5.0 or silent != "poses":
                witness.pose(what)
        elif now < 5.0 or silent != "autopilot":
            witness.attitude(what)
        if now < 4.5 and now > 0.6:
            assert witness.verdict(now) is not None
    assert witness.verdict(5.0 + 1.2 * SILENT_S) is None
    assert witness.verdict(now) is None
    assert Witness().verdict(0.0) is None


def test_what_it_learns_before_arming_it_keeps() -> None:
    askew = (5.0, -3.0, 0.0)
    told = heard(Scene(motion=Motion(ZERO), askew_deg=askew, slow_error_deg=0.0))[-1][1]
    assert told is not None
    assert told.askew_deg == pytest.approx(math.hypot(5.0, 3.0), abs=0.1)
    assert told.tilt_deg < 0.6


def test_a_body_that_lies_far_off_is_not_learnt_as_one_mounted_askew() -> None:
    told = heard(Scene(motion=Motion(ZERO), askew_deg=(14.0, 0.0, 0.0), until_s=0.9 * ARMED_S))[-1][1]
    assert told is not None
    assert told.askew_deg == pytest.approx(14.0, abs=0.6)
    assert told.doubts_s is not None


def test_in_flight_only_a_slow_drift_of_the_tilts_is_followed_and_not_far() -> None:
    def drift(time_s: float, attitude: Quat) -> Quat:
        return so3.rotate(attitude, (math.radians(0.4) * (time_s - ARMED_S), 0.0, 0.0))

    doubted = doubted_s(Scene(motion=CALM, slow_error_deg=0.0, until_s=40.0, lies=((ARMED_S, drift),)))
    assert doubted is not None
    assert 15.0 < doubted < ARMED_S + (3.0 + 2.0 + 0.6) / 0.4


def moved_by_hand(lie: Lie | None = None) -> Agreement:
    """It is rolled, pitched and turned before arming, and stands again."""
    by_hand = Motion((25.0, 20.0, 40.0), (0.4, 0.3, 0.25))
    scene = Scene(motion=by_hand, until_s=19.0, lies=() if lie is None else ((0.0, lie),))
    told = heard(scene, armed_s=math.inf)[-1][1]
    assert told is not None
    return told


def test_a_vehicle_that_is_moved_by_hand_shows_which_way_its_axes_go() -> None:
    told = moved_by_hand()
    assert set(told.alike) == {"roll", "pitch", "yaw"}
    assert told.unlike == ()


@pytest.mark.parametrize(
    ("lie", "unlike"),
    [
        (flipped(-1.0, 1.0, 1.0), {"roll"}),
        (flipped(1.0, -1.0, 1.0), {"pitch"}),
        (flipped(1.0, 1.0, -1.0), {"yaw"}),
        (body_turned(180.0), {"roll", "pitch"}),
        (body_turned(90.0), {"roll"}),
        (resting, {"roll", "pitch", "yaw"}),
    ],
    ids=["roll", "pitch", "yaw", "180°", "90°", "another body"],
)
def test_axes_that_go_another_way_by_hand_are_named(lie: Lie, unlike: set[str]) -> None:
    assert set(moved_by_hand(lie).unlike) == unlike


def test_messages_and_poses_that_are_not_newer_are_ignored() -> None:
    plain, doubled = Witness(), Witness()
    events = list(Scene(until_s=15.0).events())
    for n, (_, what) in enumerate(events):
        for witness in (plain, doubled):
            witness.pose(what) if isinstance(what, Pose) else witness.attitude(what)
        for _, old in events[max(n - 3, 0) : n]:
            doubled.pose(old) if isinstance(old, Pose) else doubled.attitude(old)
    now = events[-1][0]
    assert plain.verdict(now) == doubled.verdict(now) is not None


def test_poses_of_a_source_that_moved_its_heading_go_on_from_there() -> None:
    witness, shares = Witness(), list[float]()
    for now, what in Scene().events():
        if isinstance(what, Pose):
            turned: Vec3 = (0.0, 0.0, math.radians(19.0) if what.time_s > STRUCK_S else 0.0)
            attitude = so3.multiply(so3.from_euler_zyx(*turned), what.attitude)
            witness.pose(
                Pose(what.id, what.time_s, now, ZERO, attitude, reset_count=int(what.time_s > STRUCK_S))
            )  # fmt: skip
        else:
            witness.attitude(what)
        told = witness.verdict(now)
        shares += [told.share] if told is not None else []
    assert max(shares) < 0.9
