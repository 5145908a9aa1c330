"""The flight recorder: what a flight hands over (records), what stands in the file (channels), and
who writes it.

    FlightRecorder, WireTaps → records → FlightLog → NAME.mcap, NAME.tlog

In real time the records cross a pipe into a process of its own (process.py, __main__.py); in
virtual time they go to the file at once. Nothing here is imported before somebody records or reads.
"""

from groundstation.recording import channels as channels
from groundstation.recording.channels import (
    CHANNELS,
    ChannelForm,
    MeasuredMessage,
    Quaternion,
    Vector3,
    channel_form,
    describe_channels,
    quaternion,
    read_command,
    read_pose,
    read_reference,
    schema,
)
from groundstation.recording.headline import FlightHeadline
from groundstation.recording.process import END_S, RecorderProcess
from groundstation.recording.reader import (
    Entry,
    NoRecording,
    Recording,
    flatten,
    quick_headline,
    refuse_recordings,
    tabulate,
)
from groundstation.recording.records import (
    NO_PORT,
    About,
    LineRecord,
    Peer,
    ReceivedRecord,
    Record,
    SentRecord,
    TruthRecord,
    WireRecord,
)
from groundstation.recording.writer import FlightLog, about_texts, add_channel, begin_mcap
