"""Telemetry through a CRSF module, by its document, and how it steers the pacer."""

import math
import struct

import msgspec
import pytest
from hypothesis import example, given, strategies as st

from groundstation.core.geometry import so3
from links.bridge.codec import StationEnd, Welcome
from links.core import Command, Segment
from links.rf import Arm, Channels, CrsfLinkConfig, FramePacer, Give, encode_attitude
from links.rf.codec import RfTelemetry
from tests.unit.links.rf.test_pacer import Bench, Notebook

# By their numbers: a limit that the test took from the code would bear out any value.
ATTITUDE_LATENCY_S = 0.05
TELEMETRY_MAX_AGE_S = 5.0


def frame(kind: int, payload: bytes) -> bytes:
    """A frame to the handset, by the document and without our codec."""
    body = bytes((kind,)) + payload
    crc = 0
    for byte in body:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ 0xD5 if crc & 0x80 else crc << 1) & 0xFF
    return bytes((0xEA, len(body) + 1)) + body + bytes((crc,))


def timing(early_s: float) -> bytes:
    times = struct.pack(">Ii", 40_000, round(1e7 * early_s))
    return frame(0x3A, b"\xea\xee\x10" + times)


BATTERY = frame(0x08, bytes.fromhex("00A8 0011 000123 32"))
LINK = frame(0x14, bytes((60, 0, 99, 0xFB, 0, 2, 3, 70, 98, 7)))
LEANS = so3.from_euler_zyx(0.2, 0.1, 3.1)


def uplink(snr_db: int) -> RfTelemetry:
    return RfTelemetry(uplink_share=0.99, uplink_dbm=-60, uplink_snr_db=snr_db)


@pytest.mark.parametrize(
    ("data", "tells"),
    [
        (BATTERY, RfTelemetry(battery_v=16.8, battery_share=0.5)),
        (frame(0x08, bytes(8)), RfTelemetry()),
        (LINK, uplink(-5)),
        (frame(0x14, bytes((80, 60, 99, 0x80, *bytes(6)))), uplink(-128)),
        (frame(0x1E, struct.pack(">hhh", -1000, 2000, 31000)), RfTelemetry(attitude=LEANS)),
        (frame(0x21, b"ACRO*\0rest"), RfTelemetry(mode="ACRO*")),
        (timing(-0.00012), RfTelemetry(early_s=-0.00012)),
    ],
)
def test_frames_are_read_as_their_document_says(data: bytes, tells: RfTelemetry) -> None:
    (heard,) = CrsfLinkConfig().codec().decoder().feed(data)
    assert heard.positions is None
    assert heard.tells is not None
    for name in RfTelemetry.__struct_fields__:
        assert getattr(heard.tells, name) == pytest.approx(getattr(tells, name)), name


SHORTEST = {0x08: 8, 0x14: 10, 0x1E: 6, 0x21: 0, 0x3A: 11}
"""Bytes that a frame of each kind needs [-]."""


@given(st.sampled_from([*SHORTEST]), st.binary(max_size=60))
@example(0x21, bytes(60))
@example(0x3A, b"\xea\xee\x10" + bytes(7))
def test_whatever_they_hold_nothing_raises_and_every_number_is_finite(
    kind: int, payload: bytes
) -> None:
    (heard,) = CrsfLinkConfig().codec().decoder().feed(frame(kind, payload))
    assert heard.tells is None or len(payload) >= SHORTEST[kind]
    if heard.tells is not None:
        values = (*msgspec.structs.astuple(heard.tells), *(heard.tells.attitude or ()))
        assert all(math.isfinite(value) for value in values if isinstance(value, float))


def test_pitch_counts_the_way_that_it_is_told_to() -> None:
    data, seen = encode_attitude(0.1, -0.2, 4.0), []
    for pitch in ("nose_up", "nose_down"):
        (heard,) = CrsfLinkConfig(attitude_pitch=pitch).codec().decoder().feed(data)
        assert heard.tells is not None and heard.tells.attitude is not None
        seen.append(so3.euler_zyx(heard.tells.attitude))
    assert data == frame(0x1E, struct.pack(">hhh", 1000, -2000, round(1e4 * (4.0 - math.tau))))
    assert seen[0] == pytest.approx((-0.2, 0.1, 4.0 - math.tau), abs=1e-4)
    assert seen[1] == pytest.approx((-0.2, -0.1, 4.0 - math.tau), abs=1e-4)


