"""The whole configuration of a ground station: one section a struct."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.settings.rehearsal import (
        AF_UNIX,
        REHEARSAL,
        RehearsalConfig,
        beacon,
        describe_rehearsal,
        ensure_served,
        is_rehearsal,
        rehearse,
    )
    from groundstation.settings.settings import Config, FlightConfig, LinkConfig, MqttConfig, OperatorConfig

_MODULES = {
    "rehearsal": (
        "AF_UNIX",
        "REHEARSAL",
        "RehearsalConfig",
        "beacon",
        "describe_rehearsal",
        "ensure_served",
        "is_rehearsal",
        "rehearse",
    ),
    "settings": ("Config", "FlightConfig", "LinkConfig", "MqttConfig", "OperatorConfig"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
