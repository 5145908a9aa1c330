"""Random and damaged bytes for every decoder."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from tests.proving.fuzz.fuzz import FLIGHTS, LINKS, PERIOD_S, SOURCES, Subject, fuzz_all, text

_MODULES = {"fuzz": ("FLIGHTS", "LINKS", "PERIOD_S", "SOURCES", "Subject", "fuzz_all", "text")}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
