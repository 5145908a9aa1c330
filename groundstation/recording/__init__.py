"""The flight recorder: what a flight hands over (records), what stands in the file (channels), and who writes it.

    RecordedFlight, Wires → records → FlightLog → NAME.mcap, NAME.tlog

In real time the records cross a pipe into a process of its own (process.py, __main__.py); in virtual time they go to
the file at once. Nothing here is imported before somebody records or reads.
"""

from groundstation.recording import channels as channels

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.recording.assembly import make_flight, recorder
    from groundstation.recording.channels import CHANNELS, Measured, Quaternion, Vector3, schema
    from groundstation.recording.headline import STEADY_S
    from groundstation.recording.log import FlightLog, facts
    from groundstation.recording.mcap_writer import McapWriter
    from groundstation.recording.process import END_S, RecorderProcess
    from groundstation.recording.reader import Entry, NoRecording, Recording, quick_headline
    from groundstation.recording.recorded import Give, RecordedPilot, about
    from groundstation.recording.records import GAIN, About, Ended, Idled, Received, Record, Sent, Ticked, Told

_MODULES = {
    "assembly": ("make_flight", "recorder"),
    "channels": ("CHANNELS", "Measured", "Quaternion", "Vector3", "schema"),
    "headline": ("STEADY_S",),
    "log": ("FlightLog", "facts"),
    "mcap_writer": ("McapWriter",),
    "process": ("END_S", "RecorderProcess"),
    "reader": ("Entry", "NoRecording", "Recording", "quick_headline"),
    "recorded": ("Give", "RecordedPilot", "about"),
    "records": ("About", "Ended", "GAIN", "Idled", "Received", "Record", "Sent", "Ticked", "Told"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
