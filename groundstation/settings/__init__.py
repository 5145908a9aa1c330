"""The whole configuration of a ground station: one section a struct."""

from groundstation.settings.flown_config import read_flown_config
from groundstation.settings.settings import (
    REHEARSAL,
    Config,
    FlightConfig,
    LinkConfig,
    MqttConfig,
    OperatorConfig,
    RehearsalConfig,
    beacon,
    describe_rehearsal,
    ensure_served,
    is_rehearsal,
    rehearse,
)
