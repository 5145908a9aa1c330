"""Analysis of recordings: replay, report, identification."""

from groundstation.analysis.recordings import (
    Channel,
    FlightData,
    Track,
    export_command,
    load,
    logs_command,
)
from groundstation.analysis.replay import replay_command
from groundstation.analysis.viewers import view_command
