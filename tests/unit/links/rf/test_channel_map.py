"""Thrust and rates to channel positions and back, by fixed examples and by round trips."""

import math

import pytest
from hypothesis import given, strategies as st

from groundstation.config import ConfigError, from_dict
from groundstation.settings import Config
from links.rf import Channels, CrsfLinkConfig, DsmLinkConfig
from links.rf.channel_map import ArmSwitch, ChannelMap, Copy, Fixed, Stick, Throttle

PLAIN = Channels(ChannelMap(), count=6, thrust_max_n=2.0)
RATE = math.radians(100.0)


def test_half_thrust_and_half_rates_are_half_way() -> None:
    half = [0.0, 0.5, -0.5, 0.5, 0.0, 0.0]
    assert PLAIN.flying(1.0, (RATE, -RATE, 1.5 * RATE)) == pytest.approx(half)
    crsf = Channels(CrsfLinkConfig().map, count=6, thrust_max_n=2.0)
    assert crsf.flying(1.0, (RATE, -RATE, 1.5 * RATE)) == pytest.approx([0.5, -0.5, 0, 0.5, 1, 0])


def test_what_cannot_be_said_is_clamped() -> None:
    assert PLAIN.flying(5.0, (9.0, -9.0, 99.0)) == [1.0, 1.0, -1.0, 1.0, 0.0, 0.0]
    assert PLAIN.flying(-1.0, (0.0, 0.0, 0.0))[0] == -1.0


def test_a_map_says_where_everything_goes() -> None:
    channels = Channels(
        ChannelMap(
            thrust=Throttle(channel=3, low=0.9, high=-0.9),
            roll=Stick(channel=1, reverse=True, trim=0.1),
            pitch=Stick(channel=2, failsafe=-0.5),
            arm=ArmSwitch(channel=6, armed=-1.0, disarmed=0.0),
            throttle_copy=Copy(channel=7, low=-0.5, high=0.5),
            fixed=(Fixed(channel=5, position=0.25),),
        ),
        count=8,
        thrust_max_n=2.0,
    )
    flying = [-0.4, 0.0, -0.9, 0.0, 0.25, -1.0, -0.5, 0.0]
    assert channels.flying(2.0, (RATE, 0.0, 0.0)) == pytest.approx(flying)
    assert channels.idle(armed=False) == [0.1, -0.5, 0.9, 0.0, 0.25, 0.0, 0.5, 0.0]
    assert channels.idle(armed=True) == [0.1, 0.0, 0.9, 0.0, 0.25, -1.0, 0.5, 0.0]
    assert not channels.read(channels.idle(armed=False)).armed
    assert channels.read(channels.idle(armed=True)).armed


def test_the_thrust_curve_is_straightened() -> None:
    curved = ChannelMap(thrust=Throttle(channel=1, curve=0.65))
    channels = Channels(curved, count=6, thrust_max_n=1.0)
    share = 0.5 * (channels.flying(0.3, (0.0, 0.0, 0.0))[0] + 1.0)
    assert 0.65 * share**2 + 0.35 * share == pytest.approx(0.3)


@given(
    st.floats(0.0, 2.0),
    st.tuples(*[st.floats(-1.7, 1.7)] * 3),
    st.floats(0.0, 1.0),
    st.booleans(),
    st.floats(-0.5, 0.5),
)
def test_what_is_said_is_read_again(
    thrust_n: float, rates: tuple[float, float, float], curve: float, reverse: bool, trim: float
) -> None:
    throttle, roll = Throttle(channel=1, curve=curve), Stick(channel=2, reverse=reverse, trim=trim)
    channels = Channels(ChannelMap(thrust=throttle, roll=roll), count=6, thrust_max_n=2.0)
    back = channels.read(channels.flying(thrust_n, rates))
    assert back.thrust_n == pytest.approx(thrust_n, abs=1e-9)
    assert back.rates_rad_s == pytest.approx(rates, abs=1e-9)


@pytest.mark.parametrize(
    ("link", "key", "words"),
    [
        ({"map": {"roll": {"channel": 1}}}, "link.map", "channel 1 is given to two things"),
        ({"map": {"arm": {"channel": 7}}}, "link", "channel 7, but these frames carry 6 channels"),
        ({"map": {"arm": {"channel": 17}}}, "link.map.arm.channel", "<= 16"),
        ({"map": {"thrust": {"channel": 1, "low": 1.0}}}, "link.map.thrust", "would not move"),
        ({"map": {"arm": {"channel": 5, "armed": -1.0}}}, "link.map.arm", "it could never disarm"),
        ({"period_s": 0.0012, "lead_s": 0.0}, "link", "takes 1.12 ms at 125000 baud"),
        ({"low": 900, "high": 100}, "link", "low must be smaller than high"),
        ({"lead_s": 0.01, "period_s": 0.005}, "link", "lead_s must be shorter"),
        ({"protocol": "spektrum"}, "link.protocol", "one of ['dsm2', 'dsmx', 'rtf']"),
    ],
)
def test_a_map_that_cannot_fly_stops_at_the_start(
    link: dict[str, object], key: str, words: str
) -> None:
    with pytest.raises(ConfigError) as refused:
        from_dict({"link": {"kind": "dsm", **link}}, Config)
    assert words in str(refused.value)
    assert refused.value.key.startswith(key)


def test_the_mlp4dsm_transmitter_can_be_described() -> None:
    copies = ChannelMap(throttle_copy=Copy(channel=6))
    config = DsmLinkConfig(protocol="rtf", low=86, high=938, map=copies)
    codec = config.codec()
    channels = Channels(config.map, count=codec.channels, thrust_max_n=1.0)
    frame = codec.encode(channels.idle(armed=False))
    assert frame.hex(" ") == "00 00 00 56 06 00 0a 00 0e 00 12 00 14 56"
