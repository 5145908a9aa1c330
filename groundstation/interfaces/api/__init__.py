"""The local interface: one JSON object a line on a UNIX socket."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.interfaces.api.client import StationClient, attach, snapshots
    from groundstation.interfaces.api.command import ask_station, request_command, stop_all, stop_all_command
    from groundstation.interfaces.api.desk import Core
    from groundstation.interfaces.api.messages import Control, OrderAnswer, decode
    from groundstation.interfaces.api.server import Server

_MODULES = {
    "client": ("StationClient", "attach", "snapshots"),
    "command": ("ask_station", "request_command", "stop_all", "stop_all_command"),
    "desk": ("Core",),
    "messages": ("Control", "OrderAnswer", "decode"),
    "server": ("Server",),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
