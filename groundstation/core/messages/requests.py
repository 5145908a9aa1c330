"""What may be asked of a flight: the one way in, the same for a terminal, a signal, a screen and MQTT. Sans-IO."""

from enum import StrEnum

import msgspec


class Ask(StrEnum):
    """What is asked for. Whether it is possible now, the mission's table says."""

    ARM = "arm"
    """Start the motors and take off."""
    TRACK = "track"
    """Leave the hold for the trajectory."""
    HOLD = "hold"
    """Stop and stay there."""
    RETURN = "return"
    """Fly back over the place of take-off and land there."""
    LAND = "land"
    """Land here; before take-off, end the flight."""
    DESCEND = "descend"
    """Failsafe descent: level and down at once, by attitude and speed alone."""
    ABORT = "abort"
    """Commands stop; the link brings the vehicle down by itself."""
    KILL = "kill"
    """Motors off at once, also in the air."""


class Request(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One request, and why."""

    ask: Ask
    why: str = ""
    """Who asks and why, as the operator shall read it."""


class Reply(msgspec.Struct, frozen=True):
    """What became of a request."""

    done: bool
    says: str
    """What it does now, or why not, for the operator."""


def decode(text: bytes) -> Request | None:
    """The request in a JSON object such as ``{"ask": "land", "why": "MQTT"}``; None where it is none."""
    try:
        return msgspec.json.decode(text, type=Request)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None
