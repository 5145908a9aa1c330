"""The operator's dead man: when it counts as held, what is refused, and what is lost."""

import asyncio
import math
from typing import Any

import evdev
import pytest
from evdev import ecodes
from hypothesis import given, strategies as st
from pymavlink.dialects.v20 import common

from groundstation.config import ConfigError, from_dict
from groundstation.core.mission import HoldToRun, InputLost
from groundstation.core.mission.operator import DEBOUNCE_S
from groundstation.flight.hold_to_run import OLD_S, RATE_HZ, ChannelInput, open_device
from groundstation.interfaces.service import require_flyable
from groundstation.settings import Config, OperatorConfig
from links.core import LOOK_S
from tests.hold_double import DeviceDouble, pad
from tests.loops import in_virtual_time


def seen(*shares: float | None, above: float = 0.75, step_s: float = LOOK_S) -> HoldToRun:
    """A hold that was looked at again and again."""
    hold = HoldToRun("the pedal", above)
    for number, share in enumerate(shares):
        hold.take_position(share, number * step_s)
    return hold


@pytest.mark.parametrize(
    ("shares", "obstacle"),
    [
        ([], "the pedal is lost: not read yet"),
        ([None], "the pedal is lost: no value received yet"),
        ([0.0], "the pedal is not held"),
        ([0.0, 1.0], ""),
        ([1.0] * 9, "the pedal was held from the beginning"),
        ([1.0, 0.0, 1.0], ""),
        ([None, 1.0], "the pedal was held from the beginning"),
        ([math.nan], "the pedal is not held"),
        ([0.0, 1.0, 0.0], ""),
        ([0.0, 1.0, 0.0, 0.0, 0.0], ""),
        ([0.0, 1.0, 0.0, 0.0, 0.0, 0.0], "the pedal is not held"),
        ([0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0], ""),
        ([0.0, 1.0, math.nan, math.nan, math.nan, math.nan], "the pedal is not held"),
    ],
)
def test_it_is_held_once_it_was_free_and_until_it_is_open_for_longer_than_a_bounce(
    shares: list[float | None], obstacle: str
) -> None:
    assert str(seen(*shares).obstacle or "") == obstacle


def test_what_was_lost_must_be_let_go_before_it_counts_again() -> None:
    hold = seen(0.0, 1.0)
    hold.lose("No such device")
    assert (hold.lost, str(hold.obstacle)) == (True, "the pedal is lost: No such device")
    hold.take_position(1.0, 1.0)
    assert str(hold.obstacle) == "the pedal was held from the beginning"
    hold.take_position(0.0, 1.01)
    hold.take_position(1.0, 1.02)
    assert hold.obstacle is None


@given(st.lists(st.tuples(st.booleans(), st.floats(0.001, 0.05)), min_size=1, max_size=60))
def test_it_is_never_believed_held_for_longer_than_a_bounce_after_it_was_open(
    looks: list[tuple[bool, float]],
) -> None:
    hold, now, open_s = HoldToRun("the pedal", 0.75), 0.0, None
    for held, step_s in looks:
        now += step_s
        open_s = None if held else now if open_s is None else open_s
        hold.take_position(1.0 if held else 0.0, now)
        if open_s is not None and now - open_s >= DEBOUNCE_S:
            assert hold.obstacle


@pytest.mark.parametrize("hold", ["BTN_TR", "KEY_B", "ABS_RZ", "rc:1", "rc:18", ""])
def test_what_can_be_held_is_taken(hold: str) -> None:
    assert from_dict({"operator": {"hold": hold}}, Config).operator.hold == hold


@pytest.mark.parametrize(
    "hold", ["space", "btn_tr", "rc:0", "rc:19", "rc:7\n", "REL_X", "BTN_TR\n"]
)
def test_what_cannot_be_held_is_refused_with_what_can(hold: str) -> None:
    says = r"operator\.hold: expected .*BTN_TR.*rc:1 to rc:18"
    with pytest.raises(ConfigError, match=says) as error:
        from_dict({"operator": {"hold": hold}}, Config)
    assert "\n" not in str(error.value)


def plugged(monkeypatch: pytest.MonkeyPatch, *devices: DeviceDouble) -> None:
    there = {device.path: device for device in devices}

    def opened(path: str, readonly: bool) -> DeviceDouble:
        assert readonly
        if path not in there:
            raise OSError(2, "No such file or directory")
        return there[path]

    monkeypatch.setattr(evdev, "InputDevice", opened)
    monkeypatch.setattr(evdev, "list_devices", lambda writable: list(there))


