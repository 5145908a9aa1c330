"""The operator's own dead man: what must be held for a vehicle to fly."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.flight.hold_to_run.hold import Hold
    from groundstation.flight.hold_to_run.kinds import ensure_held, make_hold
    from groundstation.flight.hold_to_run.watch import HoldWatch

_MODULES = {"hold": ("Hold",), "kinds": ("ensure_held", "make_hold"), "watch": ("HoldWatch",)}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
