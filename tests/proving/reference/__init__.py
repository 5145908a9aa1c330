"""Pages of docs/reference that are made from the code."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from tests.proving.reference.pages import floors, folder_imports, is_for_types, rooms_below, tree_imports

_MODULES = {"pages": ("floors", "folder_imports", "is_for_types", "rooms_below", "tree_imports")}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
