"""Which of the dropped messages that links/ counts a person must see."""

import ast
from pathlib import Path

import msgspec
import pytest

from groundstation.core.messages import NOTICES, LinkDropWatch, PoseStatus, find_pose_drops
from groundstation.core.messages.drops import LINK_DROPS, USUAL_POSE_DROPS
from links.core import LinkStatus

ROOT = Path(__file__).parents[4]
LINK = LinkStatus(state="armed", sent=1000, expired=0, received=1000, dropped={}, text="")
NOBODY_NEEDS = {
    "other_system", "unknown", "garbage", "no_peer", "bad_command", "not_a_frame", "bad_checksum",
    "cut_short",
    "not_ours", "from_this_machine", "malformed", "clock_jumped",
}  # fmt: skip
"""See the module's text; the last line is told by the bridge itself where it runs."""


KNOWN = {id.removeprefix("drop.") for id in NOTICES if id.startswith("drop.")}
"""Reasons that have their sentence."""


def with_drops(**dropped: int) -> LinkStatus:
    return msgspec.structs.replace(LINK, dropped=dropped)


def counted_in(folder: Path) -> set[str]:
    """The reasons that are counted there by their names."""
    found = set()
    for path in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            match node:
                case ast.Subscript(ast.Name("dropped"), ast.Constant(str(reason))):
                    found.add(reason)
                case ast.Subscript(ast.Attribute(attr=counts), ast.Constant(str(reason))):
                    if counts.strip("_") in ("dropped", "errors"):
                        found.add(reason)
                case ast.Call(ast.Attribute(attr=call), [ast.Constant(str(reason)), *_]):
                    if call.strip("_") == "drop":
                        found.add(reason)
    return found


def test_every_reason_that_a_link_counts_is_told_or_needs_nobody() -> None:
    counted = counted_in(ROOT / "links")
    assert {"truncated", "bad_crc", "other_address", "port_lost", "bad_seal"} <= counted
    assert counted <= LINK_DROPS.keys() | NOBODY_NEEDS


def test_every_reason_that_a_pose_source_counts_has_its_meaning_or_is_no_loss() -> None:
    counted = counted_in(ROOT / "groundstation" / "pose") | counted_in(
        ROOT / "links" / "mavlink" / "protocol"
    )
    known = {"jump", "late", "other_address", "truncated", "malformed", "other_bodies"}
    assert known <= counted | KNOWN
    assert counted <= KNOWN | USUAL_POSE_DROPS | {"unsigned", "bad_signature", "replayed"}


@pytest.mark.parametrize("reason", LINK_DROPS)
def test_every_reason_has_a_sentence_and_says_what_to_do(reason: str) -> None:
    assert NOTICES[f"link.{reason}"].remedy


def test_in_flight_a_reason_is_told_once_and_again_when_it_is_tenfold() -> None:
    watch = LinkDropWatch(with_drops(bad_signature=5))
    assert watch.find_news(with_drops(bad_signature=5)) == []
    assert len(watch.find_news(with_drops(bad_signature=6))) == 1
    assert watch.find_news(with_drops(bad_signature=14)) == []
    assert len(watch.find_news(with_drops(bad_signature=15))) == 1
    (says,) = watch.summarize(with_drops(bad_signature=15))
    assert says.text.startswith("10 MAVLink messages were signed with another key")


def test_poses_are_told_of_by_their_commonest_reason_and_other_messages_are_no_loss() -> None:
    usual = PoseStatus(accepted=10, dropped={"other_message": 500, "jump": 2})
    assert find_pose_drops(usual) is None
    lossy = PoseStatus(accepted=100, dropped={"other_message": 500, "jump": 8, "late": 4})
    assert find_pose_drops(lossy) == ("jump", 8, 112)


def test_after_the_flight_a_second_path_is_still_called_one() -> None:
    """A link that is closed tells no more of it."""
    addresses = ("10.0.0.9:14550",)
    closed = msgspec.structs.replace(with_drops(other_address=9), other_addresses=addresses)
    watch = LinkDropWatch(LINK)
    (stranger,) = watch.summarize(closed)
    assert "find out who else sends" in stranger.text
    warning = "the autopilot is heard from two addresses"
    watch.find_news(msgspec.structs.replace(closed, warning=warning))
    (path,) = watch.summarize(closed)
    assert "end that path: commands go by the first" in path.text


def test_what_is_usually_no_pose_has_its_meaning_too_for_it_may_be_all_that_comes() -> None:
    assert USUAL_POSE_DROPS <= KNOWN
