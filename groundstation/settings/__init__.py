"""The whole configuration of a ground station: one section a struct."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.settings.hold_to_run import OperatorConfig
    from groundstation.settings.mqtt import MqttConfig, RemoteAsk, asks
    from groundstation.settings.settings import Config, FlightConfig, LinkConfig

_MODULES = {
    "hold_to_run": ("OperatorConfig",),
    "mqtt": ("MqttConfig", "RemoteAsk", "asks"),
    "settings": ("Config", "FlightConfig", "LinkConfig"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
