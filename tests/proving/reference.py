"""Pages of docs/reference, ``groundstation-sim dev reference --write docs/reference``.

The words of a page stand in the page, and between its markers what is made here from the code.
"""

import argparse
import ast
import functools
import inspect
import json
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

import msgspec
from msgspec import inspect as mi

import groundstation as gs
from groundstation.__main__ import parser as flying
from groundstation.analysis import Channel, Track
from groundstation.config import (
    describe_pattern,
    describe_type,
    field_descriptions,
    refuse_io,
    structs,
)
from groundstation.core.messages import NOTICES
from groundstation.core.mission import FINAL, TABLE as TRANSITIONS, Event, State
from groundstation.core.safety import list_limits
from groundstation.interfaces.mqtt import TOPICS, Topic
from groundstation.machine import fill_markers, replace_between_markers
from groundstation.recording import CHANNELS
from groundstation.runtime import Program
from groundstation.settings import Config
from links.bridge import BridgeConfig
from sim.__main__ import parser as simulating
from sim.studies import Contribution
from sim.studies.campaign import COLUMNS, CampaignRow
from sim.text import SIM_NOTICES
from sim.world import World

ROOT = Path(__file__).resolve().parents[2]
HOUSES = ("sim", "groundstation", "links")


def make_table(head: str, rows: Iterable[str], aligned: str = "") -> str:
    """A table of Markdown from the lines of its head and of its ``rows``."""
    return "\n".join([head, aligned or "|---" * (head.count("|") - 1) + "|", *rows])


def describe_rooms() -> str:
    """Every folder of the three packages, and the first sentence of its face."""
    rows = []
    for face in (path for house in HOUSES for path in sorted((ROOT / house).rglob("__init__.py"))):
        text = ast.get_docstring(ast.parse(face.read_text("utf-8"))) or ""
        sentence = " ".join(text.partition("\n\n")[0].split())
        rows.append(f"| `{face.parent.relative_to(ROOT).as_posix()}/` | {sentence} |")
    return make_table("| room | what is in it |", rows)


ROLE = re.compile(r":\w+:`~?([^`]+)`")


def remarks(cls: type[Any]) -> dict[str, str]:
    """Field → its description or the docstring below it, or below a base's, as one line."""
    found: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        if base.__module__.split(".")[0] in HOUSES:
            for field, text in _below(base).items():
                if field not in found or text[:4] != "See ":
                    found[field] = text
    if issubclass(cls, msgspec.Struct):
        found |= {key: one_line(text) for key, text in field_descriptions(cls).items()}
    return found


def _below(cls: type[Any]) -> dict[str, str]:
    """Return the docstrings below the fields of ``cls``, by field."""
    found: dict[str, str] = {}
    for pair in pairwise(_definition(cls).body):
        match pair:
            case ast.AnnAssign(ast.Name(field)), ast.Expr(ast.Constant(str(text))):
                found[field] = one_line(text)
    return found


def _definition(of: Any) -> Any:
    """Return the definition of a class or function in its module's source."""
    (node,) = (one for one in _tree(of.__module__).body if getattr(one, "name", "") == of.__name__)
    return node


@functools.cache
def _tree(module: str) -> ast.Module:
    return ast.parse(inspect.getsource(sys.modules[module]))


def one_line(text: str) -> str:
    """A docstring as one line of Markdown, for a cell of a table too."""
    return ROLE.sub(r"`\1`", " ".join(text.split())).replace("``", "`").replace("|", "\\|")


def summary(cls: type[Any]) -> str:
    """The first paragraph of the class's docstring."""
    return one_line((cls.__doc__ or "").strip().split("\n\n")[0])


def describe_programs() -> str:
    """Every command of both programs."""
    return "\n\n".join([*_commands(flying()), *_commands(simulating())])


