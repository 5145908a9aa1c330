"""One flight: pre-arm checks, mission, command loop, shutdown, statistics."""

from groundstation.flight import checks as checks
from groundstation.flight import preflight as preflight

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.flight.checks import Company, body_of, entry_of, link_of
    from groundstation.flight.confirm import confirmation, ensure_named, line_from_terminal
    from groundstation.flight.ends import make_ends
    from groundstation.flight.flight import Flight, Outcome
    from groundstation.flight.pacing import Due
    from groundstation.flight.preflight import ensure_flyable, ensure_guarded, ensure_link, is_simulated, key, look
    from groundstation.flight.proof import Proof, digest, place, save
    from groundstation.flight.sender import DISARM_WAIT_S

_MODULES = {
    "checks": ("Company", "body_of", "entry_of", "link_of"),
    "confirm": ("confirmation", "ensure_named", "line_from_terminal"),
    "ends": ("make_ends",),
    "flight": ("Flight", "Outcome"),
    "pacing": ("Due",),
    "preflight": ("ensure_flyable", "ensure_guarded", "ensure_link", "is_simulated", "key", "look"),
    "proof": ("Proof", "digest", "place", "save"),
    "sender": ("DISARM_WAIT_S",),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
