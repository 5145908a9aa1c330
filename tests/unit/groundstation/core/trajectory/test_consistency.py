"""What a trajectory declares is held against its positions."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import msgspec
import pytest

from groundstation.config import from_dict
from groundstation.core.geometry import Vec3
from groundstation.core.trajectory import FeasibilityReport, Reference, check_feasibility
from groundstation.core.vehicle import LimitsConfig, Vehicle
from groundstation.flight.preflight import describe_trajectory, examine_trajectory, explain_fence, explain_refusal
from groundstation.settings import Config

RADIUS_M = 2.0
ZERO: Vec3 = (0.0, 0.0, 0.0)


class Curve:
    """A circle at a speed, of which something is changed."""

    duration_s: float | None = None

    def __init__(self, change: Callable[[Reference, float], Reference], speed_m_s: float = 1.5) -> None:
        self._change = change
        self._rad_s = speed_m_s / RADIUS_M
        self.joints_s: Sequence[float] = (0.0, math.tau / self._rad_s)

    def at(self, time_s: float) -> Reference:
        w = self._rad_s
        c, s = RADIUS_M * math.cos(w * time_s), RADIUS_M * math.sin(w * time_s)
        exact = Reference(
            (c, s, -1.5), (-w * s, w * c, 0.0), (-w * w * c, -w * w * s, 0.0), (w**3 * s, -(w**3) * c, 0.0),
            yaw_rad=w * time_s, yaw_rate_rad_s=w,
        )  # fmt: skip
        return self._change(exact, time_s)

    def position_at(self, time_s: float) -> Vec3:
        return self.at(time_s).position_ned


def replace(**changes: Any) -> Callable[[Reference, float], Reference]:
    return lambda exact, time_s: msgspec.structs.replace(exact, **changes)


def scaled(name: str, share: float) -> Callable[[Reference, float], Reference]:
    def change(exact: Reference, time_s: float) -> Reference:
        x, y, z = getattr(exact, name)
        return msgspec.structs.replace(exact, **{name: (share * x, share * y, share * z)})

    return change


def report(curve: Curve) -> FeasibilityReport:
    return check_feasibility(curve, Vehicle(), LimitsConfig(), gravity=9.81, floor_z_m=1.0)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (replace(velocity_ned=ZERO), "velocity"),
        (scaled("velocity_ned", 0.8), "velocity"),
        (scaled("velocity_ned", -1.0), "velocity"),
        (replace(acceleration_ned=ZERO), "acceleration"),
        (scaled("acceleration_ned", 2.0), "acceleration"),
        (replace(yaw_rate_rad_s=0.0), "yaw rate"),
        (lambda exact, t: msgspec.structs.replace(exact, velocity_ned=ZERO) if 3.0 < t < 3.5 else exact, "velocity"),
    ],
    ids=["at rest", "too slow", "backwards", "no acceleration", "twice", "no turn", "for half a second"],
)
def test_derivatives_that_positions_do_not_have_are_found(
    change: Callable[[Reference, float], Reference], name: str
) -> None:
    odd = report(Curve(change)).inconsistency
    assert odd is not None and odd.name == name
    assert not report(Curve(change)).ok


@pytest.mark.parametrize("speed_m_s", [0.2, 1.5, 6.0])
def test_exact_derivatives_are_found_to_be_so(speed_m_s: float) -> None:
    assert report(Curve(lambda exact, t: exact, speed_m_s)).inconsistency is None


@pytest.mark.parametrize(
    ("changes", "begins_s", "name", "within_s"),
    [
        (lambda exact: {"velocity_ned": ZERO}, 40.0, "velocity", 0.4),  # a later turn
        (lambda exact: {"yaw_rad": exact.yaw_rad + 1.5}, 4.0, "yaw rate", 0.02),
    ],
    ids=["at rest", "a heading that jumps"],
)
def test_what_begins_later_and_is_not_what_it_declares_is_found(
    changes: Callable[[Reference], dict[str, Any]], begins_s: float, name: str, within_s: float
) -> None:
    def later(exact: Reference, t: float) -> Reference:
        return msgspec.structs.replace(exact, **changes(exact)) if t > begins_s else exact

    odd = report(Curve(later)).inconsistency
    assert odd is not None
    assert (odd.name, odd.of) == (name, "yaw" if name == "yaw rate" else "position")
    assert odd.time_s == pytest.approx(begins_s, abs=within_s)


def test_what_never_ends_and_turns_in_more_than_a_minute_is_looked_at_beyond_it() -> None:
    def away(exact: Reference, t: float) -> Reference:
        return msgspec.structs.replace(exact, position_ned=(5.0, 0.0, -1.5)) if t > 75.1 else exact

    slow = Curve(away, 0.25)
    slow.joints_s = (0.0, 60.0)
    odd = report(slow).inconsistency
    assert odd is not None
    assert odd.name == "period"
    assert odd.time_s == pytest.approx(75.0, abs=0.4)


def test_a_fast_circle_at_rest_by_its_own_word_is_told_with_both_speeds() -> None:
    config = from_dict({"trajectory": {"kind": f"{__name__}:lie"}}, Config)
    told = explain_refusal(config, examine_trajectory(config))
    assert told is not None
    assert "its velocity is declared as 0 m/s, and by its position is 15 m/s" in told.text


def backwards(options: dict[str, Any]) -> Curve:
    return Curve(scaled("velocity_ned", -1.0))


def lie(options: dict[str, Any]) -> Curve:
    return Curve(replace(velocity_ned=ZERO, acceleration_ned=ZERO, jerk_ned=ZERO), 15.0)


@pytest.mark.parametrize(
    "trajectory",
    [
        {"kind": "lemniscate"},
        {"kind": "lemniscate", "ramp_s": 2.0, "laps": 3},
        {"kind": "circle"},
        {"kind": "hold"},
        {"kind": "excitation"},
        {"kind": "waypoints", "points_ned": [[0, 0, -1], [1, 0, -1], [1, 1, -1.5], [0, 0, -1]]},
        {"kind": "waypoints", "points_ned": [[0, 0, -1], [1, 0, -1]], "times_s": [0, 4]},
    ],
)
def test_every_kind_that_comes_along_is_what_it_declares(trajectory: dict[str, Any]) -> None:
    config = from_dict({"trajectory": trajectory}, Config)
    assert examine_trajectory(config).inconsistency is None


def test_the_fence_counts_too() -> None:
    box = {"kind": "box", "north_m": [-3.0, 3.0], "east_m": [-3.0, 3.0], "height_m": 4.0}
    for half_m, fits in ((3.0, True), (1.0, False)):
        box |= {"north_m": [-half_m, half_m], "east_m": [-half_m, half_m]}
        config = from_dict({"trajectory": {"kind": "circle"}, "fence": box}, Config)
        told = explain_fence(config)
        assert (told is None) == fits
        assert fits or "could not brake within the fence" in str(told)
        assert ("PASS" in describe_trajectory(config, examine_trajectory(config))) == fits


def test_a_corner_that_is_flown_at_full_speed_is_found() -> None:
    def corner(exact: Reference, t: float) -> Reference:
        """Straight ahead, and from one moment on to the side: no acceleration is declared anywhere."""
        ahead, aside = 0.5 * min(t, 4.0), 0.5 * max(t - 4.0, 0.0)
        return Reference((ahead, aside, -1.5), (0.5, 0.0, 0.0) if t < 4.0 else (0.0, 0.5, 0.0))

    curve = Curve(corner)
    curve.duration_s = curve.joints_s[-1]  # a stop at its end is no corner: it is held there
    odd = report(curve).inconsistency
    assert odd is not None
    assert (odd.name, odd.declared, odd.of) == ("acceleration", 0.0, "velocity")
    assert odd.time_s == pytest.approx(4.0, abs=0.02)
    straight = Curve(lambda exact, t: Reference((0.5 * t, 0.0, -1.5), (0.5, 0.0, 0.0)))
    straight.duration_s = straight.joints_s[-1]
    assert report(straight).inconsistency is None
