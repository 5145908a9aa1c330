"""The fault deck as text: a line a cell for a terminal, and a page with the whole table."""

from collections.abc import Sequence
from pathlib import Path

from groundstation.config import refuse_io
from tests.proving.faults.cell import AUTOPILOT
from tests.proving.faults.fault import REASONS
from tests.proving.faults.faults import FAULTS
from tests.proving.faults.judge import LIMITS, Row

HEAD = """# What a fault leads to

Every fault in every state of a mission, flown from the floor by the whole application against the simulated vehicle of
the scenario `paper` (80 g, 50 poses a second, a figure eight at 0.5 m/s, 2 m above the floor). Made by

<!-- not tested: it flies for minutes -->
```sh
{command}
```

- **In**: the state in which it strikes; *start* is before the first pose, so the flight begins with it.
- **Reaction**: the states that the fault led to ([mission.md](../explanation/mission.md)). *flies on*: the flight went
  on as planned, and landed. *autopilot lands*: its own failsafe, after set-points stopped.
- **After**: from the fault to the first of these.
- **Up**: highest above where it was struck, or above its course if that is higher.
- **Aside**: farthest sideways from where it was struck, carried along with its course.
- **Speed**: fastest that it moved.
- **Off by**: the largest true distance from the reference; where none is followed any more, sideways from where that
  began.
- **Floor met at**: the fastest time that it came down to the floor, by the truth.
- **Pushed**: for how long the commands after the answer gave more than what hovers.
- **Exempt**: what could not be asked of it, a word of the [table below](#exemptions).

A flight is cut short where a limit is broken. All but what is flown in real time comes out the same in every run.

The autopilot of MAVLink flights says that it knows its own position: where we can't see the vehicle any more it is
asked to land, and open-loop rates are only played until it does. Without an autopilot that could, see the rows *radio*.
The autopilot holds the last set-point for {held} s when they stop (`COM_OF_LOSS_T`, from 0.2 to 0.5 s by
[px4.md](../how-to/px4.md)); with 1 s a process that is killed leaves a vehicle that leans and falls for so long.

## Limits

A row is safe if all of these hold, by the truth, from the instant at which it was struck. Besides, no number that is
not finite left, and no command that was not due (each frame on the wire is held against the newest command before its
deadline, or its bring-down after it); the vehicle rests on the floor with its motors off in the end; and where poses
are true and the vehicle obeys, nobody convicts them.

| it | at most |
|---|---:|
{limits}

## Exemptions

| word | where, and what it lifts |
|---|---|
{exemptions}

"""


def text(rows: Sequence[Row]) -> str:
    """For a terminal."""
    lines = []
    for row in rows:
        verdict = "safe  " if row.safe else "UNSAFE"
        after = "" if row.answer_ms is None else f"after {row.answer_ms:.0f} ms"
        met = "" if row.touchdown_m_s is None else f"floor at {row.touchdown_m_s:.2f} m/s"
        lines.append(
            f"{verdict} {row.fault:32}{row.state:10} {row.reaction:34}{after:16}up {row.highest_m:5.2f} m  "
            f"aside {row.sideways_m:5.2f} m  {row.fastest_m_s:5.2f} m/s  {met}"
        )
        if row.why and not row.safe:
            lines.append(f"       {row.why}")
    bad = sum(not row.safe for row in rows)
    return "\n".join([*lines, f"{len(rows)} cells, {bad} unsafe"])


def page(rows: Sequence[Row], command: str) -> str:
    """The whole page in Markdown; ``command`` made it."""
    limits = "\n".join(f"| {what} | {most} |" for what, most in LIMITS)
    exemptions = "\n".join(f"| {word} | {why} |" for word, why in REASONS.items())
    held = AUTOPILOT["COM_OF_LOSS_T"]
    lines = [HEAD.format(command=command, held=held, limits=limits, exemptions=exemptions)]
    for name in dict.fromkeys(row.fault for row in rows):
        here = [row for row in rows if row.fault == name]
        lines += [f"## {name}", "", f"{FAULTS[name].says[0].upper()}{FAULTS[name].says[1:]}.", ""]
        lines += [
            "| in | reaction | after | up | aside | speed | off by | floor met at | pushed | exempt | safe | why |",
            "|---|---|---:|---:|---:|---:|---:|---:|---:|---|---|---|",
        ]
        lines += [_line(row) for row in here]
        lines.append("")
    return "\n".join(lines)


def _line(row: Row) -> str:
    after = "" if row.answer_ms is None else f"{row.answer_ms:.0f} ms"
    met = "" if row.touchdown_m_s is None else f"{row.touchdown_m_s:.2f} m/s"
    safe = "yes" if row.safe else "**NO**"
    why = row.why.replace("|", "\\|")
    return (
        f"| {row.state} | {row.reaction} | {after} | {row.highest_m:.2f} m | {row.sideways_m:.2f} m "
        f"| {row.fastest_m_s:.2f} m/s | {row.peak_error_m:.2f} m | {met} | {row.over_hover_s:.2f} s "
        f"| {row.exemption} | {safe} | {why} |"
    )


def write(path: Path, rows: Sequence[Row], command: str) -> None:
    """Write the page.

    Raises:
        ConfigError: the file can't be written.
    """
    with refuse_io("--write", f"cannot write {path}"):
        path.write_text(page(rows, command), "utf-8")
