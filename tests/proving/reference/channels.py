"""Every channel of a recording, with its fields."""

from msgspec import inspect as mi

from groundstation.recording.channels import CHANNELS
from tests.proving.reference.remarks import one_line, summary

HEAD = """# Channels of a recording

A recording is an MCAP file; each message is JSON, its schema in the file. Names end in units; world NED, body FRD;
`time_s` is the event loop's clock. `groundstation export LOG --channel TOPIC` writes one as CSV.
"""


def page() -> str:
    """The page."""
    return "\n\n".join([HEAD, *(_channel(topic, name, message) for topic, (name, message) in CHANNELS.items())])


def _channel(topic: str, name: str, message: type) -> str:
    info = mi.type_info(message)
    assert isinstance(info, mi.StructType), "every message is a struct"
    fields = ", ".join(f"`{field.encode_name}`" for field in info.fields)
    return f"## `{topic}`\n\n`{name}`: {one_line(summary(message))}\n\nFields: {fields}."
