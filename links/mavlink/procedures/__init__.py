"""Procedures that an autopilot goes through with us, sans-IO: arming, parameters, message rates."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from links.mavlink.procedures.handshake import MULTIROTORS, arming, disarming, fitness, landing, landing_disarmed
    from links.mavlink.procedures.mode import AskMode, question
    from links.mavlink.procedures.parameters import (
        REAL32,
        WHOLE_BITS,
        Parameter,
        ReadAll,
        Write,
        decode,
        encode,
        is_same,
    )
    from links.mavlink.procedures.steps import Autopilot, Handshake, Step
    from links.mavlink.procedures.stop import Kill
    from links.mavlink.procedures.streams import choose_streams
    from links.mavlink.procedures.version import ReadVersion

_MODULES = {
    "handshake": ("MULTIROTORS", "arming", "disarming", "fitness", "landing", "landing_disarmed"),
    "mode": ("AskMode", "question"),
    "parameters": ("Parameter", "REAL32", "ReadAll", "WHOLE_BITS", "Write", "decode", "encode", "is_same"),
    "steps": ("Autopilot", "Handshake", "Step"),
    "stop": ("Kill",),
    "streams": ("choose_streams",),
    "version": ("ReadVersion",),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
