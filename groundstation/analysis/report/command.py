"""``groundstation report LOG [LOG2]``: what a recorded flight was like, as one page with its figures, or as numbers."""

import json
from collections.abc import Sequence
from pathlib import Path

from groundstation.config import ConfigError
from groundstation.recording import NoRecording
from groundstation.runtime import require_matplotlib


def report_command(paths: Sequence[Path], out: Path | None, *, as_json: bool) -> int:
    """Write the page of one or two recordings into the folder ``out`` (default: beside the first); returns 0.

    With ``as_json`` the numbers are printed, and drawn only where ``out`` is given.

    Raises:
        ConfigError: a file is no recording of commands, matplotlib is missing, or the page can't be written.
    """
    draw = out is not None or not as_json
    if draw:
        require_matplotlib(
            "report", "its figures need matplotlib: pip install 'quadrotor-groundstation[plot]'; --json does without"
        )
    if len(paths) > 2:
        raise ConfigError("LOG", f"expected one recording, or two to compare, got {len(paths)}")
    from groundstation.analysis.report.flown import NoCommand, read
    from groundstation.analysis.report.numbers import numbers

    try:
        flights = [read(path) for path in paths]
    except (NoRecording, NoCommand) as error:
        raise ConfigError("LOG", str(error)) from None
    except OSError as error:
        raise ConfigError("LOG", f"cannot read {error.filename}: {error.strerror}") from None
    facts = [numbers(flight) for flight in flights]
    page = None
    if draw:
        from groundstation.analysis.report.figures import drawn
        from groundstation.analysis.report.page import write

        folder = out or paths[0].with_name(f"{paths[0].stem}-report")
        try:
            folder.mkdir(parents=True, exist_ok=True)
            page = write(folder, drawn(folder, flights), facts)
        except OSError as error:
            raise ConfigError("--out", f"cannot write {error.filename or folder}: {error.strerror}") from None
    print(json.dumps({"flights": facts, "page": str(page) if page else None}) if as_json else page)
    return 0
