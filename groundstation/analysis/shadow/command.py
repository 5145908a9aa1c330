"""``groundstation replay``: what our estimator and controller make of a recorded flight, without flying it."""

from pathlib import Path


def replay_command(file: Path, config: Path | None, overrides: list[str], *, as_json: bool) -> int:
    """Replay ``file`` (a .tlog), print a report (or one JSON object), and return 0 whatever the verdict.

    Without ``config`` the vehicle is as the recording shows it (vehicle.py).

    Raises:
        ConfigError: the configuration is bad, or the file can't be read or holds no poses.
    """
    import msgspec

    from groundstation.analysis.shadow.report import report, text_of

    result = report(file, config, overrides)
    print(msgspec.json.encode(result).decode() if as_json else text_of(result))
    return 0
