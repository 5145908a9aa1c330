"""Several vehicles: their cores together, and the relay of poses between them."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.lab.fleet.plan import Fleet, Member, read_fleet
    from groundstation.lab.fleet.relay import Relay, run_relay

_MODULES = {"plan": ("Fleet", "Member", "read_fleet"), "relay": ("Relay", "run_relay")}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
