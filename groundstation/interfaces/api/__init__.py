"""The local interface: one JSON object a line on a UNIX socket."""

from groundstation.interfaces.api import messages as messages

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.interfaces.api.client import Client, attach, snapshots
    from groundstation.interfaces.api.command import asked, request_command
    from groundstation.interfaces.api.desk import Core
    from groundstation.interfaces.api.messages import Control, decode
    from groundstation.interfaces.api.server import Server
    from groundstation.interfaces.api.stop import stop_all, stop_all_command

_MODULES = {
    "client": ("Client", "attach", "snapshots"),
    "command": ("asked", "request_command"),
    "desk": ("Core",),
    "messages": ("Control", "decode"),
    "server": ("Server",),
    "stop": ("stop_all", "stop_all_command"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
