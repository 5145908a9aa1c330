"""One flight: pre-arm checks, mission, command loop, shutdown, statistics."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.flight.flight import DISARM_WAIT_S, Flight, FlightOutcome, FrameLateness, make_ends
    from groundstation.flight.hold_to_run import HoldWatch, ensure_held, make_hold
    from groundstation.flight.prearm import Company, body_of, describe_checks, describe_failures, entry_of, link_of
    from groundstation.flight.preflight import (
        Proof,
        confirmation,
        describe_trajectory,
        digest,
        ensure_flyable,
        ensure_guarded,
        ensure_link,
        ensure_named,
        examine_trajectory,
        explain_refusal,
        is_simulated,
        key,
        line_from_terminal,
        place,
        save,
    )

_MODULES = {
    "flight": ("DISARM_WAIT_S", "Flight", "FlightOutcome", "FrameLateness", "make_ends"),
    "hold_to_run": ("HoldWatch", "ensure_held", "make_hold"),
    "prearm": ("Company", "body_of", "describe_checks", "describe_failures", "entry_of", "link_of"),
    "preflight": (
        "Proof",
        "confirmation",
        "describe_trajectory",
        "digest",
        "ensure_flyable",
        "ensure_guarded",
        "ensure_link",
        "ensure_named",
        "examine_trajectory",
        "explain_refusal",
        "is_simulated",
        "key",
        "line_from_terminal",
        "place",
        "save",
    ),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
