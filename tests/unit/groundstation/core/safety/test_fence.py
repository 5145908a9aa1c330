"""The fence: its sides, and the room that braking leaves."""

import msgspec
import pytest
from hypothesis import assume, given, strategies as st

from groundstation.config import from_dict
from groundstation.core.safety import Fence
from groundstation.core.safety.geofence import BoxFence, ConvexFence
from groundstation.settings import Config

BRAKES = {"height_m": 2.5, "braking_m_s2": 2.0, "reaction_s": 0.5}
BOX = BoxFence(north_m=(-2.0, 3.0), east_m=(-1.0, 1.5), **BRAKES)
CORNERS_M = ((3.0, 1.5), (3.0, -1.0), (-2.0, -1.0), (-2.0, 1.5))
SAME = ConvexFence(corners_m=CORNERS_M, **BRAKES)
FLOOR_Z_M = 1.0
places = st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0), st.floats(-5.0, 1.0))
speeds = st.tuples(st.floats(-4.0, 4.0), st.floats(-4.0, 4.0), st.floats(-4.0, 4.0))


@given(places, speeds)
def test_a_box_is_the_prism_over_its_corners(
    place: tuple[float, ...], speed: tuple[float, ...]
) -> None:
    box = Fence(BOX, FLOOR_Z_M)
    prism = Fence(ConvexFence(corners_m=CORNERS_M[::-1], **BRAKES), FLOOR_Z_M)
    (x, y, z), (u, v, w) = place, speed
    assert box.room_m((x, y, z)) == pytest.approx(prism.room_m((x, y, z)))
    left_m = prism.braking_room_m((x, y, z), (u, v, w))
    assert box.braking_room_m((x, y, z), (u, v, w)) == pytest.approx(left_m)
    inside = -2.0 < x < 3.0 and -1.0 < y < 1.5 and FLOOR_Z_M - z < 2.5
    assert (box.room_m((x, y, z)) > 0.0) == inside


def test_the_room_is_in_metres_to_the_nearest_side_and_the_floor_is_none() -> None:
    fence = Fence(BOX, FLOOR_Z_M)
    assert fence.room_m((2.0, 0.0, 0.0)) == pytest.approx(1.0)
    assert fence.room_m((0.0, 0.0, -1.2)) == pytest.approx(0.3)
    assert fence.room_m((0.0, 0.0, 1.0)) == pytest.approx(1.0)
    assert fence.room_m((0.0, 4.0, 0.0)) == pytest.approx(-2.5)


def test_a_vehicle_that_brakes_as_counted_on_stops_where_the_room_is_used_up() -> None:
    fence = Fence(BOX, FLOOR_Z_M)
    # 2 m/s for 0.5 s, then 2 m/s²: 1 m and 1 m.
    assert fence.braking_room_m((0.5, 0.0, 0.0), (2.0, 0.0, 0.0)) == pytest.approx(0.5)
    assert fence.braking_room_m((0.5, 0.25, 0.0), (0.0, 1.0, 0.0)) == pytest.approx(0.5)
    assert fence.braking_room_m((0.5, 0.0, -0.5), (0.0, 0.0, -1.0)) == pytest.approx(0.25)
    away_m = fence.braking_room_m((2.5, 0.0, 0.0), (-2.0, 0.0, 0.0))
    assert away_m == pytest.approx(0.5), "it flies away from the side"


@given(places, speeds)
def test_braking_never_leaves_more_room(
    place: tuple[float, float, float], speed: tuple[float, float, float]
) -> None:
    fence = Fence(SAME, FLOOR_Z_M)
    assert fence.braking_room_m(place, speed) <= fence.room_m(place) + 1e-12


@given(st.lists(st.tuples(st.floats(-5, 5), st.floats(-5, 5)), min_size=3, max_size=6))
def test_corners_that_make_no_convex_polygon_are_refused(
    corners: list[tuple[float, float]],
) -> None:
    n = len(corners)
    turns = []
    for i in range(n):
        (a, b), (c, d), (e, f) = corners[i], corners[(i + 1) % n], corners[(i + 2) % n]
        turns.append((c - a) * (f - d) - (d - b) * (e - c))
    assume(min(turns) < -1e-6 and max(turns) > 1e-6)
    with pytest.raises(ValueError, match="convex"):
        ConvexFence(corners_m=tuple(corners), height_m=2.0)


def test_a_fence_has_no_default() -> None:
    assert from_dict({}, Config).fence is None
    assert isinstance(from_dict({"fence": msgspec.to_builtins(BOX)}, Config).fence, BoxFence)
