"""Output of ``groundstation-sim fly`` for a person: a progress bar, and a summary beside the
paper's figures.
"""

import shlex
import sys
from pathlib import Path
from typing import Any

from groundstation.runtime import raw_stream


def typed_command() -> str:
    """The command that runs now, as it was typed: a document says by it how its figures are made
    again.
    """
    return shlex.join(["groundstation-sim", *sys.argv[1:]])


class ProgressBar:
    """A bar on stderr while a flight is flown, or many things are done.

    It is shown once it is known of how many.
    """

    def __init__(self, label: str, total: float | None = None, *, quiet: bool = False) -> None:
        """``label`` is what ``total`` counts; ``quiet``, or with no terminal, nothing is shown."""
        self._label, self._total, self._quiet = label, total, quiet or not sys.stderr.isatty()
        self._bar: Any = None
        self._done = 0.0

    def __enter__(self) -> "ProgressBar":
        if self._total is not None:
            self.at(0.0)
        return self

    def at(self, done: float, total: float | None = None) -> None:
        """Show the progress: ``done`` of ``total``."""
        self._done, self._total = done, total or self._total
        if self._quiet or self._total is None:
            return
        if self._bar is None:
            self._bar = _make_bar()
            self._bar.start()
            self._task = self._bar.add_task(self._label, total=self._total)
        self._bar.update(self._task, completed=min(done, self._total))

    def step(self) -> None:
        """One more is done."""
        self.at(self._done + 1)

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()


def _make_bar() -> Any:
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    return Progress(*columns, console=Console(file=raw_stream(sys.stderr)))


def summary(facts: dict[str, Any], folder: Path | None, *, paper: bool) -> str:
    """The flight's figures as a few lines of text.

    With ``paper``, beside those of the paper, whose flight it is.
    """
    from groundstation.core.messages import (  # --help imports this module, too
        LEAST_JUDGED_S,
        PAPER,
    )

    title = f"{facts['scenario']}, controller {facts['controller']}, seed {facts['seed']}"
    if not facts["completed"]:
        title += f"\nNOT COMPLETED after {facts['duration_s']:.1f} s: {facts['why']}"
    lines = [title, ""]
    if paper:
        lines.append(f"{'':24}{'this flight':>14}{'the paper':>14}")
    for key, label, unit in (
        ("rms_cm", "RMS error, true", "cm"),
        ("max_cm", "largest error, true", "cm"),
        ("settle_s", "settled (< 10 cm) after", "s"),
    ):
        none = "never" if key == "settle_s" else "-"
        value = none if facts[key] is None else f"{facts[key]:.2f} {unit}"
        lines.append(f"{label:24}{value:>14}" + (f"{PAPER[key]:>11.2f} {unit}" if paper else ""))
    if facts["estimate_rms_cm"] is not None:
        lines.append(f"{'RMS error, by estimate':24}{facts['estimate_rms_cm']:>11.2f} cm")
    if facts["completed"] and facts["rms_cm"] is None:
        lines.append(f"errors take a flight of {LEAST_JUDGED_S:.0f} s: this one was shorter")
    if facts["gust_peak_cm"] is not None:
        back = "never" if facts["gust_back_s"] is None else f"{facts['gust_back_s']:.2f} s"
        lines.append(f"{'gust: largest error':24}{facts['gust_peak_cm']:>11.2f} cm")
        lines.append(f"{'gust: under 5 cm after':24}{back:>14}")
    return "\n".join([*lines, "", *_describe_forces(facts), *_describe_course(facts, folder)])


def _describe_forces(facts: dict[str, Any]) -> list[str]:
    """Wind, disturbance and its estimate, and the thrust that they took."""
    lines = [
        f"{'wind, true':24}{_vector(facts['wind_true'])} m/s² (north, east, down; mean of the "
        "last second)",
        f"{'disturbance, true':24}{_vector(facts['disturbance_true'])} m/s²: wind; drag, thrust, "
        "mass not as told",
        f"{'disturbance, estimated':24}{_vector(facts['disturbance_found'])} m/s²: the sum of "
        "these",
        f"{'of which, 95 % sure':24}{_describe_split(facts['disturbance'])}",
    ]
    if facts["thrust_min_n"] is not None:
        lines.append(
            f"{'thrust commanded':24}{facts['thrust_min_n']:.3f} … {facts['thrust_max_n']:.3f} N"
        )
    return lines


def _describe_course(facts: dict[str, Any], folder: Path | None) -> list[str]:
    """The certificate, the warnings, and how the flight went."""
    from groundstation.core.messages import SATURATION_FROM_S  # --help imports this module, too

    violated = 100.0 * facts["certificate_violated"]
    suspended = 100.0 * facts["certificate_suspended"]
    shown = f"{violated:.2f} % of the time, suspended {suspended:.2f} %"
    lines = [f"{'V above its bound':24}{'–' if facts['lyapunov_start'] is None else shown}"]
    for key, label in (
        ("certificate_warnings", "  told, at [s]"),
        ("warnings", "told in flight, at [s]"),
    ):
        lines += [f"{'' if i else label:24}{line}" for i, line in enumerate(facts[key])]
    at_limit = "–"
    if facts["duration_s"] > SATURATION_FROM_S:
        at_limit = f"{100.0 * facts['saturated_fraction']:.2f} %"
    lines += [
        f"{'commands at a limit':24}{at_limit} (after the first {SATURATION_FROM_S:g} s)",
        f"{'wall time':24}{facts['wall_s']:.2f} s for {facts['duration_s']:.0f} s, "
        f"{facts['datagrams']} datagrams",
    ]
    if folder is not None:
        lines.append(f"{'written to':24}{folder}")
    return lines


def _describe_split(disturbance: dict[str, Any] | None) -> str:
    import msgspec

    from groundstation.core.messages import DisturbanceReading

    return (
        "-"
        if disturbance is None
        else msgspec.convert(disturbance, DisturbanceReading).describe_split()
    )


def _vector(v: tuple[float, float, float]) -> str:
    return f"({v[0]:+.3f}, {v[1]:+.3f}, {v[2]:+.3f})"