def _commands(parser: Program, help_: str = "", level: int = 2) -> Iterator[str]:
    # argparse has no public way to ask what it knows.
    inner = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    yield f"{'#' * level} `{parser.prog}`\n\n{_sentence(parser.description or help_)}".rstrip()
    arguments = [one for one in parser._actions if one not in inner and one.dest != "help"]
    rows = [_argument_row(one) for one in arguments if one.help != argparse.SUPPRESS]
    if rows:
        yield make_table("| argument | |", rows)
    commands, helps = dict(parser.below), dict[str, str]()
    for action in inner:
        commands |= action.choices
        helps |= {choice.dest: choice.help or "" for choice in action._choices_actions}
    helps |= {name: does for group in parser.groups.values() for name, (does, _) in group.items()}
    for name, command in commands.items():
        yield from _commands(command, helps.get(name, ""), level + 1)


def _argument_row(action: argparse.Action) -> str:
    choices = f"{{{','.join(map(str, action.choices))}}}" if action.choices else ""
    value: Any = action.metavar or choices
    if not value and action.nargs != 0:
        value = action.dest.upper()
    names = ", ".join(f"{name} {value}".strip() for name in action.option_strings) or str(value)
    return f"| `{names}` | {_sentence(action.help or '')} |".replace("{", "(").replace("}", ")")


def _sentence(text: str) -> str:
    text = text and f"{text[0].upper()}{text[1:].removesuffix('.')}."
    return text.replace("|", "\\|").replace("%%", "%")


Told = set[tuple[str, type[Any]]]
"""Tables that are on the page already: key and struct."""


def describe_keys(root: type[Any], path: str = "", without: tuple[str, ...] = ()) -> str:
    """Every key of a ``root``, each section ``without`` those that are told elsewhere."""
    return "\n\n".join(_tables(mi.type_info(root), path, None, set(), without))


def _tables(
    info: Any, path: str, default: Any, told: Told, without: tuple[str, ...] = ()
) -> Iterator[str]:
    """The plain keys of the struct ``info`` as one table, then each of its sections."""
    fields = [field for field in info.fields if field.encode_name not in without]
    plain = [field for field in fields if not structs(field.type)]
    if plain:
        rows = [_row(path, field, _default(field, default), info.cls) for field in plain]
        yield make_table("| key | accepts | default | |", rows)
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
    accepts = describe_type(field.type).replace("|", "\\|")
    remark = remarks(cls).get(field.name, "")
    return f"| `{path}{field.encode_name}` | {accepts} | {_show(default)} | {remark} |"


def _show(default: Any) -> str:
    if default is msgspec.NODEFAULT:
        return "required"
    encoded = msgspec.json.encode(msgspec.to_builtins(default)).decode()
    return "none" if default is None else f"`{encoded}`"


def describe_channels() -> str:
    """Every channel of a recording."""
    parts = []
    for topic, (name, message) in CHANNELS.items():
        fields = ", ".join(f"`{field.name}`" for field in msgspec.structs.fields(message))
        parts.append(f"## `{topic}`\n\n`{name}`: {summary(message)}\n\nFields: {fields}.")
    return "\n\n".join(parts)


def describe_messages() -> str:
    """A table of all sentences for the operator, for each room one."""
    parts = []
    every = sorted((*NOTICES.values(), *SIM_NOTICES), key=lambda row: row.id)
    for room, rows in groupby(every, key=lambda row: row.id.split(".")[0]):
        lines = [
            f"| `{row.id}` | {row.severity} | {_cell(row.sentence)} | {_cell(row.remedy)} |"
            for row in rows
        ]
        table = make_table("| id | severity | sentence | what to do |", lines)
        parts.append(f"## {room}\n\n{table}")
    return "\n\n".join(parts)


def _cell(text: str) -> str:
    """``text`` with its places for values as a table shows them: ``{age_ms:.0f}`` as *age_ms*."""
    return re.sub(r"\{(\w+)[^}]*\}", r"*\1*", text).replace("|", "\\|")


def describe_columns() -> str:
    """Every column of a campaign's table."""
    said = remarks(World) | remarks(CampaignRow)
    rows = (f"| `{name}` | {said.get(name, '')} |" for name in COLUMNS)
    return make_table("| column | |", rows)


