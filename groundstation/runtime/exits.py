"""What each command's exit code means. docs/reference/exit-codes.md is written from here."""

from enum import IntEnum


class Exit(IntEnum):
    """Exit codes of flying."""

    DONE = 0
    """Landed, or did what it was asked to."""
    FAULT = 1
    """Ended otherwise than asked: aborted, killed, or landed because of a fault."""
    USAGE = 2
    """A bad configuration or command line; nothing was opened."""
    TAKEN = 3
    """Another ground station flies this vehicle already."""


INTERRUPTED = 130
"""Ctrl-C outside a flight."""

CODES: dict[str, dict[int, str]] = {
    "fly": {
        0: "landed",
        1: "aborted, killed, handed over, not confirmed, or landed because of a fault",
        3: "another ground station flies this vehicle already",
    },
    "daemon": {
        0: "SIGTERM or SIGINT ended it, with the vehicle landed or never armed; with `--once`: landed",
        1: "the last flight was aborted, killed or handed over, or something failed at the start",
        3: "another ground station flies this vehicle already, or its socket can't be served",
    },
    "fleet": {
        0: "every vehicle landed, or was never armed",
        1: "one of them was aborted, killed or handed over, landed because of a fault, or its core has died",
    },
    "service": {0: "the unit file is printed"},
    "request": {
        0: "done: the answer is printed",
        1: "refused: the reason is printed",
        2: "nobody there, or not clear who is meant",
    },
    "stop-all": {
        0: "every flight has answered, or none is there",
        1: "one did not answer, and got a signal; or `--kill` was not confirmed",
    },
    "health": {0: "alive and well", 1: "stale, or no command leaves in flight", 2: "no daemon runs"},
    "check": {
        0: "ready to fly",
        1: "a check fails, or (`--watch`) no poses",
        3: "(`--watch`) no such source",
    },
    "carry": {
        0: "the axes are found",
        1: "a move contradicts, or was not made",
        3: "poses or autopilot can't be heard",
    },
    "doctor": {0: "nothing to change", 1: "something to change, or not confirmed", 3: "no answer, or a refusal"},
    "props-off": {
        0: "passed, and kept on file",
        1: "not proven, interrupted, or it could not go on: the motors were ordered off",
        3: "another ground station flies this vehicle",
    },
    "trajectory": {0: "PASS", 1: "FAIL"},
    "identify": {0: "something was found", 1: "the flight tells nothing of thrust, lags and delay"},
    "replay": {
        0: "the same to the last bit (own recordings), or within its limits (.tlog)",
        1: "it differs, or the recording is damaged",
    },
}
"""What the codes of a command mean; those not named here have 0 for done and 1 for not done. 2 is usage in all."""


def markdown() -> str:
    """The table of docs/reference/exit-codes.md."""
    lines = ["| command | code | means |", "|---|---|---|"]
    for command, codes in CODES.items():
        lines += [f"| `{command}` | {code} | {means} |" for code, means in codes.items()]
    lines += [
        "| all others | 0 | done |",
        "| all others | 1 | not done: the reason is printed |",
        "| all | 2 | a bad command line or configuration; nothing was opened |",
        f"| all | {INTERRUPTED} | Ctrl-C, outside a flight |",
    ]
    return "\n".join(lines)
