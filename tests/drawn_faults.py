"""Faults that nobody chose: ``python -m tests.drawn_faults COUNT SEED``, and whether their room's
tests fail.

Each turns one comparison around, swaps one operator for its opposite, or doubles one number (0
becomes 1). What survives is a hole in the tests, or changes nothing that anybody could see. Not
part of any `make` target.
"""

import ast
import random
import re
import sys
import tempfile
from collections.abc import Iterator
from itertools import accumulate
from pathlib import Path
from typing import Any

from tests.seeded_faults import ROOT, catches, copy_checkout

ROOMS = {
    "groundstation/core": "unit/groundstation/core property contract/test_controllers.py "
    "contract/test_trajectories.py",
    "groundstation/pose": "unit/groundstation/pose property/test_codecs.py "
    "property/test_source_clock.py contract/test_poses.py flight/test_forward.py",
    "links/core": "unit/links/core contract/test_links.py",
    "links/mavlink": "unit/links/mavlink property/test_codecs.py contract/test_links.py",
    "links/rf": "unit/links/rf property/test_codecs.py property/test_mailbox.py "
    "contract/test_links.py",
}
"""Tests of each room."""
PAGES = (
    "tests/unit/test_reference.py",
    "tests/unit/groundstation/interfaces/mqtt/test_mqtt_schemas.py",
)
"""Tests of every room: pages and schemas hold the default and the range of each key."""
PAIRS = (
    ("<", ">"),
    ("<=", ">="),
    ("==", "!="),
    ("+", "-"),
    ("*", "/"),
    ("and", "or"),
    ("is", "is not"),
)
OPPOSITE = {one.encode(): other.encode() for pair in PAIRS for one, other in (pair, pair[::-1])}


def slips(text: bytes) -> Iterator[tuple[int, int, bytes]]:
    """Each fault of a module: from where to where, and what is to stand there."""
    lines = [0, *accumulate(map(len, text.splitlines(keepends=True)))]

    def span(node: Any) -> tuple[int, int]:
        begin = lines[node.lineno - 1] + node.col_offset
        return begin, lines[node.end_lineno - 1] + node.end_col_offset

    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                yield *span(node), repr(2 * value or 1).encode()
            case (
                ast.BinOp(left=a, right=b)
                | ast.Compare(left=a, comparators=[b])
                | ast.BoolOp(values=[a, b])
            ):
                found = re.compile(rb"[\s)]*(.+?)[\s(]*").fullmatch(text, span(a)[1], span(b)[0])
                if found is not None and found[1] in OPPOSITE:
                    yield *found.span(1), OPPOSITE[found[1]]


def tests_of(room: str, module: Path) -> list[str]:
    """The tests of a room; first those that name the module."""
    folders = [ROOT / "tests" / told for told in ROOMS[room].split()]
    trees = ([path] if path.is_file() else path.rglob("test_*.py") for path in folders)
    found = [path for tree in trees for path in tree]
    found.sort(key=lambda one: module.stem not in one.read_text())
    return [*(str(one.relative_to(ROOT)) for one in found), *PAGES]


def main() -> int:
    """Draw faults and tell what caught them."""
    (count, seed), survived = map(int, sys.argv[1:]), 0
    every = [(room, path, slip) for room in ROOMS for path in sorted((ROOT / room).rglob("*.py"))
             for slip in slips(path.read_bytes())]  # fmt: skip
    with tempfile.TemporaryDirectory(prefix="drawn-") as name:
        copy_checkout(folder := Path(name) / "checkout")
        for room, path, (begin, end, wrong) in random.Random(seed).sample(every, count):
            right, file = path.read_bytes(), folder / path.relative_to(ROOT)
            file.write_bytes(right[:begin] + wrong + right[end:])
            try:
                by = catches(folder, tests_of(room, path), "not (real_time or matrix or soak)")
            except RuntimeError as error:
                # As a rule nothing can be imported any more.
                by = str(error).strip().splitlines()[-1]
            file.write_bytes(right)
            place = path.relative_to(ROOT), right[:begin].count(b"\n") + 1
            change = (right[begin:end].decode(), "->", wrong.decode())
            print(*place, *change, by or "SURVIVED", flush=True)
            survived += not by
    print(f"{count - survived} of {count} caught")
    return survived > 0


if __name__ == "__main__":
    sys.exit(main())
