"""What every link shares, sans-IO: the port, the dead man's switch, the thrust curve."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from links.core.child_command import make_child_command
    from links.core.deadman import Deadman, Phase
    from links.core.lateness import Lateness
    from links.core.port import (
        Attitude,
        Command,
        CommandLink,
        LinkError,
        LinkKind,
        LinkLost,
        LinkMisuse,
        LinkRejected,
        LinkStatus,
        Segment,
        TellsMode,
    )
    from links.core.terminal_text import printable
    from links.core.thrust_curve import full_thrust_n, signal, thrust

_MODULES = {
    "child_command": ("make_child_command",),
    "deadman": ("Deadman", "Phase"),
    "lateness": ("Lateness",),
    "port": (
        "Attitude",
        "Command",
        "CommandLink",
        "LinkError",
        "LinkKind",
        "LinkLost",
        "LinkMisuse",
        "LinkRejected",
        "LinkStatus",
        "Segment",
        "TellsMode",
    ),
    "terminal_text": ("printable",),
    "thrust_curve": ("full_thrust_n", "signal", "thrust"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
