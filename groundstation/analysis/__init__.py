"""What a recording tells: replay, report, identification."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.analysis.export import export_command
    from groundstation.analysis.listing import logs_command

_MODULES = {"export": ("export_command",), "listing": ("logs_command",)}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
