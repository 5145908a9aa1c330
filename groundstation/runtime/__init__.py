"""What a process of ours needs of its machine: clocks, sockets' places, locks, exit codes."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.runtime.broadcast import Latest
    from groundstation.runtime.clock import precise_loop, sleep_until, to_the_end
    from groundstation.runtime.entry import bare, run
    from groundstation.runtime.exits import INTERRUPTED, Exit
    from groundstation.runtime.flights import (
        RecordingConfig,
        being_written,
        folder_of,
        for_us_alone,
        free_name,
        made_folder,
        recordings,
        tidy,
    )
    from groundstation.runtime.lock import Taken, lock_path, only_one
    from groundstation.runtime.outlet import Outlet
    from groundstation.runtime.pictures import need_matplotlib
    from groundstation.runtime.place import (
        FILE,
        FOLDER,
        SERVICES,
        ApiError,
        StatusConfig,
        claim,
        directory,
        find,
        is_served,
        ours,
        owner,
        serving,
        socket_path,
    )
    from groundstation.runtime.quiet import Quiet
    from groundstation.runtime.register import BRIDGE, Running, registered, running, send, strangers
    from groundstation.runtime.version import __version__
    from groundstation.runtime.wall_clock import wall_ms

_MODULES = {
    "broadcast": ("Latest",),
    "clock": ("precise_loop", "sleep_until", "to_the_end"),
    "entry": ("bare", "run"),
    "exits": ("Exit", "INTERRUPTED"),
    "flights": (
        "RecordingConfig",
        "being_written",
        "folder_of",
        "for_us_alone",
        "free_name",
        "made_folder",
        "recordings",
        "tidy",
    ),
    "lock": ("Taken", "lock_path", "only_one"),
    "outlet": ("Outlet",),
    "pictures": ("need_matplotlib",),
    "place": (
        "ApiError",
        "FILE",
        "FOLDER",
        "SERVICES",
        "StatusConfig",
        "claim",
        "directory",
        "find",
        "is_served",
        "ours",
        "owner",
        "serving",
        "socket_path",
    ),
    "quiet": ("Quiet",),
    "register": ("BRIDGE", "Running", "registered", "running", "send", "strangers"),
    "version": ("__version__",),
    "wall_clock": ("wall_ms",),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
