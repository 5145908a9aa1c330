"""Every source that sees several bodies tells where the others are, in our axes."""

import asyncio
import math
from typing import Any

import pytest
from hypothesis import given, strategies as st

from groundstation.config import from_dict
from groundstation.core.geometry import so3
from groundstation.core.messages import Others, Pose
from groundstation.pose import make_source
from groundstation.settings import Config
from links import make_link
from sim.trackers import TrackedBody, make_tracker
from tests.loops import in_virtual_time
from tests.pose_tables import TABLES, VICON, fresh_reader

ASIDE = {"lab_origin_m": [1.0, -2.0, 0.5], "centre_of_mass_m": [0.1, 0.0, 0.0]}
KINDS: list[dict[str, Any]] = [
    {"kind": "vicon", "drop_frozen": True, "alignment": ASIDE},
    {"kind": "json", "world": "enu", "alignment": {"lab_rotation_deg": [0.0, 0.0, 30.0]}},
    {"kind": "natnet", "multicast": True},
    {"kind": "natnet", "id": 1},
    {"kind": "qualisys"},
]


@pytest.mark.parametrize(
    "pose", KINDS, ids=["vicon", "json", "natnet multicast", "natnet unicast", "qualisys"]
)
@in_virtual_time
async def test_the_other_bodies_are_seen_in_our_axes_and_hidden_ones_are_not(
    pose: dict[str, Any],
) -> None:
    config = from_dict({"pose": pose}, Config)
    others, poses = Others(("bee", "cat")), list[Pose]()
    loop = asyncio.get_running_loop()
    tracked = make_tracker(config.pose)
    assert tracked is not None
    own, tracker = tracked
    await tracker.open()
    source = make_source(config.pose, make_link(config.link, thrust_max_n=1.0), others)
    frame, bee, cat = 0, (1.0, 0.5, -1.5), (-1.0, 0.25, -0.5)

    async def stream(seconds: float, hidden: bool) -> None:
        nonlocal frame
        for _ in range(round(seconds / 0.01)):
            await asyncio.sleep(0.01)
            frame += 1
            x = 1e-5 * frame
            at = bee if hidden else (bee[0] + x, bee[1], bee[2])
            bodies = [
                TrackedBody(own, (x, 0.0, -1.0), so3.IDENTITY, True),
                TrackedBody("dog", (5.0, 5.0, 5.0), so3.IDENTITY, True),
                TrackedBody("bee", at, so3.from_euler_zyx(0.1, 0.2, 0.3), not hidden),
                TrackedBody("cat", (cat[0] + x, cat[1], cat[2]), so3.IDENTITY, True),
            ]
            tracker.send(frame, loop.time() - 0.005, bodies)

    sending = asyncio.ensure_future(stream(3.0, hidden=False))
    await asyncio.sleep(0.5)
    await source.start(poses.append)
    await sending
    sight = others.sighting("bee")
    assert sight is not None
    assert loop.time() - sight.time_s < 0.1
    # A centre of mass is a vehicle's own: of the others it is not known.
    near_m = 0.11 if any(pose.get("alignment", {}).get("centre_of_mass_m", [0])) else 1e-4
    assert sight.position_ned == pytest.approx((bee[0] + 1e-5 * frame, bee[1], bee[2]), abs=near_m)
    await stream(1.0, hidden=True)
    hidden, visible = others.sighting("bee"), others.sighting("cat")
    assert hidden is not None and visible is not None
    assert loop.time() - hidden.time_s > 0.9
    assert loop.time() - visible.time_s < 0.1
    assert visible.velocity_ned == pytest.approx((1e-3, 0.0, 0.0), abs=1e-4)
    assert len(poses) > 200
    await source.close()
    tracker.close()


TWO_BODIES = {
    **{
        name: next(row.datagram for row in TABLES[name].rows if "two bodies, ours" in row.about)
        for name in ("natnet 3.0", "natnet 4.1", "qualisys", "json")
    },
    "vicon": next(row.datagram for row in VICON.readable if "two objects" in row.about),
}
"""Golden datagrams in which the body ``wand`` is beside ours."""


@pytest.mark.parametrize("name", TWO_BODIES)
@given(st.data())
def test_damaged_bytes_put_no_other_body_nowhere(name: str, data: st.DataObject) -> None:
    reader = fresh_reader(name)
    reader.intake.others = others = Others(("wand",))
    whole = TWO_BODIES[name]
    for message in TABLES[name].prelude if name.startswith("natnet") else ():
        reader.read(bytes.fromhex(message), 0.0)
    reader.read(whole, 0.0)
    assert others.sighting("wand") is not None
    for number in range(3):
        damaged = bytearray(whole)
        for at in data.draw(st.lists(st.integers(0, len(damaged) - 8), max_size=4)):
            damaged[at : at + 8] = 8 * bytes([data.draw(st.sampled_from((0x00, 0x7F, 0x80, 0xFF)))])
        reader.read(bytes(damaged), 0.01 * number + 0.01)
        sight = others.sighting("wand")
        assert sight is None or all(map(math.isfinite, (*sight.position_ned, *sight.velocity_ned)))
