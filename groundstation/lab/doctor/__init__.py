"""An autopilot's parameters: looked at, advised on, and set one by one."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.lab.doctor.command import Orders, doctor

_MODULES = {"command": ("Orders", "doctor")}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
