"""Whether a configuration has all that a flight needs, looked at before anything is opened."""

from groundstation.config import ConfigError
from groundstation.flight import ensure_flyable, ensure_guarded, ensure_held, ensure_link
from groundstation.interfaces.mqtt import ensure_mqtt
from groundstation.pose import Recorded
from groundstation.settings import Config


def flyable(config: Config) -> Config:
    """``config``, which must have all that a flight needs.

    Raises:
        ConfigError: the vehicle can't fly this, the poses are recorded, a real vehicle has no fence or no speed limit,
            or a key can't be used.
    """
    if isinstance(config.pose, Recorded):
        raise ConfigError("pose.kind", "a recording must not fly a vehicle; look at it with `groundstation replay`")
    ensure_guarded(config)
    ensure_link(config)
    ensure_mqtt(config.mqtt)
    ensure_held(config.operator)
    ensure_flyable(config)
    return config
