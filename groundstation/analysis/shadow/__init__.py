"""Offline comparison: our estimator and controller over a recorded .tlog."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.analysis.shadow.path import FlownPath, flying, hover_share, thrust_shares
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
    from groundstation.analysis.shadow.report import compare_commands, replay, replay_command

_MODULES = {
    "path": ("FlownPath", "flying", "hover_share", "thrust_shares"),
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
    "report": ("compare_commands", "replay", "replay_command"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
