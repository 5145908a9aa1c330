"""Pose sources: intake, clocks, the outlier gate, and forwarding to the autopilot."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.pose.forward import Forwarding
    from groundstation.pose.gate import Gate, GateConfig
    from groundstation.pose.gated import Gated
    from groundstation.pose.kinds import PoseConfig, Recorded, ShowsOthers, make_source
    from groundstation.pose.outbreaks import HINTS

_MODULES = {
    "forward": ("Forwarding",),
    "gate": ("Gate", "GateConfig"),
    "gated": ("Gated",),
    "kinds": ("PoseConfig", "Recorded", "ShowsOthers", "make_source"),
    "outbreaks": ("HINTS",),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
