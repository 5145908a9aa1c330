"""What a recording tells: replay, report, identification."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.analysis.recordings import Channel, FlightData, Track, export_command, load, logs_command
    from groundstation.analysis.replay import replay_command
    from groundstation.analysis.shadow import (
        FlownPath,
        OpenedRecording,
        RecordedVehicle,
        flying,
        open_recording,
        read_recording,
        shadow_command,
    )
    from groundstation.analysis.viewers import view_command


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
