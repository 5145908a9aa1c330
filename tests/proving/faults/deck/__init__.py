"""The faults by name: how each strikes, when, and what can't be asked after it."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from tests.proving.faults.deck.fault import FALLS, REASONS, TUMBLES, Exemption, Fault, Poses, Scene
    from tests.proving.faults.deck.faults import BROKEN, FAULTS, STATES
    from tests.proving.faults.deck.meddler import Meddler
    from tests.proving.faults.deck.moments import DESCENT_AFTER_S, MOMENTS, Moment, Moves
    from tests.proving.faults.deck.pictures import Struck, still

_MODULES = {
    "fault": ("Exemption", "FALLS", "Fault", "Poses", "REASONS", "Scene", "TUMBLES"),
    "faults": ("BROKEN", "FAULTS", "STATES"),
    "meddler": ("Meddler",),
    "moments": ("DESCENT_AFTER_S", "MOMENTS", "Moment", "Moves"),
    "pictures": ("Struck", "still"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
