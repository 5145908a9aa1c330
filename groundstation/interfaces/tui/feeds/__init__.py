"""Where a dashboard's pictures come from: a running flight or a recording."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.interfaces.tui.feeds.attached import Attached
    from groundstation.interfaces.tui.feeds.playback import Playback
    from groundstation.interfaces.tui.feeds.tape import Tape

_MODULES = {"attached": ("Attached",), "playback": ("Playback",), "tape": ("Tape",)}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
