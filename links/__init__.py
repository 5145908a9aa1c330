"""Command links: how thrust and body rates leave for a vehicle, and that they stop when nobody commands."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from links.make import make_link

_MODULES = {"make": ("make_link",)}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
