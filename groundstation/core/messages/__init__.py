"""What the parts of a flight hand to each other, and show to others: poses, estimates, decisions, requests."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.core.messages.bodies import FAR_M, Others
    from groundstation.core.messages.control import Controller, Decision, Estimate
    from groundstation.core.messages.pose import (
        Distrusts,
        Overheard,
        Pose,
        PoseEvent,
        PoseSource,
        PoseStatus,
        SourceError,
    )
    from groundstation.core.messages.requests import Ask, Reply, Request
    from groundstation.core.messages.snapshot import Certificate, Diagnostics, Snapshot
    from groundstation.core.messages.verdict import Check, Verdict

_MODULES = {
    "bodies": ("FAR_M", "Others"),
    "control": ("Controller", "Decision", "Estimate"),
    "pose": ("Distrusts", "Overheard", "Pose", "PoseEvent", "PoseSource", "PoseStatus", "SourceError"),
    "requests": ("Ask", "Reply", "Request"),
    "snapshot": ("Certificate", "Diagnostics", "Snapshot"),
    "verdict": ("Check", "Verdict"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
