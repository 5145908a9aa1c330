"""The JSON Schemas of what is published by MQTT, and the table of topics, made from the types."""

import json
from pathlib import Path
from typing import Any

import msgspec

from groundstation.config import docs, in_words
from groundstation.interfaces.mqtt.messages import TOPICS, Topic

BEGIN, END = "<!-- mqtt topics -->", "<!-- end of mqtt topics -->"


def schemas() -> dict[str, dict[str, Any]]:
    """File name -> JSON Schema (draft 2020-12), one for each topic with JSON."""
    return {file_of(topic): _schema(topic) for topic in TOPICS if topic.message is not None}


def file_of(topic: Topic) -> str:
    """The name of a topic's schema."""
    return topic.name.replace("/", "-") + ".json"


def text(schema: dict[str, Any]) -> str:
    """``schema`` as it stands in a file."""
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def write_schemas(folder: Path) -> list[Path]:
    """Write all into ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, schema in schemas().items():
        (folder / name).write_text(text(schema), "utf-8")
        paths.append(folder / name)
    return paths


def topics_table() -> str:
    """The topics as a table in Markdown."""
    lines = ["| topic | holds | retained | QoS | expires |", "|---|---|---|---|---|"]
    for topic in TOPICS:
        schema = f" ([schema](mqtt-schemas/{file_of(topic)}))" if topic.message else ""
        way = "**in**: " if topic.inward else ""
        expires = "" if topic.expires_s is None else f"{topic.expires_s} s"
        retained = "yes" if topic.retained else ""
        lines.append(f"| `{topic.name}` | {way}{topic.says}{schema} | {retained} | {topic.quality} | {expires} |")
    return "\n".join(lines)


def write_topics(path: Path) -> None:
    """Put the table between the markers of ``path``.

    Raises:
        ValueError: it has no markers.
    """
    page = path.read_text("utf-8")
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"{path} has no lines {BEGIN!r} and {END!r}")
    path.write_text(f"{before}{BEGIN}\n{topics_table()}\n{END}{after}", "utf-8")


def _schema(topic: Topic) -> dict[str, Any]:
    assert topic.message is not None, "the caller has looked"
    (_,), components = msgspec.json.schema_components([topic.message], ref_template="#/$defs/{name}")
    structs = _structs(msgspec.inspect.type_info(topic.message))
    for name, component in components.items():
        notes = docs(structs[name]) if name in structs else {}  # an enum has none
        for key, field in component.get("properties", {}).items():
            if key in notes:
                field["description"] = notes[key]
            if "pattern" in field:  # JSON Schema writes regular expressions as ECMA-262, where ^ and $ mean the ends
                field["pattern"] = f"^{in_words(field['pattern'])}$"
    made = _with_null(components)
    root = made.pop(topic.message.__name__)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$comment": f"PREFIX/VEHICLE/{topic.name}; made by: groundstation mqtt schemas --write DIR",
        **root,
        **({"$defs": made} if made else {}),
    }


def _structs(info: msgspec.inspect.Type) -> dict[str, type[msgspec.Struct]]:
    """All structs in a type, by name."""
    found: dict[str, type[msgspec.Struct]] = {}
    if isinstance(info, msgspec.inspect.StructType):
        found[info.cls.__name__] = info.cls
    inner = [getattr(info, name) for name in ("type", "item_type", "value_type") if hasattr(info, name)]
    inner += [one for name in ("types", "item_types") for one in getattr(info, name, ())]
    for one in (*inner, *(field.type for field in getattr(info, "fields", ()))):
        found |= _structs(one)
    return found


def _with_null(schema: Any) -> Any:
    """JSON has no NaN and no infinity: wherever a number is, ``null`` may be."""
    if isinstance(schema, list):
        return [_with_null(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    made = {key: _with_null(value) for key, value in schema.items()}
    if made.get("type") == "number":
        made["type"] = ["number", "null"]
    return made
