"""A body that its tracker does not see makes no pose: by the field of each source that says so."""

import json
import math
from types import SimpleNamespace
from typing import Any

import pytest

from groundstation.core.geometry import Vec3
from groundstation.core.messages import Others
from groundstation.pose.sources import Intake, JsonReader, NatNetReader, QualisysReader, ViconReader
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

PLACE: Vec3 = (1.0, 2.0, 0.5)
NAN: Vec3 = (math.nan, math.nan, math.nan)


def vicon(seen: bool, n: int, second: str = "wand") -> bytes:
    place = tuple(1e3 * part + n for part in PLACE) if seen else (0.0, 0.0, 0.0)
    items = [ViconObject(name, (place[0], place[1], place[2]), (0.0, 0.0, 0.0)) for name in ("quad", second)]
    return encode(n, items)


def json_line(seen: bool, n: int, second: str = "wand") -> bytes:
    bodies = [
        {"name": name, "t": 0.01 * n, "position": [1.0 + n, 2.0, 0.5], "quaternion": [1, 0, 0, 0], "valid": seen}
        for name in ("quad", second)
    ]
    return json.dumps(bodies).encode()


def motioncapture(seen: bool, n: int, second: str = "wand") -> bytes:
    turn = SimpleNamespace(w=1.0 if seen else math.nan, x=0.0, y=0.0, z=0.0)
    body = SimpleNamespace(position=PLACE if seen else NAN, rotation=turn)
    return json.dumps([{"name": name, "t": 0.01 * n, **describe_body(body)} for name in ("quad", second)]).encode()


def natnet(seen: bool, n: int, second: str = "wand") -> bytes:
    bodies = tuple(
        RigidBody(number, PLACE, (0.0, 0.0, 0.0, 1.0), tracked=seen) for number in (1, 2 - (second == "quad"))
    )
    return encode_frame(NatNetFrame(n, bodies, 10_000 * n + 1, 10_000 * n + 2), (3, 0))


def qualisys(seen: bool, n: int, second: str = "wand") -> bytes:
    body = (PLACE, (1.0, 0.0, 0.0, 0.0)) if seen else None
    return encode_data(10_000 * n, n, [body, body])[8:]


def reader(kind: str, others: Others) -> Any:
    intake = Intake(0.0, others=others, frame_s=0.01 if kind == "vicon" else None)
    if kind == "vicon":
        return ViconReader("quad", intake)
    if kind == "qualisys":
        qtm = QualisysReader("quad", intake)
        qtm.names = ("quad", "wand")
        return qtm
    if kind == "natnet":
        motive = NatNetReader("quad", intake)
        motive.read(encode_server_info(ServerInfo("Motive", (3, 0), 1_000_000)), 0.0)
        motive.read(encode_models({"quad": 1, "wand": 2}, (3, 0)), 0.0)
        return motive
    return JsonReader("quad", intake, Intake(0.0, frame_s=0.01))


@pytest.mark.parametrize("make", [vicon, json_line, motioncapture, natnet, qualisys])
def test_of_two_bodies_with_the_vehicle_s_name_or_id_neither_is_flown(make: Any) -> None:
    source = reader(make.__name__, Others(()))
    if make is qualisys:
        source.names = ("quad", "quad")
    assert [list(source.read(make(True, n, "quad"), 0.01 * n)) for n in (1, 2)] == [[], []]
    assert source.status.dropped == {"same_name": 2}


def test_two_rigid_bodies_of_one_name_are_told_apart_by_a_streaming_id_alone() -> None:
    models = encode_models({"quad": 1, "wand": 2}, (3, 0)).replace(b"wand", b"quad")
    for body_id, expected in ((None, 0), (2, 1)):
        motive = NatNetReader("quad", Intake(0.0), body_id=body_id)
        motive.read(encode_server_info(ServerInfo("Motive", (3, 0), 1_000_000)), 0.0)
        motive.read(models, 0.0)
        assert len(motive.read(natnet(True, 1), 0.01)) == expected


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
        '{"name": "NAME", "t": 1, "position": null, "quaternion": {"w": 1, "x": 0, "y": 0, "z": 0}}',
    ],
)
def test_a_place_that_is_left_out_or_null_is_one_that_is_not_seen(hidden: str) -> None:
    others = Others(("wand",))
    source = reader("json", others)
    assert source.read(hidden.replace("NAME", "quad").encode(), 1.0) == ()
    assert source.status.dropped == {"not_tracked": 1}
    seen = '{"name": "quad", "t": 2, "position": [1, 2, 3], "quaternion": [1, 0, 0, 0]}'
    assert len(source.read(f"[{hidden.replace('NAME', 'wand')}, {seen}]".encode(), 2.0)) == 1, "beside one not seen"
    assert others.sighting("wand") is None


def test_a_body_that_is_seen_must_have_a_place() -> None:
    source = reader("json", Others(()))
    assert source.read(b'{"name": "quad", "t": 1, "quaternion": [1, 0, 0, 0]}', 1.0) == ()
    assert source.status.dropped == {"wrong_schema": 1}


def test_what_python_writes_of_a_number_that_is_none_loses_no_other_body() -> None:
    """``json.dumps`` writes NaN, which is no JSON."""
    source = reader("json", Others(()))
    lost = {"name": "wand", "position": NAN, "quaternion": [math.nan, 0.0, 0.0, 0.0]}
    seen = {"name": "quad", "t": 1.0, "position": PLACE, "quaternion": [1.0, 0.0, 0.0, 0.0]}
    assert len(source.read(json.dumps([lost, seen]).encode(), 1.0)) == 1
    assert source.read(json.dumps({**seen, "t": 2.0, "position": NAN}).encode(), 2.0) == ()
    assert source.read(json.dumps({**seen, "t": math.inf}).encode(), 2.0) == ()
    assert source.status.dropped == {"not_finite": 2}
    for text in (b"[NaN", b'{"name": NaN}', b"NaN", b'{"name": "quad", "t": Infinity}'):
        assert source.read(text, 3.0) == ()
    assert source.status.accepted == 1
