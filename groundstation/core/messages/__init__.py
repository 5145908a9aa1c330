"""What the parts of a flight hand to each other, and show to others: poses, estimates, decisions, requests."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.core.messages.pose import (
        FAR_M,
        Distrusts,
        Others,
        OverheardSource,
        Pose,
        PoseEvent,
        PoseKind,
        PoseSource,
        PoseStatus,
        SourceError,
    )
    from groundstation.core.messages.snapshot import (
        FARTHEST_M,
        MOST_POINTS,
        ROUNDING_S,
        SATURATION_FROM_S,
        STEADY_S,
        TURN_DEG,
        Ask,
        Certificate,
        Check,
        Controller,
        Decision,
        Diagnostics,
        Estimate,
        RemoteAsk,
        Reply,
        Request,
        Snapshot,
        SteadyError,
        Verdict,
        Waypoint,
        Waypoints,
        ensure_points,
    )

_MODULES = {
    "pose": (
        "Distrusts",
        "FAR_M",
        "Others",
        "OverheardSource",
        "Pose",
        "PoseEvent",
        "PoseKind",
        "PoseSource",
        "PoseStatus",
        "SourceError",
    ),
    "snapshot": (
        "Ask",
        "Certificate",
        "Check",
        "Controller",
        "Decision",
        "Diagnostics",
        "Estimate",
        "FARTHEST_M",
        "MOST_POINTS",
        "ROUNDING_S",
        "RemoteAsk",
        "Reply",
        "Request",
        "SATURATION_FROM_S",
        "STEADY_S",
        "Snapshot",
        "SteadyError",
        "TURN_DEG",
        "Verdict",
        "Waypoint",
        "Waypoints",
        "ensure_points",
    ),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
