"""The JSON schema of a channel's messages, as Foxglove reads it."""

import json
from typing import Any

import msgspec


def schema(name: str, message: type[msgspec.Struct]) -> bytes:
    """The JSON schema of ``message``, titled ``name``, without references and unions: Foxglove follows none.

    What may be null is not required, and has the type that it has otherwise.
    """
    (top,), parts = msgspec.json.schema_components([message], ref_template="{name}")
    whole = _inlined(parts[top["$ref"]], parts)
    return json.dumps({**whole, "title": name}).encode()


def _inlined(part: Any, parts: dict[str, Any]) -> Any:
    if isinstance(part, list):
        return [_inlined(item, parts) for item in part]
    if not isinstance(part, dict):
        return part
    if "$ref" in part:
        return _inlined(parts[part["$ref"]], parts)
    if "anyOf" in part:
        return _inlined(next(kind for kind in part["anyOf"] if kind != {"type": "null"}), parts)
    whole = {key: _inlined(value, parts) for key, value in part.items() if key not in ("title", "default")}
    if "properties" in part:
        always = [key for key in part.get("required", ()) if "anyOf" not in part["properties"][key]]
        whole["required"] = always
    return {"title": "time", **whole} if part.get("title") == "Time" else whole  # by this Foxglove knows a time
