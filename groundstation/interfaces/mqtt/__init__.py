"""Telemetry to an MQTT broker, and sealed requests from it."""

from groundstation.interfaces.mqtt.broker import (
    MqttBroker,
    describe_error,
    from_url,
    heed_cancellation,
)
from groundstation.interfaces.mqtt.command import ask_command
from groundstation.interfaces.mqtt.messages import OFFLINE, SNAPSHOT, STATE, TOPICS, Topic
from groundstation.interfaces.mqtt.publisher import ensure_mqtt, publish_forever
