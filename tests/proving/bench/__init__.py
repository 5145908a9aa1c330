"""Measurements of speed and memory."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from tests.proving.bench.allocation import look

_MODULES = {"allocation": ("look",)}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
