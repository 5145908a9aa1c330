"""A real input device of the kernel's, made by uinput: what the operator holds is asked of it."""

import time

import evdev
import pytest
from evdev import ecodes

from groundstation.config import ConfigError
from groundstation.core.mission import InputLost
from groundstation.flight.hold_to_run import DeviceInput, open_device
from groundstation.settings import OperatorConfig
from tests.conftest import LEFT_OUT


def opened() -> DeviceInput:
    """The device, once udev has made its file."""
    end = time.monotonic() + 60.0
    while True:
        try:
            return open_device(
                OperatorConfig(hold="BTN_TR", device="groundstation test pedal", grab=True)
            )
        except ConfigError:
            assert time.monotonic() < end
            time.sleep(0.05)


def test_a_real_device_of_the_kernel_is_held_let_go_and_unplugged() -> None:
    try:
        made = evdev.UInput({ecodes.EV_KEY: [ecodes.BTN_TR]}, name="groundstation test pedal")
    except (OSError, evdev.UInputError):
        pytest.skip(
            LEFT_OUT + "no real input device was held, for want of a /dev/uinput to write to"
        )
    try:
        held = opened()
        assert held.share() == 0.0
        made.write(ecodes.EV_KEY, ecodes.BTN_TR, 1)
        made.syn()
        assert held.share() == 1.0
        made.write(ecodes.EV_KEY, ecodes.BTN_TR, 0)
        made.syn()
        assert held.share() == 0.0
    finally:
        made.close()
    with pytest.raises(InputLost):
        held.share()
    held.close()
