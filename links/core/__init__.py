"""What every link shares, sans-IO: the port, the dead man's switch, the thrust curve."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from links.core.deadman import (
        IN_TIME,
        Arrival,
        Attitude,
        Command,
        CommandLink,
        Deadman,
        LinkError,
        LinkKind,
        LinkLost,
        LinkMisuse,
        LinkRejected,
        LinkStatus,
        Phase,
        Segment,
        full_thrust_n,
        signal,
        thrust,
    )
    from links.core.lateness import Lateness
    from links.core.terminal_text import printable


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
