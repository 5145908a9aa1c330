"""Readers of each source: bodies unseen or of one name, two trackers on one port, other bodies."""

import asyncio
import json
import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given, strategies as st

from groundstation.config import from_dict
from groundstation.core.geometry import IDENTITY, Vec3, so3
from groundstation.core.messages import Others, Pose
from groundstation.pose import make_source
from groundstation.pose.sources import (
    Intake,
    JsonReader,
    NatNetReader,
    QualisysReader,
    ViconReader,
    VisionReader,
)
from groundstation.pose.sources.intake import PoseReader
from groundstation.pose.sources.json_codec import encode as encode_json, json_pose
from groundstation.pose.sources.mavlink_codec import VisionEstimate, encode_vision
from groundstation.pose.sources.motioncapture_child import describe_body
from groundstation.pose.sources.natnet_codec import (
    NatNetFrame,
    RigidBody,
    ServerInfo,
    encode_frame,
    encode_models,
    encode_server_info,
)
from groundstation.pose.sources.qualisys_codec import encode_data
from groundstation.pose.sources.vicon_codec import ViconObject, encode
from groundstation.settings import Config
from links import make_link
from links.mavlink.protocol import MavlinkCodec
from sim.trackers import TrackedBody, make_tracker
from tests.loops import in_virtual_time
from tests.pose_tables import TABLES, VICON, fresh_reader

# By their numbers: a limit that the test took from the code would bear out any value.
ALONE_S = 1.0
BOTH_S = 3.0

PLACE: Vec3 = (1.0, 2.0, 0.5)
NAN: Vec3 = (math.nan, math.nan, math.nan)
FIRST = ("10.0.0.5", 51001)
SECOND = ("10.0.0.7", 40123)
FRAME_S = 0.02
ASIDE_M = 1.5
"""How far aside the second tracker sees the vehicle [m]."""


def vicon(n: int, north_m: float = 0.0, *names: str) -> bytes:
    place = (1e3 * north_m + 0.1 * (n % 3), 0.0, 500.0)
    return encode(n, [ViconObject(name, place, (0.0, 0.0, 0.1)) for name in names or ("quad",)])


def json_line(n: int, north_m: float = 0.0, *names: str) -> bytes:
    place = (north_m + 1e-4 * (n % 3), 0.0, 0.5)
    bodies = names or ("quad",)
    return encode_json([json_pose(name, place, IDENTITY, t=FRAME_S * n) for name in bodies])


def vision(n: int, north_m: float = 0.0, *names: str) -> bytes:
    place = (north_m + 1e-4 * (n % 3), 0.0, -0.5)
    return encode_vision(MavlinkCodec(1, 197), VisionEstimate(FRAME_S * n, place, IDENTITY))


def motioncapture(n: int, north_m: float = 0.0, *names: str) -> bytes:
    body = SimpleNamespace(position=PLACE, rotation=SimpleNamespace(w=1.0, x=0.0, y=0.0, z=0.0))
    seen = [{"name": name, "t": FRAME_S * n, **describe_body(body)} for name in names]
    return json.dumps(seen).encode()


def natnet(n: int, north_m: float = 0.0, *names: str) -> bytes:
    numbers = [1 if name == "quad" else 2 for name in names or ("quad", "wand")]
    bodies = tuple(RigidBody(number, PLACE, (0.0, 0.0, 0.0, 1.0)) for number in numbers)
    return encode_frame(NatNetFrame(n, bodies, 10_000 * n + 1, 10_000 * n + 2), (3, 0))


def qualisys(n: int, north_m: float = 0.0, *names: str) -> bytes:
    return encode_data(10_000 * n, n, [(PLACE, IDENTITY)] * len(names))[8:]


Line = Callable[..., bytes]
"""The datagram of a frame: its number, where the bodies are in the north [m], and their names."""
LINES: dict[str, Line] = {"json": json_line} | {
    line.__name__: line for line in (vicon, vision, motioncapture, natnet, qualisys)
}


def motive(source: NatNetReader, models: bytes) -> NatNetReader:
    """``source`` after the handshake with a Motive that has ``models``."""
    source.read(encode_server_info(ServerInfo("Motive", (3, 0), 1_000_000)), 0.0)
    source.read(models, 0.0)
    return source


def reader(kind: str, others: Others | None = None) -> Any:
    intake = Intake(0.0, others=others or Others(()), frame_s=FRAME_S if kind == "vicon" else None)
    if kind == "vicon":
        return ViconReader("quad", intake)
    if kind == "vision":
        return VisionReader(intake)
    if kind == "qualisys":
        qtm = QualisysReader("quad", intake)
        qtm.names = ("quad", "quad")
        return qtm
    if kind == "natnet":
        return motive(NatNetReader("quad", intake), encode_models({"quad": 1, "wand": 2}, (3, 0)))
    return JsonReader("quad", intake, Intake(0.0, frame_s=FRAME_S))


@pytest.mark.parametrize("kind", [kind for kind in LINES if kind != "vision"])
def test_of_two_bodies_with_the_vehicle_s_name_or_id_neither_is_flown(kind: str) -> None:
    source, line = reader(kind), LINES[kind]
    assert not any(source.read(line(n, 0.0, "quad", "quad"), FRAME_S * n) for n in (1, 2))
    assert source.status.dropped == {"same_name": 2}


def test_two_rigid_bodies_of_one_name_are_told_apart_by_a_streaming_id_alone() -> None:
    models = encode_models({"quad": 1, "wand": 2}, (3, 0)).replace(b"wand", b"quad")
    for body_id, expected in ((None, 0), (2, 1)):
        source = motive(NatNetReader("quad", Intake(0.0), body_id=body_id), models)
        assert len(source.read(natnet(1), 0.01)) == expected


