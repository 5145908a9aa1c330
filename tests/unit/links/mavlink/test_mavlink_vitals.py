"""Vitals of an autopilot: mode names of both firmwares, battery, and pre-arm checks."""

from typing import Any

import pytest

from links.mavlink.protocol import ARDUPILOT, PX4, MavlinkCodec, Vitals
from links.mavlink.protocol.autopilot_state import mode_name


@pytest.mark.parametrize(
    ("autopilot", "mode", "name"),
    [
        (PX4, 6 << 16, "OFFBOARD"),
        (PX4, 3 << 16, "POSCTL"),
        (PX4, 4 << 16 | 6 << 24, "AUTO.LAND"),
        (PX4, 99 << 16, "mode 99"),
        (ARDUPILOT, 4, "GUIDED"),
        (ARDUPILOT, 20, "GUIDED_NOGPS"),
        (ARDUPILOT, 9, "LAND"),
        (ARDUPILOT, 77, "mode 77"),
        (8, 3, ""),
    ],
)
def test_modes_have_the_names_of_their_firmware(autopilot: int, mode: int, name: str) -> None:
    assert mode_name(autopilot, mode) == name


CODEC = MavlinkCodec(1, 1)
D = CODEC.dialect


def tell(vitals: Vitals, *messages: Any, now_s: float = 1.0) -> None:
    for message in CODEC.feed(b"".join(map(CODEC.pack, messages))):
        vitals.take_message(message, now_s)


def heard(vitals: Vitals, mode: int, now_s: float) -> None:
    tell(vitals, D.MAVLink_heartbeat_message(2, PX4, 0x81, mode, 4, 3), now_s=now_s)


def status(enabled: int, health: int, millivolts: int = 0, percent: int = -1) -> Any:
    sensors, battery = (enabled, enabled, health, 0), (millivolts, 0, percent)
    return D.MAVLink_sys_status_message(*sensors, *battery, 0, 0, 0, 0, 0, 0)


def test_a_mode_is_foreign_only_where_it_is_told_late_enough_and_does_not_follow_us() -> None:
    vitals = Vitals()
    assert vitals.foreign(0.0) == ""
    heard(vitals, 3 << 16, 10.0)
    assert vitals.foreign(10.5) == ""  # that heartbeat may be older than the arming
    assert vitals.foreign(9.0) == "POSCTL"
    heard(vitals, 6 << 16, 11.0)
    assert vitals.foreign(9.0) == ""


@pytest.mark.parametrize(
    ("millivolts", "percent", "volts", "share"),
    [(3700, 55, 3.7, 0.55), (0xFFFF, -1, None, None), (0, 0, None, 0.0), (3700, 120, 3.7, None)],
)
def test_the_battery_is_read_where_it_is_told(
    millivolts: int, percent: int, volts: float | None, share: float | None
) -> None:
    vitals = Vitals()
    tell(vitals, status(0, 0, millivolts, percent))
    assert vitals.battery_v == volts
    assert vitals.battery_share == (None if share is None else pytest.approx(share))


PREARM = 0x10000000


@pytest.mark.parametrize(
    ("kind", "mode", "enabled", "health", "ready"),
    [
        # As PX4 1.16 and ArduCopter 4.8 were seen to tell it.
        (PX4, 4 << 16 | 3 << 24, 0, PREARM | 1, True),
        (PX4, 4 << 16 | 3 << 24, 0, 1, False),
        (PX4, 6 << 16, 0, PREARM, True),
        (PX4, 6 << 16, 0, 0, None),  # in OFFBOARD it waits for set-points, which wait for arming
        (ARDUPILOT, 0, PREARM, PREARM, True),
        (ARDUPILOT, 4, PREARM, 0, False),
        (ARDUPILOT, 0, 0, 0, None),  # its checks are switched off
        (8, 0, 0, 0, None),
    ],
)
def test_pre_arm_checks_are_read_as_each_firmware_tells_them(
    kind: int, mode: int, enabled: int, health: int, ready: bool | None
) -> None:
    vitals = Vitals()
    tell(vitals, status(0, 0))
    assert vitals.ready is None, "without a heartbeat nobody knows"
    tell(vitals, D.MAVLink_heartbeat_message(2, kind, 0x01, mode, 3, 3), status(enabled, health))
    assert vitals.ready is ready
