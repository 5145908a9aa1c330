"""The required test with the propellers off, as a guided command: `groundstation props-off`."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.lab.props_off.command import props_off_command

_MODULES = {"command": ("props_off_command",)}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
