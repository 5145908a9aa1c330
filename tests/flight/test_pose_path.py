"""The way of one pose from the socket to the bytes of a command, as docs/explanation/architecture.md lists it."""

import re
import sys
from collections import Counter
from pathlib import Path
from types import FrameType

from sim import SCENARIOS, fly, prepare

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "explanation" / "architecture.md"
OURS = tuple(f"{ROOT / house}/" for house in ("groundstation", "links"))


def is_asked_by_the_simulator(frame: FrameType) -> bool:
    """Whether the simulated side asks for its own sake, as its plant does for a rotation."""
    caller = frame.f_back
    asks = caller is not None and caller.f_code.co_filename.startswith(f"{ROOT / 'sim'}/")
    return asks and frame.f_code.co_name != "datagram_received"


def trace() -> list[list[str]]:
    """The modules that poses pass, from a datagram that is received to the next that is sent, in the order of entry."""
    ways: list[list[str]] = []
    way: dict[str, None] | None = None

    def note(frame: FrameType, event: str, _: object) -> None:
        nonlocal way
        if event != "call":
            return
        code = frame.f_code
        if code.co_name == "sendto" and way is not None:
            ways.append(list(way))
            way = None
        if code.co_filename.startswith(OURS) and not is_asked_by_the_simulator(frame):
            module = Path(code.co_filename).relative_to(ROOT).as_posix()
            if code.co_name == "datagram_received" and module.startswith("groundstation/pose/"):
                way = {}
            if way is not None:
                way.setdefault(module)

    world, config = prepare(SCENARIOS["paper"], [])
    sys.setprofile(note)
    try:
        fly(world, config, seed=0, duration_s=2.0)
    finally:
        sys.setprofile(None)
    return ways


def test_a_pose_passes_the_modules_that_the_page_lists() -> None:
    to_a_command = [way for way in trace() if "groundstation/core/control/backstepping.py" in way]
    assert len(to_a_command) > 20
    count = Counter(module for way in to_a_command for module in way)
    passed = [module for module, ways in count.items() if ways > len(to_a_command) / 10]
    listed = re.findall(r"^\d+\. `([\w/.]+)`", PAGE.read_text("utf-8"), re.MULTILINE)
    assert sorted(listed) == sorted(passed)