def test_an_attitude_is_reported_at_once_and_with_about_when_it_was() -> None:
    bench = Bench(CrsfLinkConfig())
    bench.frame()
    bench.pacer.report(bench.now)
    assert not bench.pacer.has_news(bench.now)
    bench.port.comes = encode_attitude(0.0, 0.1, 0.0)
    bench.frame()
    assert bench.pacer.has_news(bench.now)
    told = bench.pacer.report(bench.now).telemetry
    assert told.attitude_s == pytest.approx(bench.now - ATTITUDE_LATENCY_S)
    assert bench.pacer.report(bench.now + 0.1).telemetry.attitude_s == told.attitude_s


def test_a_bridge_s_attitude_is_of_the_stations_own_clock() -> None:
    bench = Bench(CrsfLinkConfig())
    bench.port.comes = encode_attitude(0.0, 0.1, 0.0)
    bench.frame()
    there = bench.pacer.report(bench.now)
    welcome = Welcome(bytes(16), bytes(16), 0.0, CrsfLinkConfig().manner, there)
    end = StationEnd(bytes(32), welcome, 0.0)
    end._clock.narrow(99.0, 101.0, 0.0)
    here = end.ours(there)
    assert there.telemetry.attitude_s is not None
    assert here.telemetry.attitude_s == pytest.approx(there.telemetry.attitude_s + 100.0, abs=1e-3)
    assert here.telemetry.attitude == there.telemetry.attitude
    silent = msgspec.structs.replace(there, telemetry=RfTelemetry())
    assert end.ours(silent).telemetry == RfTelemetry()


def test_what_is_told_is_reported_and_forgotten_after_a_while() -> None:
    bench = Bench(CrsfLinkConfig())
    bench.port.comes = BATTERY + LINK
    bench.frame()
    told = bench.pacer.report(bench.now).telemetry
    assert told.battery_v == pytest.approx(16.8)
    assert told.uplink_share == pytest.approx(0.99)
    assert bench.pacer.report(bench.now + TELEMETRY_MAX_AGE_S).telemetry == RfTelemetry()


@pytest.mark.parametrize("early_s", [0.0011, -0.0007])
def test_the_pacer_meets_the_modules_phase_by_two_percent_of_a_period_a_frame(
    early_s: float,
) -> None:
    bench = Bench(CrsfLinkConfig())
    bench.port.comes = timing(early_s)
    bench.frame()
    shifts = [bench.pacer.steer() for _ in range(40)]
    most = 0.02 * bench.period
    assert max(abs(shift) for shift in shifts) <= most * (1.0 + 1e-9)
    assert sum(shifts) == pytest.approx(early_s)
    assert shifts[0] == pytest.approx(math.copysign(most, early_s))
    assert shifts[-1] == 0.0


def test_no_deadline_moves_however_the_frames_are_steered() -> None:
    """A command of a module that asks for later frames ends as early as of one that does not."""
    config = CrsfLinkConfig(arm_low_s=0.0, arm_high_s=0.01)
    ends = []
    for asks in (b"", timing(0.0019)):
        port, now = Notebook(), 100.0
        pacer = FramePacer(config, 2.0, port, now)
        channels = Channels(config.map, count=16, thrust_max_n=2.0)
        pacer.order(Arm(1, now), now)
        down = (Segment(0.05, 0.5, (0.0, 0.0, 0.0)),)
        pacer.order(Give(1, Command(1.0, (0.0, 0.0, 0.0), 1, now, now + 0.1, down)), now)
        lifted_s = now
        while now < 101.0:
            now += config.period_s + pacer.steer()
            pacer.prepare(now)
            pacer.leave(now)
            port.comes = asks
            pacer.tidy(now)
            (heard,) = config.codec().decoder().feed(port.frames[-1])
            assert heard.positions is not None
            if channels.read(heard.positions).thrust_n > 0.01:
                lifted_s = now
        ends.append(lifted_s)
        assert lifted_s <= 100.15
    assert ends[0] == pytest.approx(ends[1], abs=config.period_s)
