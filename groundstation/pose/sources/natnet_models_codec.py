"""NatNet's MODELDEF: the names and streaming ids of rigid bodies, which are nowhere else. Sans-IO.

    u32 n, then n × (u32 type, [4.1: u32 bytes], description)

    0: marker set  text name | u32 n, n × text
    1: rigid body  text name | i32 id | i32 parent | f32[3] offset | [4.2: f32[4] quaternion] | u32 n, n × f32[3],
                   n × u32, [4.0: n × text]
    2: skeleton    text name | i32 id | u32 n, n × rigid body

Source: see natnet_codec.py.
"""

import struct
from collections.abc import Mapping

from groundstation.pose.sources.natnet_codec import MODELDEF, SIZED, U32, Payload, Version, message

TURNED: Version = (4, 2)
"""From here on the description of a body holds a quaternion."""

_BODY_DESCRIPTION = struct.Struct("<ii3f")
_POINT_BYTES = 12
_QUATERNION_BYTES = 16


def decode_models(payload: bytes, version: Version) -> dict[str, int]:
    """Rigid bodies of a MODELDEF, name → streaming id.

    Descriptions of unknown kinds end the list: those of rigid bodies come before them.

    Raises:
        Unreadable: truncated.
    """
    walk = Payload(payload)
    bodies: dict[str, int] = {}
    for _ in range(walk.count()):
        kind = walk.count()
        if version >= SIZED:
            walk.count()
        if kind == 0:
            walk.text()
            for _ in range(walk.count()):
                walk.text()
        elif kind == 1:
            name, number = _body_description(walk, version)
            bodies[name] = number
        elif kind == 2:
            walk.text()
            walk.skip(4)
            for _ in range(walk.count()):
                _body_description(walk, version)
        else:
            break
    return bodies


def _body_description(walk: Payload, version: Version) -> tuple[str, int]:
    name = walk.text()
    number, *_ = walk.take(_BODY_DESCRIPTION)
    if version >= TURNED:
        walk.skip(_QUATERNION_BYTES)
    markers = walk.count()
    walk.skip(markers * (_POINT_BYTES + 4))
    if version >= (4, 0):
        for _ in range(markers):
            walk.text()
    return name, int(number)


def encode_models(bodies: Mapping[str, int], version: Version) -> bytes:
    """The message MODELDEF with rigid bodies that have no markers, for simulators and tests."""
    parts = [U32.pack(len(bodies))]
    for name, number in bodies.items():
        turn = bytes(_QUATERNION_BYTES) if version >= TURNED else b""
        body = name.encode() + b"\0" + _BODY_DESCRIPTION.pack(number, -1, 0.0, 0.0, 0.0) + turn + U32.pack(0)
        parts += [U32.pack(1), U32.pack(len(body)) if version >= SIZED else b"", body]
    return message(MODELDEF, b"".join(parts))
