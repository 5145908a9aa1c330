"""The byte table of the MAVLink frames, shared by tests of reader, writer, poses and fuzz."""

import json
import math
import pathlib
from typing import Any, NamedTuple


class Golden(NamedTuple):
    """A frame that real software sent, and what it says."""

    message: str
    sender: str
    system: int
    component: int
    sequence: int
    frame: bytes
    fields: dict[str, Any]


def _value(value: Any) -> Any:
    if isinstance(value, list):
        return [_value(item) for item in value]
    return math.nan if value == "nan" else value


def _load() -> list[Golden]:
    path = pathlib.Path(__file__).parent / "golden" / "mavlink_frames.json"
    found = []
    for f in json.loads(path.read_text())["frames"]:
        head = (f[key] for key in ("message", "from", "system", "component", "sequence"))
        fields = {name: _value(value) for name, value in f["fields"].items()}
        found.append(Golden._make((*head, bytes.fromhex(f["hex"]), fields)))
    return found


FRAMES = _load()


def golden(message: str) -> Golden:
    """The first frame of that kind from a PX4."""
    return next(g for g in FRAMES if g.message == message and g.sender.startswith("PX4"))


def same(a: Any, b: Any) -> bool:
    """Equal, a NaN being equal to a NaN."""
    if isinstance(a, list | tuple) and isinstance(b, list | tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, float) and isinstance(b, float) and math.isnan(a):
        return math.isnan(b)
    return bool(a == b)
