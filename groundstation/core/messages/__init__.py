"""What the parts of a flight hand to each other, and show to others: poses, estimates, decisions, requests."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.core.messages.notices import NOTICES, NoticeTemplate, notice
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
        GAIN,
        MOST_POINTS,
        ROUNDING_S,
        SATURATION_FROM_S,
        STEADY_S,
        TURN_DEG,
        Ask,
        Certificate,
        CertificateReading,
        Check,
        CommandSent,
        Controller,
        Decision,
        Diagnostics,
        EndRecord,
        Estimate,
        FlightEvent,
        IdleRecord,
        Notice,
        NoticeKind,
        PoseRecord,
        RemoteAsk,
        Reply,
        Request,
        RequestRecord,
        Say,
        Severity,
        Snapshot,
        StatusRecord,
        SteadyError,
        Subscriber,
        SwitchRecord,
        Tick,
        TickRecord,
        TrajectoryRecord,
        Verdict,
        Waypoint,
        Waypoints,
        ensure_points,
        ignore,
        tell_lines,
    )


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
