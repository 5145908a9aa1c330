"""Table of sentences for the operator."""

import ast
import math
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import msgspec

from groundstation.core.messages import NOTICES, Notice, NoticeTemplate, Sentence, Severity, notice
from groundstation.flight.assembly import FlightRecorder
from groundstation.recording import LineRecord, Record
from sim.text import SIM_NOTICES


def test_a_sentence_is_filled_with_its_numbers_and_followed_by_its_remedy() -> None:
    template = NoticeTemplate(
        "pose.late", "pose age {age_ms:.0f} ms, limit {limit_ms:.0f} ms", "check the network"
    )
    assert (
        str(template.format(age_ms=312.4, limit_ms=150))
        == "pose age 312 ms, limit 150 ms: check the network"
    )


EVERY = NOTICES | {row.id: row for row in SIM_NOTICES}


def test_every_id_is_named_after_a_room_and_a_fact() -> None:
    assert all(key == template.id and "." in key for key, template in EVERY.items())


def test_an_id_has_one_row_in_all_tables() -> None:
    ids = [
        ast.unparse(node.args[0]).strip("'")
        for room in HOUSES
        for path in (ROOT / room).rglob("*notices.py")
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.Call) and name_error(node) == "NoticeTemplate" and node.args
    ]
    assert [
        id for id in EVERY if id not in ids and not id.startswith("drop.")
    ] == []  # those are made by reason
    assert [id for id, count in Counter(ids).items() if count > 1] == []


def test_a_sentence_keeps_its_numbers_and_those_of_a_sentence_inside_it() -> None:
    reason = notice("guard.tilt", tilt_deg=50.0, limit_deg=40.0)
    told = notice("fault.poses_land", reason=reason)
    assert told.text == "tilt 50°, limit 40°: landing, as they still respond"
    assert told.numbers == {
        "reason": reason.text,
        "reason_id": "guard.tilt",
        "tilt_deg": 50.0,
        "limit_deg": 40.0,
    }
    assert (reason.as_warning().id, reason.as_warning().text) == (
        "guard.tilt",
        "warning: tilt 50°, limit 40°",
    )


def test_numbers_that_json_does_not_know_travel_as_text() -> None:
    told = notice("fault.pose_gap", age_ms=math.inf)
    assert msgspec.json.decode(msgspec.json.encode(told), type=Sentence) == told


def test_a_notice_reaches_a_recording_with_its_id_and_its_numbers() -> None:
    given = list[Record]()
    tape = FlightRecorder(given.append, lambda told: None, None, None)  # type: ignore[arg-type]  # none is asked
    told = notice("guard.tilt", tilt_deg=50.0, limit_deg=40.0)
    tape.take(Notice.of(1.0, "hold", told, "news", Severity.WARNING))
    encoded = msgspec.msgpack.encode(given[0])
    assert msgspec.msgpack.decode(encoded, type=Record) == LineRecord(
        1.0, "hold", told.text, told.id, told.numbers
    )


ROOT = Path(__file__).parents[4]
HOUSES = ("groundstation", "links", "sim", "tests/proving")
BUILT_BY_ID = ("link.", "drop.", "guard.", "pose.", "mavlink.port_", "mavlink.local_port_")
"""Rows that code finds by a reason that it counts, the row of a guard or of a doubt, or by who has
a port."""
BUILDERS = {"Check", "Reply", "Notice"}
"""What carries a sentence is made from one, by ``of``."""


def list_modules(*rooms: str) -> Iterator[Path]:
    """Modules of ``rooms`` that hold no table."""
    for room in rooms:
        yield from (
            path
            for path in sorted((ROOT / room).rglob("*.py"))
            if not path.stem.endswith("notices")
        )


def parsed(*rooms: str) -> Iterator[ast.AST]:
    for path in list_modules(*rooms):
        yield from ast.walk(ast.parse(path.read_text("utf-8")))


def test_every_sentence_is_used() -> None:
    used = {node.value for node in parsed(*HOUSES) if isinstance(node, ast.Constant)}
    assert [id for id in EVERY if id not in used and not id.startswith(BUILT_BY_ID)] == []


def test_what_carries_a_sentence_is_made_from_one() -> None:
    rooms = [
        f"groundstation/{room}"
        for room in ("core", "flight", "pose", "recording", "interfaces/api")
    ]
    made = [
        f"{node.func.id}, line {node.lineno}"
        for node in parsed(*rooms, "groundstation/interfaces/mqtt")
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id in BUILDERS
    ]
    assert made == []


KEYED_ERRORS = {"ArgumentError", "ConfigError"}
"""Errors whose first argument names a key or an option."""
ERRORS = KEYED_ERRORS | {
    "ApiError", "ArgumentTypeError", "EOFError", "ImportError", "KeyError", "LinkError",
    "LinkLost", "LinkRejected",
    "NoCommand", "NoRecording", "SourceError", "StretchTooShort", "Taken", "Unanswered",
    "UserCodeFault",
    "ValueError",
}  # fmt: skip
"""Errors whose text an operator reads."""
READ_BY_PROGRAMMERS = {
    "betaflight_codec", "json_codec", "quadrotor", "shared_memory", "vicon_codec", "virtual_time",
}  # fmt: skip
"""Modules whose errors are about a wrong call, or a packet that is counted."""


def is_prose(node: ast.AST) -> bool:
    """Whether ``node`` is text that belongs into the table: several words, or an f-string of
    them.
    """
    parts = node.values if isinstance(node, ast.JoinedStr) else [node]
    return any(
        isinstance(part, ast.Constant) and " " in str(part.value).strip(": ") for part in parts
    )


def has_own_text(call: ast.Call, function: ast.AST) -> bool:
    """Whether the error that ``call`` makes has a text of its own, said there or in a name of
    ``function``.
    """
    said = call.args[int(name_error(call) in KEYED_ERRORS) :] + [
        each.value for each in call.keywords
    ]
    names = {node.id for node in said if isinstance(node, ast.Name)}
    assigned = [node for node in ast.walk(function) if isinstance(node, ast.Assign)]
    said += [
        node.value for node in assigned if not names.isdisjoint(map(ast.unparse, node.targets))
    ]
    return any(is_prose(node) for text in said for node in ast.walk(text))


def name_error(call: ast.Call) -> str:
    """Return the name of the class that is called, without its module."""
    return ast.unparse(call.func).rpartition(".")[2]


def test_every_error_for_the_operator_is_a_row_of_the_table() -> None:
    functions = [
        node
        for path in list_modules(*HOUSES)
        if path.stem not in READ_BY_PROGRAMMERS
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    ]
    own_texts = [
        f"{function.name}: {ast.unparse(node)}"
        for function in functions
        for node in ast.walk(function)
        if isinstance(node, ast.Call)
        and name_error(node) in ERRORS
        and has_own_text(node, function)
    ]
    assert own_texts == []
