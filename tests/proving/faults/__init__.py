"""The fault deck: one thing is broken in every state of a mission."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from tests.proving.faults.deal import deal_cells, fly_all, pick_worst, quick
    from tests.proving.faults.table import text, write

_MODULES = {"deal": ("deal_cells", "fly_all", "pick_worst", "quick"), "table": ("text", "write")}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
