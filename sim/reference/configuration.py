"""Every key of a configuration: what it accepts, its default, and what it is for."""

from collections.abc import Iterator
from typing import Any

import msgspec
from msgspec import inspect as mi

from groundstation.config_schema import structs
from groundstation.config_words import expected
from groundstation.settings import Config
from links.bridge import BridgeConfig
from sim.reference.remarks import remarks, summary
from sim.world import World

HEAD = """# Configuration keys

One TOML file, a section a table; `--set KEY=VALUE` on any command overrides a key. What is in force:
`groundstation config show FILE`. A key that is wrong stops the program at start, with its dotted name and what it
accepts. Units are in square brackets."""
BRIDGE = """## The bridge's own file

For `groundstation rf-bridge`, beside a `[link]` as above: [two computers](../how-to/two-computers.md)."""
TRUTH = """## What is simulated

`--set sim.KEY=VALUE` of `groundstation-sim` changes the truth, not what the controller is told."""
TABLE = "| key | accepts | default | |\n|---|---|---|---|"

Told = set[tuple[str, type[Any]]]
"""Tables that are on the page already: key and struct."""


def page() -> str:
    """The page."""
    return "\n\n".join(
        [
            HEAD,
            *_tables(mi.type_info(Config), "", None, set()),
            BRIDGE,
            *_tables(mi.type_info(BridgeConfig), "", None, set(), without=("link",)),
            TRUTH,
            *_tables(mi.type_info(World), "sim.", None, set()),
        ]
    )


def _tables(info: Any, path: str, default: Any, told: Told, without: tuple[str, ...] = ()) -> Iterator[str]:
    """The plain keys of the struct ``info`` as one table, then each of its sections."""
    fields = [field for field in info.fields if field.encode_name not in without]
    rows = [_row(path, field, _default(field, default), info.cls) for field in fields if not structs(field.type)]
    if rows:
        yield "\n".join([TABLE, *rows])
    for field in fields:
        base, remark = _default(field, default), remarks(info.cls).get(field.name, "")
        for struct in structs(field.type):
            yield from _section(f"{path}{field.encode_name}", struct, base, remark, told)


def _section(key: str, struct: mi.StructType, base: Any, remark: str, told: Told) -> Iterator[str]:
    if (key, struct.cls) in told:
        return
    told.add((key, struct.cls))
    kind = "" if struct.tag_field is None else f' with {struct.tag_field} = "{struct.tag}"'
    chosen = " (the default)" if kind and isinstance(base, struct.cls) else ""
    words = " ".join(text for text in (summary(struct.cls), remark) if text)
    yield f"{'#' * (2 + key.count('.'))} `[{key}]`{kind}{chosen}\n\n{words}"
    yield from _tables(struct, f"{key}.", base if isinstance(base, struct.cls) else None, told)


def _default(field: mi.Field, of: Any) -> Any:
    if of is not None:
        return getattr(of, field.name)
    if field.default_factory is not msgspec.NODEFAULT:
        return field.default_factory()
    return field.default


def _row(path: str, field: mi.Field, default: Any, cls: type[Any]) -> str:
    accepts = expected(field.type).replace("|", "\\|")
    return f"| `{path}{field.encode_name}` | {accepts} | {_shown(default)} | {remarks(cls).get(field.name, '')} |"


def _shown(default: Any) -> str:
    if default is msgspec.NODEFAULT:
        return "required"
    return "none" if default is None else f"`{msgspec.json.encode(msgspec.to_builtins(default)).decode()}`"
