"""Table of sentences for the operator."""

import ast
import math
import re
from collections import Counter
from functools import cache
from pathlib import Path

import msgspec
import pytest

from groundstation.config.schema import keys_of
from groundstation.core.messages import NOTICES, Notice, NoticeTemplate, Sentence, Severity, notice
from groundstation.flight.assembly import FlightRecorder
from groundstation.recording import LineRecord, Record
from groundstation.settings import Config
from sim.text import SIM_NOTICES


def test_a_sentence_is_filled_with_its_numbers_and_followed_by_its_remedy() -> None:
    says = "pose age {age_ms:.0f} ms, limit {limit_ms:.0f} ms"
    told = NoticeTemplate("pose.late", says, "check the network").format(age_ms=312.4, limit_ms=150)
    assert str(told) == "pose age 312 ms, limit 150 ms: check the network"


EVERY = NOTICES | {row.id: row for row in SIM_NOTICES}
ROOT = Path(__file__).parents[4]
HOUSES = ("groundstation", "links", "sim", "tests/proving")


@cache
def parse_modules() -> dict[Path, list[ast.AST]]:
    """The nodes of each module."""
    return {
        path: list(ast.walk(ast.parse(path.read_text("utf-8"))))
        for house in HOUSES
        for path in sorted((ROOT / house).rglob("*.py"))
    }


def test_every_id_is_named_after_a_room_and_a_fact() -> None:
    assert all(key == template.id and "." in key for key, template in EVERY.items())


def test_an_id_has_one_row_in_all_tables() -> None:
    ids = [
        ast.unparse(node.args[0]).strip("'")
        for module, nodes in parse_modules().items()
        for node in nodes
        if module.stem.endswith("notices")
        and isinstance(node, ast.Call)
        and name_error(node) == "NoticeTemplate"
        and node.args
    ]
    made_by_reason = {id for id in EVERY if id.startswith("drop.")}
    assert EVERY.keys() - set(ids) - made_by_reason == set()
    assert [id for id, count in Counter(ids).items() if count > 1] == []


def test_a_sentence_keeps_its_numbers_and_those_of_a_sentence_inside_it() -> None:
    reason = notice("guard.tilt", tilt_deg=50.0, limit_deg=40.0)
    told = notice("fault.poses_land", reason=reason)
    assert told.text == "tilt 50°, limit 40°: landing, as they still respond"
    numbers = {"tilt_deg": 50.0, "limit_deg": 40.0}
    assert told.numbers == {"reason": reason.text, "reason_id": "guard.tilt", **numbers}
    warning = reason.as_warning()
    assert (warning.id, warning.text) == ("guard.tilt", "warning: tilt 50°, limit 40°")


def test_numbers_that_json_does_not_know_travel_as_text() -> None:
    told = notice("fault.pose_gap", age_ms=math.inf)
    assert msgspec.json.decode(msgspec.json.encode(told), type=Sentence) == told


def test_a_notice_reaches_a_recording_with_its_id_and_its_numbers() -> None:
    given = list[Record]()
    tape = FlightRecorder(given.append, lambda told: None, None, None)  # type: ignore[arg-type]  # none is asked
    told = notice("guard.tilt", tilt_deg=50.0, limit_deg=40.0)
    tape.take(Notice.of(1.0, "hold", told, "news", Severity.WARNING))
    kept = msgspec.msgpack.decode(msgspec.msgpack.encode(given[0]), type=Record)
    assert kept == LineRecord(1.0, "hold", told.text, told.id, told.numbers)


BUILT_BY_ID = ("link.", "drop.", "guard.", "pose.", "mavlink.port_", "mavlink.local_port_")
"""Rows that code finds by a reason that it counts, the row of a guard or of a doubt, or by who has
a port."""


def test_every_sentence_is_used() -> None:
    used = {
        node.value
        for module, nodes in parse_modules().items()
        for node in nodes
        if not module.stem.endswith("notices") and isinstance(node, ast.Constant)
    }
    assert [id for id in EVERY if id not in used and not id.startswith(BUILT_BY_ID)] == []


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
    """Whether ``node`` is text of the table's kind: several words, or an f-string of them."""
    parts = node.values if isinstance(node, ast.JoinedStr) else [node]
    return any(
        isinstance(part, ast.Constant) and " " in str(part.value).strip(": ") for part in parts
    )


def has_own_text(call: ast.Call, function: ast.AST) -> bool:
    """Whether the error of ``call`` has a text, said there or in a name of ``function``."""
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
        for module, nodes in parse_modules().items()
        if not module.stem.endswith("notices") and module.stem not in READ_BY_PROGRAMMERS
        for node in nodes
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


def test_a_key_of_the_configuration_that_a_sentence_names_is_there() -> None:
    keys = {".".join(key.split(".")[:2]) for key in keys_of(Config)}
    named = re.compile(rf"\b(?:{'|'.join({key.split('.')[0] for key in keys})})\.[a-z_0-9]+")
    found = {
        key: row.id for row in EVERY.values() for key in named.findall(row.sentence + row.remedy)
    }
    assert "gate.jump_m" in found, "keys are recognised"
    of_the_system = {"limits.conf"}  # PAM's
    assert found.keys() - keys - of_the_system == set()


@pytest.mark.parametrize(
    "id", ["drop.jump.by", "takeoff.no_motion", "pose.position_no_answer", "drop.absurd"]
)
def test_positions_in_another_unit_are_among_the_causes_of_what_they_look_like(id: str) -> None:
    assert "unit" in EVERY[id].sentence + EVERY[id].remedy
