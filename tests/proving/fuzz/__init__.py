"""Random and damaged bytes for every decoder."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from tests.proving.fuzz.fuzz import fuzz_all, text
    from tests.proving.fuzz.links import LINKS
    from tests.proving.fuzz.pose_bytes import FLIGHTS, PERIOD_S
    from tests.proving.fuzz.subjects import SOURCES, Subject

_MODULES = {
    "fuzz": ("fuzz_all", "text"),
    "links": ("LINKS",),
    "pose_bytes": ("FLIGHTS", "PERIOD_S"),
    "subjects": ("SOURCES", "Subject"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
