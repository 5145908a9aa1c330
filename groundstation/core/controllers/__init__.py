"""Controllers to fly with: ours, the baselines, and a user's own."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.core.controllers.custom import Custom
    from groundstation.core.controllers.kinds import ControllerConfig, make_controller

_MODULES = {"custom": ("Custom",), "kinds": ("ControllerConfig", "make_controller")}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
