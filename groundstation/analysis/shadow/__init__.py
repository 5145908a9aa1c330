"""Offline comparison: our estimator and controller over a recorded .tlog."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.analysis.shadow.recording import (
        RecordedPose,
        RecordedVehicle,
        SentSetPoint,
        complete_config,
        latency_s,
        load_described,
        mavlink,
        read_recording,
    )
    from groundstation.analysis.shadow.report import (
        FlownPath,
        compare_commands,
        flying,
        hover_share,
        replay,
        replay_command,
        thrust_shares,
    )

_MODULES = {
    "recording": (
        "RecordedPose",
        "RecordedVehicle",
        "SentSetPoint",
        "complete_config",
        "latency_s",
        "load_described",
        "mavlink",
        "read_recording",
    ),
    "report": ("FlownPath", "compare_commands", "flying", "hover_share", "replay", "replay_command", "thrust_shares"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
