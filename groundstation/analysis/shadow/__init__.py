"""Offline comparison: our estimator and controller over a recorded .tlog."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.analysis.shadow.command import replay_command
    from groundstation.analysis.shadow.flight import flying, hover_share, thrust_shares
    from groundstation.analysis.shadow.path import FlownPath
    from groundstation.analysis.shadow.recording import Recording, read_recording
    from groundstation.analysis.shadow.vehicle import completed, described, latency_s, mavlink

_MODULES = {
    "command": ("replay_command",),
    "flight": ("flying", "hover_share", "thrust_shares"),
    "path": ("FlownPath",),
    "recording": ("Recording", "read_recording"),
    "vehicle": ("completed", "described", "latency_s", "mavlink"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