def describe_guards() -> str:
    """Every limit in flight, as a configuration has it that says nothing else."""
    config = Config()
    rows = [
        f"| {one.says} | `{one.key}`{'' if one.limit is None else f' {_show(one.limit)}'} | "
        f"{one.lasts_s:g} | {one.step} | {one.most} | {_sentence(one.remedy)} |"
        for one in list_limits(config, config.guards)
    ]
    head = "| guard | limit | for, s | what follows | at most | what to do |"
    return make_table(head, rows, "|---|---|---:|---|---|---|")


def describe_python(things: Iterable[Any], level: int = 3) -> str:
    """Show functions and classes of Python code as a caller sees them: without what they do."""
    return "\n\n".join(
        f"{'#' * level} `{one.__name__}`\n\n```text\n{_show_source(one)}\n```" for one in things
    )


def _show_source(of: Any) -> str:
    """The lines of a definition but for the bodies of its functions and what is private."""
    lines = inspect.getsource(sys.modules[of.__module__]).splitlines()

    def parts(node: Any) -> Iterator[str]:
        first, *others = node.body
        start = node.lineno - len(node.decorator_list) * (node is not _definition(of))
        yield "\n".join(lines[start - 1 : first.end_lineno])
        for one in others if isinstance(node, ast.ClassDef) else ():
            if isinstance(one, ast.FunctionDef) and re.match("[a-z]|__getitem__", one.name):
                yield from ("", *parts(one))
            elif isinstance(one, ast.AnnAssign | ast.Expr) and "ClassVar" not in ast.unparse(one):
                yield "\n".join(lines[one.lineno - 1 : one.end_lineno])

    return ROLE.sub(r"\1", "\n".join(parts(_definition(of))))


EVERYWHERE = (Event.LAND, Event.DESCEND, Event.ABORT, Event.KILL, Event.TAKEN_OVER)
"""Drawn once beside the diagram, as arrows from everywhere would hide all others."""


def mermaid() -> str:
    """The way of a flight as a Mermaid state diagram, but for what :func:`everywhere` shows."""
    lines = ["stateDiagram-v2", f"    [*] --> {State.IDLE}"]
    arrows: dict[tuple[State, State], list[str]] = {}
    for (state, event), target in TRANSITIONS.items():
        if event not in EVERYWHERE:
            arrows.setdefault((state, target), []).append(event.value)
    lines += [
        f"    {state} --> {target}: {', '.join(events)}"
        for (state, target), events in arrows.items()
    ]
    lines += [f"    {state} --> [*]" for state in State if state in FINAL]
    return "\n".join(lines)


def everywhere() -> str:
    """One row a state: where the requests lead that work in every state, as a Markdown table."""
    heads = " | ".join(f"`{event}`" for event in EVERYWHERE)
    rows = []
    for state in State:
        targets = (TRANSITIONS.get((state, event)) for event in EVERYWHERE)
        cells = " | ".join(
            "" if target is None else "stays" if target is state else target for target in targets
        )
        rows.append(f"| `{state}` | {cells} |")
    return make_table(f"| in | {heads} |", rows)


def states_page() -> str:
    """The text that stands between the markers of docs/explanation/safety.md."""
    command = "groundstation-sim dev reference --write docs/reference"
    made = f"Made from the table in `groundstation/core/mission/mission.py` by `{command}`."
    return f"```mermaid\n{mermaid()}\n```\n\n{everywhere()}\n\n{made}"


def make_schemas() -> dict[str, dict[str, Any]]:
    """File name -> JSON Schema (draft 2020-12), one for each topic with JSON."""
    return {_schema_file(topic): _schema_of(topic) for topic in TOPICS if topic.message is not None}


def _schema_file(topic: Topic) -> str:
    return topic.name.replace("/", "-") + ".json"


def schema_text(schema: dict[str, Any]) -> str:
    """``schema`` as it stands in a file."""
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def describe_topics() -> str:
    """The topics of MQTT."""
    rows = []
    for topic in TOPICS:
        schema = f" ([schema](mqtt-schemas/{_schema_file(topic)}))" if topic.message else ""
        says = f"{'**in**: ' * topic.inward}{topic.says}{schema}"
        expires = "" if topic.expires_s is None else f"{topic.expires_s} s"
        told = (f"`{topic.name}`", says, "yes" * topic.retained, str(topic.quality), expires)
        rows.append(f"| {' | '.join(told)} |")
    return make_table("| topic | holds | retained | QoS | expires |", rows)


