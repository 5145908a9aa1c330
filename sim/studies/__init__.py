"""Questions put to many flights: campaigns, comparisons, tuning, margins."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.studies.bring_down import cut_all, markdown
    from sim.studies.vectors import LIMIT, worst_disagreement

_MODULES = {"bring_down": ("cut_all", "markdown"), "vectors": ("LIMIT", "worst_disagreement")}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
