"""The operator's own dead man: what must be held for a vehicle to fly."""

from groundstation.flight.hold_to_run.channel import ChannelInput
from groundstation.flight.hold_to_run.device import open_device
from groundstation.flight.hold_to_run.watch import HoldWatch, Input
from groundstation.settings import OperatorConfig
from links.core import CommandLink
from links.mavlink import MavlinkLink


def make_hold(config: OperatorConfig, link: CommandLink) -> HoldWatch | None:
    """What watches over the hold of ``config``; None where nothing must be held. A device is opened by the flight."""
    if not config.hold:
        return None
    number = config.channel
    if number is None:
        return HoldWatch(config.hold, config.above, lambda: open_device(config))
    assert isinstance(link, MavlinkLink), "the configuration has seen to it"
    channel: Input = ChannelInput(link.connection, number)
    return HoldWatch(channel.what, config.above, lambda: channel)


def ensure_held(config: OperatorConfig) -> None:
    """Stop before anything moves if the input device is not there.

    Raises:
        ConfigError: by the dotted key, with the devices that there are.
    """
    if config.hold and config.channel is None:
        open_device(config).close()
