"""Random and damaged bytes for every decoder."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from tests.proving.fuzz.fuzz import LINKS, SOURCES, Subject, fuzz_all, text
    from tests.proving.fuzz.pose_bytes import FLIGHTS, PERIOD_S

_MODULES = {"fuzz": ("LINKS", "SOURCES", "Subject", "fuzz_all", "text"), "pose_bytes": ("FLIGHTS", "PERIOD_S")}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
