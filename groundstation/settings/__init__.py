"""The whole configuration of a ground station: one section a struct."""

TYPE_CHECKING = False
if TYPE_CHECKING:
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


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