def test_the_only_device_that_has_the_key_is_found_and_asked_and_the_others_are_closed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    it = pad()
    keyboard = DeviceDouble("Keyboard", "/dev/input/event0", {ecodes.EV_KEY: [ecodes.KEY_A]})
    plugged(monkeypatch, it, keyboard)
    held = open_device(OperatorConfig(hold="BTN_TR"))
    assert (it.closed, keyboard.closed, it.grabbed) == (False, True, False)
    assert held.what == "BTN_TR of “Xbox pad” (/dev/input/event5)"
    assert held.share() == 0.0
    it.pressed = {ecodes.BTN_TL, ecodes.BTN_TR}
    assert held.share() == 1.0
    it.unplugged = True
    with pytest.raises(InputLost, match="No such device"):
        held.share()
    held.close()
    assert it.closed


@pytest.mark.parametrize(
    ("hold", "device", "says"),
    [
        ("KEY_B", "", r"expected a device that has KEY_B .*Xbox pad.*Other pad.*event6"),
        ("BTN_TR", "", r"more than one has BTN_TR.*Xbox pad.*Other pad"),
        ("KEY_B", "xbox", r"expected a device that has KEY_B.*evtest.*Xbox pad"),
        ("BTN_TR", "saitek", r"expected a device .*Xbox pad"),
        ("BTN_TR", "/dev/input/event9", r"/dev/input/event9: No such file"),
        ("BTN_TR", "/dev/input/js0", r"/dev/input/js0: .*-event-joystick"),
    ],
)
def test_a_device_that_is_not_there_stops_at_the_start_with_those_that_are(
    hold: str, device: str, says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    devices = pad(), pad("Other pad", "/dev/input/event6")
    plugged(monkeypatch, *devices)
    with pytest.raises(ConfigError, match=rf"operator\.device: {says}"):
        require_flyable(from_dict({"operator": {"hold": hold, "device": device}}, Config))
    assert device.startswith("/") or all(one.closed for one in devices)


def test_a_name_that_no_key_button_or_axis_has_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    plugged(monkeypatch, pad())
    says = r"operator\.hold: no key, button or axis has this name"
    with pytest.raises(ConfigError, match=says):
        require_flyable(from_dict({"operator": {"hold": "BTN_NO_SUCH"}}, Config))


class Wire:
    """A connection that was asked for messages."""

    def __init__(self) -> None:
        self.wanted: dict[str, float] = {}
        self.hear: Any = None

    def request(self, streams: Any) -> None:
        self.wanted |= streams(12)

    def subscribe(self, subscriber: Any) -> None:
        self.hear = subscriber


def rc_channels(*values: int) -> Any:
    return common.MAVLink_rc_channels_message(
        0, len(values), *values, *[0xFFFF] * (18 - len(values)), 255
    )


def sys_status(enabled: int, health: int) -> Any:
    return common.MAVLink_sys_status_message(enabled, enabled, health, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0)


@in_virtual_time
async def test_a_channel_is_held_while_the_autopilot_tells_it_high() -> None:
    wire: Any = Wire()
    channel = ChannelInput(wire, 3)
    assert wire.wanted == {"RC_CHANNELS": RATE_HZ}
    assert channel.share() is None
    await asyncio.sleep(1.0)
    wire.hear(rc_channels(1500, 1500, 1900), 1.0)
    assert channel.share() == pytest.approx(0.9)
    wire.hear(sys_status(0x10000, 0x10000), 1.0)
    assert channel.share() == pytest.approx(0.9)
    wire.hear(sys_status(0x10000, 0), 1.0)
    with pytest.raises(InputLost, match="receives nothing from the transmitter"):
        channel.share()
    wire.hear(sys_status(0, 0), 1.0)
    assert channel.share() == pytest.approx(0.9)
    await asyncio.sleep(OLD_S + 0.01)
    with pytest.raises(InputLost, match=r"not reported by the autopilot for 0\.5 s"):
        channel.share()
    wire.hear(rc_channels(1500, 1500), 1.0 + OLD_S)
    with pytest.raises(InputLost, match="no such channel"):
        channel.share()
