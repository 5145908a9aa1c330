"""Flights without a terminal: the daemon, its signals, logs and health."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.interfaces.service.command import daemon_command, fly_command
    from groundstation.interfaces.service.fleet import fleet_command, relay_command
    from groundstation.interfaces.service.health import health_command
    from groundstation.interfaces.service.logs import Format
    from groundstation.interfaces.service.readiness import flyable
    from groundstation.interfaces.service.systemd import unit

_MODULES = {
    "command": ("daemon_command", "fly_command"),
    "fleet": ("fleet_command", "relay_command"),
    "health": ("health_command",),
    "logs": ("Format",),
    "readiness": ("flyable",),
    "systemd": ("unit",),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
