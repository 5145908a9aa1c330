"""Flights without a terminal: the daemon, its signals, logs and health."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.interfaces.service.fleet import fleet_command, relay_command, require_flyable
    from groundstation.interfaces.service.flights import Format, daemon_command, fly_command, health_command, unit_file


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
