"""The dashboard: a process of its own."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.interfaces.tui.app import fly_with_screen, tui_command
    from groundstation.interfaces.tui.fleet import run_fleet


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
