"""Trajectories with exact derivatives, and what they ask of a vehicle."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.core.trajectory.excitation import ExcitationConfig
    from groundstation.core.trajectory.feasibility import Demand, Report, check, refusal
    from groundstation.core.trajectory.hold import Hold
    from groundstation.core.trajectory.kinds import TrajectoryConfig
    from groundstation.core.trajectory.lemniscate import LemniscateConfig
    from groundstation.core.trajectory.port import Reference, Trajectory
    from groundstation.core.trajectory.transition import Blend, Chain, Limits, blend, run_in, stopped

_MODULES = {
    "excitation": ("ExcitationConfig",),
    "feasibility": ("Demand", "Report", "check", "refusal"),
    "hold": ("Hold",),
    "kinds": ("TrajectoryConfig",),
    "lemniscate": ("LemniscateConfig",),
    "port": ("Reference", "Trajectory"),
    "transition": ("Blend", "Chain", "Limits", "blend", "run_in", "stopped"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
