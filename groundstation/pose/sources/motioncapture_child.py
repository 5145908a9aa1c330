"""Child of the libmotioncapture source: the library's calls block, and may hang for ever.

A line a frame on standard output, the JSON of a home-made tracker (json_codec.py): the wanted
bodies first, each stamped with this machine's monotonic clock as the library gave the frame. The
first line is empty: connected.
"""

import importlib
import json
import math
import os
import signal
import sys
import time
from typing import Any

from groundstation.machine import follow_parent
from groundstation.pose.sources.json_codec import MAX_DATAGRAM, MAX_NAME
from groundstation.runtime import Exit


def describe_body(body: Any) -> dict[str, Any]:
    """Pose of one body of the library, for JSON.

    Not ``valid`` where it is no number: it is not seen.
    """
    q = body.rotation
    place = [float(part) for part in body.position]
    turn = [float(part) for part in (q.w, q.x, q.y, q.z)]
    if math.isfinite(sum(place) + sum(turn)) and any(turn):
        return {"position": place, "quaternion": turn}
    return {"position": [0.0, 0.0, 0.0], "quaternion": [1.0, 0.0, 0.0, 0.0], "valid": False}


def main() -> Exit:
    """``PARENT_PID BACKEND OPTIONS NAMES``: the last two as JSON, an object and an array."""
    parent, backend, options, names = sys.argv[1:]
    # Nothing else ends a call of the library that hangs.
    if not follow_parent(int(parent), signal.SIGKILL):
        return Exit.FAILED
    out = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    # The library itself prints on standard output.
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    motioncapture: Any = importlib.import_module("motioncapture")  # no stubs come along
    wanted = {name: rank for rank, name in enumerate(json.loads(names))}
    tracker = motioncapture.connect(backend, json.loads(options))
    out.write(b"\n")
    out.flush()
    while True:
        tracker.waitForNextFrame()
        now_s = time.monotonic()
        bodies: list[dict[str, Any]] = []
        for name, body in sorted(
            tracker.rigidBodies.items(), key=lambda one: wanted.get(one[0], len(wanted))
        ):
            if len(name) <= MAX_NAME:
                bodies.append({"name": name, "t": now_s, **describe_body(body)})
        line = json.dumps(bodies).encode()
        while len(line) > MAX_DATAGRAM:
            bodies.pop()
            line = json.dumps(bodies).encode()
        out.write(line + b"\n")
        out.flush()


if __name__ == "__main__":
    sys.exit(main())