def _schema_of(topic: Topic) -> dict[str, Any]:
    assert topic.message is not None, "the caller has looked"
    (_,), components = msgspec.json.schema_components(
        [topic.message], ref_template="#/$defs/{name}"
    )
    made = _as_published(components)
    root = made.pop(topic.message.__name__)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$comment": f"PREFIX/VEHICLE/{topic.name}; made by: groundstation-sim dev reference",
        **root,
        **({"$defs": made} if made else {}),
    }


def _as_published(schema: Any) -> Any:
    """JSON has no NaN and no infinity: wherever a number is, ``null`` may be.

    JSON Schema writes regular expressions as ECMA-262, where ^ and $ mean the ends.
    """
    if isinstance(schema, list):
        return [_as_published(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    made = {key: _as_published(value) for key, value in schema.items()}
    if made.get("type") == "number":
        made["type"] = ["number", "null"]
    if isinstance(made.get("pattern"), str):
        made["pattern"] = f"^{describe_pattern(made['pattern'])}$"
    return made


PAGES: dict[str, dict[str, Callable[[], str]]] = {
    "configuration.md": {
        "keys": lambda: describe_keys(Config),
        "bridge": lambda: describe_keys(BridgeConfig, without=("link",)),
        "truth": lambda: describe_keys(World, "sim."),
    },
    "commands.md": {"commands": describe_programs},
    "recording-channels.md": {"channels": describe_channels},
    "campaign-columns.md": {"columns": describe_columns},
    "guards.md": {"guards": describe_guards},
    "messages.md": {"messages": describe_messages},
    "mqtt.md": {"mqtt-topics": describe_topics},
    "python.md": {
        "calls": lambda: describe_python((
            gs.simulate, gs.compare, gs.load, gs.error_budget, gs.Run, gs.FlightData, Track,
            Channel, gs.ControllerComparison, gs.ErrorBudget, Contribution,
        ), 2),
        "given": lambda: describe_python((
            gs.Vehicle, gs.Estimate, gs.Motion, gs.Reference, gs.ActuatorCommand, gs.Decision,
            gs.Diagnostics,
        )),
        "helpers": lambda: describe_python((
            gs.specific_thrust, gs.half_angle_error, gs.sine_error, gs.turning, gs.clamp_command,
            gs.make_decision, gs.Baseline, gs.InnerLoop,
        )),
        "asking": lambda: describe_python(
            (gs.ask_station, gs.Request, gs.Waypoint, gs.OrderAnswer)
        ),
    },
    "rooms.md": {"rooms": describe_rooms},
}  # fmt: skip
"""File → what stands between its markers, by their name."""

SCHEMAS = "mqtt-schemas"
"""Folder of the JSON Schemas, beside the pages."""


def page(name: str) -> str:
    """The whole text of that page: its own words, and what is made from the code now."""
    return fill_markers(
        ROOT / "docs" / "reference" / name, {part: make() for part, make in PAGES[name].items()}
    )


def reference_command(folder: Path | None) -> str:
    """Write pages and schemas into ``folder`` and the states beside it; None: return the text.

    Raises:
        ConfigError: a page can't be written.
    """
    if folder is None:
        return "\n".join(page(name) for name in PAGES)
    for name in PAGES:
        with refuse_io("--write", "file.unwritten", folder / name):
            folder.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(page(name), "utf-8")
    (folder / SCHEMAS).mkdir(exist_ok=True)
    for name, schema in make_schemas().items():
        (folder / SCHEMAS / name).write_text(schema_text(schema), "utf-8")
    safety = folder.parent / "explanation" / "safety.md"
    if safety.exists():
        replace_between_markers(safety, states_page(), "states")
    written = [*PAGES, *(f"{SCHEMAS}/{name}" for name in make_schemas())]
    return "\n".join(f"{folder / name} written" for name in written)
