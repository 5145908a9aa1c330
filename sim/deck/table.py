"""The fault deck as text: a line a cell for a terminal, and a page with the whole table."""

from collections.abc import Sequence
from pathlib import Path

from groundstation.config import ConfigError
from sim.deck.cell import AUTOPILOT
from sim.deck.faults import FAULTS
from sim.deck.verdict import Row

HEAD = """# What a fault leads to

Every fault in every state of a mission, flown from the floor by the whole application against the simulated vehicle of
the scenario `paper` (80 g, 50 poses a second, a figure eight at 0.5 m/s, 2 m above the floor). Made by

<!-- not tested: it flies for minutes -->
```sh
{command}
```

- **Reaction**: the states that the fault led to ([mission.md](../explanation/mission.md)). *flies on*: the flight went
  on as planned, and landed. *autopilot lands*: its own failsafe, after set-points stopped.
- **After**: from the fault to the first of these.
- **Off by**: the largest true distance from the reference; where none is followed any more, sideways from where that
  began.
- **Floor met at**: the fastest time that it came down to the floor, by the truth.
- **Safe**: no number that is not finite left, no command left that was not due (each frame on the wire is held against
  the newest command before its deadline, or its bring-down after it), no lean beyond 60°, the vehicle rests on the
  floor with its motors off in the end, and met it at less than 1 m/s. The last is not asked where the fault takes away
  what it needs: thrust, or both the poses and an attitude loop that could land; the table then says so.

The autopilot of MAVLink flights says that it knows its own position: where we can't see the vehicle any more it is
asked to land, and open-loop rates are only played until it does. Without an autopilot that could, see *dropout, radio*.
The autopilot holds the last set-point for {held} s when they stop (`COM_OF_LOSS_T`, from 0.2 to 0.5 s by
[px4.md](../how-to/px4.md)); with 1 s a process that is killed leaves a vehicle that leans and falls for so long.

"""


def text(rows: Sequence[Row]) -> str:
    """For a terminal."""
    lines = []
    for row in rows:
        verdict = "safe  " if row.safe else "UNSAFE"
        after = "" if row.answer_ms is None else f"after {row.answer_ms:.0f} ms"
        met = "" if row.touchdown_m_s is None else f"floor at {row.touchdown_m_s:.2f} m/s"
        lines.append(
            f"{verdict} {row.fault:21}{row.state:10} {row.reaction:34}{after:16}off {row.peak_error_m:5.2f} m  {met}"
        )
        if row.why and not row.safe:
            lines.append(f"       {row.why}")
    bad = sum(not row.safe for row in rows)
    return "\n".join([*lines, f"{len(rows)} cells, {bad} unsafe"])


def page(rows: Sequence[Row], command: str) -> str:
    """The whole page in Markdown; ``command`` made it."""
    lines = [HEAD.format(command=command, held=AUTOPILOT["COM_OF_LOSS_T"])]
    for name in dict.fromkeys(row.fault for row in rows):
        here = [row for row in rows if row.fault == name]
        lines += [f"## {name}", "", f"{FAULTS[name].says[0].upper()}{FAULTS[name].says[1:]}.", ""]
        lines += [
            "| in | reaction | after | off by | floor met at | safe | why |",
            "|---|---|---:|---:|---:|---|---|",
        ]
        lines += [_line(row) for row in here]
        lines.append("")
    return "\n".join(lines)


def _line(row: Row) -> str:
    after = "" if row.answer_ms is None else f"{row.answer_ms:.0f} ms"
    met = "" if row.touchdown_m_s is None else f"{row.touchdown_m_s:.2f} m/s"
    safe = "yes" if row.safe else "**NO**"
    why = row.why.replace("|", "\\|")
    return f"| {row.state} | {row.reaction} | {after} | {row.peak_error_m:.2f} m | {met} | {safe} | {why} |"


def write(path: Path, rows: Sequence[Row], command: str) -> None:
    """Write the page.

    Raises:
        ConfigError: the file can't be written.
    """
    try:
        path.write_text(page(rows, command), "utf-8")
    except OSError as error:
        raise ConfigError("--write", f"cannot write {path}: {error.strerror}") from None
