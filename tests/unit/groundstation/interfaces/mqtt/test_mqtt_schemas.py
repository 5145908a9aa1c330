"""The published JSON Schemas are those of the code, and what is published keeps to them."""

import math
from pathlib import Path

import msgspec
import pytest
from jsonschema import Draft202012Validator

from groundstation.interfaces.mqtt.messages import (
    EventMessage,
    HealthMessage,
    SealedRequest,
    SessionMessage,
)
from groundstation.interfaces.mqtt.requests import Place, seal_answer, seal_request
from tests.proving.reference import make_schemas, schema_text
from tests.sample_flight import sample

DOCS = Path(__file__).parents[5] / "docs" / "reference"
KEY, PLACE = bytes(range(32)), Place("lab", "mqx")
REQUEST = seal_request(KEY, PLACE, "0" * 32, "tablet", 1, "land", 2, "wind")
BLIND = msgspec.structs.replace(sample(1.0), pose_age_s=math.inf, error_m=math.nan)
WITHOUT_LAW = msgspec.structs.replace(BLIND, diagnostics=None, certificate=None)
PUBLISHED: dict[str, list[bytes]] = {
    "snapshot.json": [msgspec.json.encode(sample(1.0)), msgspec.json.encode(WITHOUT_LAW)],
    "event.json": [msgspec.json.encode(EventMessage(1, 12.345, "ready"))],
    "health.json": [msgspec.json.encode(HealthMessage("0.1.0", 1, 2, 0, {"done": 1}))],
    "request-session.json": [msgspec.json.encode(SessionMessage("0" * 32))],
    "request.json": [REQUEST],
    "answer.json": [
        seal_answer(KEY, PLACE, msgspec.json.decode(REQUEST, type=SealedRequest), True, "landing")
    ],
}


def test_the_files_are_what_the_command_writes() -> None:
    """Else: ``groundstation-sim dev reference --write docs/reference``."""
    files = {path.name: path.read_text("utf-8") for path in (DOCS / "mqtt-schemas").iterdir()}
    assert files == {name: schema_text(schema) for name, schema in make_schemas().items()}


@pytest.mark.parametrize("name", PUBLISHED)
def test_what_is_published_keeps_to_its_schema(name: str) -> None:
    schema = make_schemas()[name]
    Draft202012Validator.check_schema(schema)
    for payload in PUBLISHED[name]:
        Draft202012Validator(schema).validate(msgspec.json.decode(payload))
