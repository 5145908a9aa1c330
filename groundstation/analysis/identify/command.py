"""``groundstation identify LOG``: what a recorded flight tells of its vehicle: thrust, lags, delay, drag and noise."""

import json
from pathlib import Path

from groundstation.config import ConfigError
from groundstation.recording import NoRecording
from groundstation.runtime import require_matplotlib

EXIT_FOUND, EXIT_NOTHING = 0, 1
NEEDED = ("thrust_scale", "thrust_lag", "rate_lag", "command_delay")
"""What a vehicle file is written for: without any of them there is nothing to write."""


def identify_command(path: Path, out: Path | None, page: Path | None, *, as_json: bool) -> int:
    """Print what the recording at ``path`` tells; write a vehicle file ``out`` and the fits into the folder ``page``.

    Returns 1 where it tells nothing of thrust, lags and delay, else 0.

    Raises:
        ConfigError: the file is no recording, holds too little flight or tells nothing to write, matplotlib is
            missing, or a file can't be written or is there already.
    """
    if page is not None:
        require_matplotlib("--page", "its figures need matplotlib: pip install 'quadrotor-groundstation[plot]'")
    if out is not None and out.exists():
        raise ConfigError("--out", f"{out} is there already")
    from groundstation.analysis.identify.found import identified
    from groundstation.analysis.identify.parameter import FLY
    from groundstation.analysis.identify.seen import NotEnough, read
    from groundstation.analysis.identify.text import facts, table

    try:
        found = identified(read(path))
    except (NoRecording, NotEnough) as error:
        raise ConfigError("LOG", str(error)) from None
    except OSError as error:
        raise ConfigError("LOG", f"cannot read {error.filename}: {error.strerror}") from None
    knows = any(found.parameters[name].identified for name in NEEDED)
    if out is not None:
        if not knows:
            raise ConfigError("--out", f"nothing to write: thrust, lags and delay are {FLY}")
        from groundstation.analysis.identify.text import file_text

        text = file_text(found)
        try:
            out.write_text(text, "utf-8")
        except OSError as error:
            raise ConfigError("--out", f"cannot write {out}: {error.strerror}") from None
    shown = None
    if page is not None:
        from groundstation.analysis.identify.figures import drawn
        from groundstation.analysis.identify.text import write

        try:
            page.mkdir(parents=True, exist_ok=True)
            shown = write(page, found, drawn(page, found))
        except OSError as error:
            raise ConfigError("--page", f"cannot write {error.filename or page}: {error.strerror}") from None
    if as_json:
        written = {"vehicle_file": str(out) if out else None, "page": str(shown) if shown else None}
        print(json.dumps({**facts(found), **written}))
    else:
        print(table(found))
        for written_to in (out, shown):
            if written_to is not None:
                print(f"written to {written_to}")
    return EXIT_FOUND if knows else EXIT_NOTHING
