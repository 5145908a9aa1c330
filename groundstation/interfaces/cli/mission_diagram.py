"""The mission's table as a Mermaid diagram and as text, for the documentation. Sans-IO but for :func:`write`."""

from pathlib import Path

from groundstation.config import ConfigError
from groundstation.core.mission import FINAL, TABLE, Event, State

BEGIN, END = "<!-- states:begin -->", "<!-- states:end -->"
EVERYWHERE = (Event.LAND, Event.DESCEND, Event.ABORT, Event.KILL, Event.TAKEN_OVER)
"""Drawn once beside the diagram, as arrows from everywhere would hide all others."""


def mermaid() -> str:
    """The way of a flight as a Mermaid state diagram; what works everywhere is left to :func:`everywhere`."""
    lines = ["stateDiagram-v2", f"    [*] --> {State.IDLE}"]
    arrows: dict[tuple[State, State], list[str]] = {}
    for (state, event), target in TABLE.items():
        if event not in EVERYWHERE:
            arrows.setdefault((state, target), []).append(event.value)
    lines += [f"    {state} --> {target}: {', '.join(events)}" for (state, target), events in arrows.items()]
    lines += [f"    {state} --> [*]" for state in State if state in FINAL]
    return "\n".join(lines)


def everywhere() -> str:
    """One row a state: where the requests lead that work in every state, as a Markdown table."""
    heads = " | ".join(f"`{event}`" for event in EVERYWHERE)
    lines = [f"| in | {heads} |", "|---|" + "---|" * len(EVERYWHERE)]
    for state in State:
        targets = (TABLE.get((state, event)) for event in EVERYWHERE)
        cells = " | ".join("" if target is None else "stays" if target is state else target for target in targets)
        lines.append(f"| `{state}` | {cells} |")
    return "\n".join(lines)


def markdown() -> str:
    """What stands between the markers of docs/explanation/mission.md."""
    made = (
        "Made from the table in `groundstation/core/mission/mission.py` by `groundstation states --write mission.md`."
    )
    return f"```mermaid\n{mermaid()}\n```\n\n{everywhere()}\n\n{made}"


def write(path: Path) -> None:
    """Replace what stands between the markers of ``path``.

    Raises:
        ConfigError: the file can't be read or written, or has not just one pair of markers.
    """
    try:
        text = path.read_text("utf-8")
        if text.count(BEGIN) != 1 or text.count(END) != 1 or text.index(END) < text.index(BEGIN):
            raise ConfigError("--write", f"{path} needs a line {BEGIN} and below it a line {END}, once each")
        before, after = text[: text.index(BEGIN) + len(BEGIN)], text[text.index(END) :]
        path.write_text(f"{before}\n{markdown()}\n{after}", "utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError("--write", f"cannot write {path}: {error}") from None
