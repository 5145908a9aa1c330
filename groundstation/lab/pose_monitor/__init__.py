"""Pose monitor: any pose source live, without flying."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.lab.pose_monitor.command import watch
    from groundstation.lab.pose_monitor.listener import ears

_MODULES = {"command": ("watch",), "listener": ("ears",)}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
