"""Flights without a terminal: the daemon, its signals, logs and health."""

from groundstation.interfaces.service.fleet import fleet_command, relay_command, require_flyable
from groundstation.interfaces.service.flights import (
    daemon_command,
    fly_command,
    health_command,
    unit_file,
)
