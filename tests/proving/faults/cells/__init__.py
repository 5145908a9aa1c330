"""One fault in one state of one mission, in virtual time."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from tests.proving.faults.cells.cell import (
        AUTOPILOT,
        LANDS,
        LOOK_S,
        STILL_SHARE,
        NotReached,
        fly_here,
        hover_n,
        not_struck,
    )
    from tests.proving.faults.cells.together import fly_together

_MODULES = {
    "cell": ("AUTOPILOT", "LANDS", "LOOK_S", "NotReached", "STILL_SHARE", "fly_here", "hover_n", "not_struck"),
    "together": ("fly_together",),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