def test_a_body_without_a_rotation_is_not_seen() -> None:
    for place, w in ((PLACE, 0.0), (PLACE, math.nan), (NAN, 1.0)):
        turn = SimpleNamespace(w=w, x=0.0, y=0.0, z=0.0)
        assert describe_body(SimpleNamespace(position=place, rotation=turn))["valid"] is False


@pytest.mark.parametrize(
    "hidden",
    [
        '{"name": "NAME", "t": 1, "valid": false}',
        '{"name": "NAME", "t": 1, "position": null, "quaternion": null}',
        '{"name": "NAME", "t": 1, "position": [0, 0, 0], "quaternion": null}',
        '{"name": "NAME", "t": 1, "position": null, "quaternion": {"w": 1, "x": 0, "y": 0, "z": '
        "0}}",
    ],
)
def test_a_place_that_is_left_out_or_null_is_one_that_is_not_seen(hidden: str) -> None:
    others = Others(("wand",))
    source = reader("json", others)
    assert source.read(hidden.replace("NAME", "quad").encode(), 1.0) == ()
    assert source.status.dropped == {"not_tracked": 1}
    seen = '{"name": "quad", "t": 2, "position": [1, 2, 3], "quaternion": [1, 0, 0, 0]}'
    both = f"[{hidden.replace('NAME', 'wand')}, {seen}]".encode()
    assert len(source.read(both, 2.0)) == 1, "beside one not seen"
    assert others.sighting("wand") is None
    source.read(b'{"name": "quad", "t": 3, "quaternion": [1, 0, 0, 0]}', 3.0)
    assert source.status.dropped["wrong_schema"] == 1, "one that is seen must have a place"


def test_what_python_writes_of_a_number_that_is_none_loses_no_other_body() -> None:
    """``json.dumps`` writes NaN, which is no JSON."""
    source = reader("json")
    lost = {"name": "wand", "position": NAN, "quaternion": [math.nan, 0.0, 0.0, 0.0]}
    seen = {"name": "quad", "t": 1.0, "position": PLACE, "quaternion": [1.0, 0.0, 0.0, 0.0]}
    assert len(source.read(json.dumps([lost, seen]).encode(), 1.0)) == 1
    assert source.read(json.dumps({**seen, "t": 2.0, "position": NAN}).encode(), 2.0) == ()
    assert source.read(json.dumps({**seen, "t": math.inf}).encode(), 2.0) == ()
    assert source.status.dropped == {"not_finite": 2}
    for text in (b"[NaN", b'{"name": NaN}', b"NaN", b'{"name": "quad", "t": Infinity}'):
        assert source.read(text, 3.0) == ()
    assert source.status.accepted == 1


def listen(source: PoseReader, frames: range, line: Line, *senders: object) -> list[float]:
    """Where poses put the vehicle [m]; the first sender sees it there, each other aside."""
    norths = []
    for n in frames:
        for k, sender in enumerate(senders):
            source.sender = sender
            # The second tracker's clock is ahead, as one's that was started later may be.
            data = line(n + 500 * k, ASIDE_M * k)
            norths += [pose.position_ned[0] for pose in source.read(data, FRAME_S * n + 0.001 * k)]
    return norths


@pytest.mark.parametrize("kind", ["vicon", "json", "vision"])
def test_the_first_of_two_senders_is_used_and_both_are_named(kind: str) -> None:
    source, line = reader(kind), LINES[kind]
    assert len(listen(source, range(50), line, FIRST)) == 50
    both = listen(source, range(50, 150), line, FIRST, SECOND)
    assert len(both) == 100
    assert all(abs(north) < 0.1 for north in both)
    assert source.status.dropped == {"second_sender": 100}
    assert "come from two addresses, 10.0.0.5:51001 and 10.0.0.7:40123" in source.status.advice
    listen(source, range(150, 151 + round(BOTH_S / FRAME_S)), line, FIRST)
    assert source.status.advice == ""


@pytest.mark.parametrize("kind", ["vicon", "json", "vision"])
def test_two_senders_that_begin_at_once_are_told_within_a_few_poses(kind: str) -> None:
    source = reader(kind)
    norths = listen(source, range(50), LINES[kind], FIRST, SECOND)
    true = sum(abs(north) < 0.1 for north in norths)
    assert true >= 48, "no clock holds up the other's"
    assert source.status.dropped["second_sender"] == 48
    assert "come from two addresses, 10.0.0.5:51001 and 10.0.0.7:40123" in source.status.advice


def test_a_tracker_that_takes_over_from_one_that_fell_silent_is_no_second_one() -> None:
    source = reader("json")
    listen(source, range(50), json_line, FIRST)
    later = 51 + round(ALONE_S / FRAME_S)
    assert len(listen(source, range(later, later + 50), json_line, SECOND)) == 50
    assert (source.status.dropped, source.status.advice) == ({}, "")


def test_a_program_that_sends_each_datagram_from_another_port_is_one_sender() -> None:
    source = reader("json")
    for n in range(300):
        assert listen(source, range(n, n + 1), json_line, ("10.0.0.5", 40000 + n))
    assert (source.status.dropped, source.status.advice) == ({}, "")


def test_two_trackers_that_each_send_a_body_of_their_own_do_not_compete() -> None:
    source = reader("json")
    for n in range(100):
        assert listen(source, range(n, n + 1), json_line, FIRST)
        source.sender = SECOND
        assert not source.read(json_line(n, 1.0, "cart"), FRAME_S * n)
    assert source.status.dropped == {"no_such_body": 100}
    assert source.status.advice == ""


# ---- other bodies

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
