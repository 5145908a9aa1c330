"""The published JSON Schemas are those of the code, and what is published keeps to them."""

import argparse
import math
import re
from pathlib import Path
from typing import Any

import msgspec
import pytest
from jsonschema import Draft202012Validator

from groundstation.config import ConfigError
from groundstation.core.messages import Snapshot
from groundstation.interfaces.mqtt import mqtt_command
from groundstation.interfaces.mqtt import requests as gatekeeper
from groundstation.interfaces.mqtt.command import schema_text as text
from groundstation.interfaces.mqtt.command import schemas, topics_table
from groundstation.interfaces.mqtt.messages import (
    TOPICS,
    EventMessage,
    HealthMessage,
    SealedAnswer,
    SealedRequest,
    SessionMessage,
)
from groundstation.interfaces.mqtt.requests import Place, decode_request, is_sealed, seal_answer, seal_request
from tests.sample_flight import sample

BEGIN, END = "<!-- mqtt-topics:begin -->", "<!-- mqtt-topics:end -->"
DOCS = Path(__file__).parents[5] / "docs" / "reference"
KEY, PLACE = bytes(range(32)), Place("lab", "mqx")
REQUEST = seal_request(KEY, PLACE, "0" * 32, "tablet", 1, "land", 2, "wind")
PUBLISHED: dict[str, list[bytes]] = {
    "snapshot.json": [
        msgspec.json.encode(sample(1.0)),
        msgspec.json.encode(
            msgspec.structs.replace(
                sample(1.0), pose_age_s=math.inf, error_m=math.nan, diagnostics=None, certificate=None
            )
        ),
    ],
    "event.json": [msgspec.json.encode(EventMessage(1, 12.345, "ready"))],
    "health.json": [msgspec.json.encode(HealthMessage("0.1.0", 1, 2, 0, {"done": 1}))],
    "request-session.json": [msgspec.json.encode(SessionMessage("0" * 32))],
    "request.json": [REQUEST],
    "answer.json": [seal_answer(KEY, PLACE, msgspec.json.decode(REQUEST, type=SealedRequest), True, "landing")],
}
TYPES = (Snapshot, EventMessage, HealthMessage, SessionMessage, SealedRequest, SealedAnswer)


def test_the_files_are_what_the_command_writes() -> None:
    """Else: ``groundstation-sim dev reference --write docs/reference``."""
    files = {path.name: path.read_text("utf-8") for path in (DOCS / "mqtt-schemas").iterdir()}
    assert files == {name: text(schema) for name, schema in schemas().items()}


def test_the_table_of_topics_is_what_the_command_writes(tmp_path: Path) -> None:
    """Else: ``groundstation mqtt topics --write docs/reference/mqtt.md``."""
    page = (DOCS / "mqtt.md").read_text("utf-8")
    assert f"{BEGIN}\n{topics_table()}\n{END}" in page
    old = tmp_path / "mqtt.md"
    old.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n")
    mqtt_command(argparse.Namespace(verb="topics", write=old))
    assert old.read_text("utf-8") == f"before\n{BEGIN}\n{topics_table()}\n{END}\nafter\n"
    old.write_text("no markers")
    with pytest.raises(ConfigError, match="needs a line"):
        mqtt_command(argparse.Namespace(verb="topics", write=old))


def test_every_topic_with_json_has_a_schema_and_an_example_here() -> None:
    assert set(schemas()) == set(PUBLISHED)
    assert {topic.message for topic in TOPICS} == {*TYPES, None}


@pytest.mark.parametrize("name", PUBLISHED)
def test_what_is_published_keeps_to_its_schema(name: str) -> None:
    schema = schemas()[name]
    Draft202012Validator.check_schema(schema)
    for payload in PUBLISHED[name]:
        Draft202012Validator(schema).validate(msgspec.json.decode(payload))


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_schema_tells_a_wrong_message(name: str) -> None:
    good: dict[str, Any] = msgspec.json.decode(PUBLISHED[name][0])
    validator = Draft202012Validator(schemas()[name])
    required = schemas()[name]["required"]
    assert required
    for key in required:
        assert not validator.is_valid({other: value for other, value in good.items() if other != key})
        assert not validator.is_valid({**good, key: [None]})


@pytest.mark.parametrize("name", PUBLISHED)
def test_every_field_is_explained(name: str) -> None:
    schema = schemas()[name]
    structs = [schema, *schema.get("$defs", {}).values()]
    silent = [
        key for struct in structs for key, field in struct.get("properties", {}).items() if "description" not in field
    ]
    assert silent == []


def test_the_program_that_the_document_shows_seals_a_request() -> None:
    (block,) = re.findall(r"^```python\n(.*?)^```$", (DOCS / "mqtt.md").read_text("utf-8"), re.M | re.S)
    shown: dict[str, Any] = {}
    exec(block, shown)  # our own document
    request = decode_request(shown["sealed"](KEY, "lab", "mqx", "0" * 32, "tablet", "land", "too windy").encode())
    assert isinstance(request, SealedRequest)
    assert is_sealed(request, KEY, PLACE)
    assert request.why == "too windy"


def test_every_counter_of_requests_is_explained() -> None:
    page = (DOCS / "mqtt.md").read_text("utf-8")
    code = Path(gatekeeper.__file__).read_text("utf-8")
    reasons = re.findall(r'(?:Dropped\(|return )"(\w+)"', code) + re.findall(r'counts\["(\w+)"', code)
    assert len(set(reasons)) >= 10
    assert [reason for reason in reasons if f"`{reason}`" not in page] == []
