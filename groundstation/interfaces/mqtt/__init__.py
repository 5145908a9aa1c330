"""Telemetry to an MQTT broker, and sealed requests from it."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.interfaces.mqtt.ask import ask_command
    from groundstation.interfaces.mqtt.broker import Broker, from_url, heed_cancellation, in_words
    from groundstation.interfaces.mqtt.command import mqtt_command
    from groundstation.interfaces.mqtt.fleet import Fleet, Seen
    from groundstation.interfaces.mqtt.messages import EVENT, SNAPSHOT, STATE
    from groundstation.interfaces.mqtt.publisher import publish_forever
    from groundstation.interfaces.mqtt.requests import ensure_mqtt
    from groundstation.interfaces.mqtt.schemas import write_schemas

_MODULES = {
    "ask": ("ask_command",),
    "broker": ("Broker", "from_url", "heed_cancellation", "in_words"),
    "command": ("mqtt_command",),
    "fleet": ("Fleet", "Seen"),
    "messages": ("EVENT", "SNAPSHOT", "STATE"),
    "publisher": ("publish_forever",),
    "requests": ("ensure_mqtt",),
    "schemas": ("write_schemas",),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
