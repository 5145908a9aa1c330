"""The local interface: one JSON object a line on a UNIX socket."""

from groundstation.interfaces.api.client import (
    ANSWER_S,
    END_S,
    StationClient,
    ask_station,
    open_client,
    request_command,
    snapshots,
    stop_all,
    stop_all_command,
)
from groundstation.interfaces.api.messages import (
    Allowance,
    Control,
    Core,
    OrderAnswer,
    TokenBucket,
    decode,
    new_events,
)
from groundstation.interfaces.api.server import Server
