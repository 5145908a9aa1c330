"""Pages of docs/reference that are made from the code."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from tests.proving.reference.rooms import floors, folder_imports, rooms_below

_MODULES = {"rooms": ("floors", "folder_imports", "rooms_below")}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
