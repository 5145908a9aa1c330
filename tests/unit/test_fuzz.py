"""Every decoder is fed random and damaged bytes, and gives the fuzzer nothing to find."""

from typing import get_args

import pytest

import links.make
from groundstation.pose.registry import PoseConfig
from tests.proving.fuzz import LINKS, SOURCES, try_damaged

ALL = SOURCES | LINKS


@pytest.mark.parametrize("name", ALL)
def test_no_bytes_make_a_decoder_raise_or_say_something_else_in_pieces(name: str) -> None:
    events, drops = try_damaged(ALL[name], 2000)
    assert events > 0, "nothing good got through: the fuzzer tries too little"
    assert len(drops) >= 2


def test_every_source_and_every_link_is_fuzzed() -> None:
    kinds = {kind.__struct_config__.tag for kind in get_args(PoseConfig)}
    # Autopilots' estimates come in one of two messages; libmotioncapture reads its bytes itself.
    ours = kinds - {"mavlink", "libmotioncapture"} | {"odometry", "local_position", "tlog"}
    assert {name.partition(" ")[0] for name in SOURCES} == ours
    # A board's own port, for the doctor.
    assert LINKS.keys() == links.make.LINKS.keys() | {"betaflight"}
