"""The mission as a table: state and event to state."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.core.mission.mission import (
        ALARMING,
        EVENT_OF,
        FINAL,
        IN_AIR,
        ON_GROUND,
        TABLE,
        Event,
        Mission,
        State,
    )
    from groundstation.core.mission.operator import HoldToRun, InputLost, Interrupts


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
