"""The receivers' pulses against public documents, and what they give once frames have stopped."""

from collections.abc import Sequence

import pytest

from links.rf import CrsfLinkConfig, DsmLinkConfig, RfLinkConfig, describe_pulses
from sim.radio import FAILSAFE_S, Failsafe, PulseReceiver
from tests.unit.links.rf.test_crsf_telemetry import frame

CRSF_CENTRE = bytes.fromhex("EE1816E0031FF8C0073EF0810F7CE0031FF8C0073EF0810F7CAD")
"""16 channels of 992, packed by hand from the TBS document: 0x3E0 over and over, the lowest bits
first."""


class Pulses:
    def __init__(self, config: RfLinkConfig, failsafe: Failsafe = "cut") -> None:
        self.given: list[Sequence[float] | None] = []
        self.receiver = PulseReceiver(self.given.append, config)
        self.receiver.failsafe_gives = failsafe


def crsf_of(counts: Sequence[int]) -> bytes:
    """A frame of channels by the document's own words, without our codec."""
    packed = sum(count << 11 * i for i, count in enumerate(counts))
    return frame(0x16, packed.to_bytes(22, "little"))


def test_counts_of_crsf_are_the_pulses_of_its_document() -> None:
    """TICKS_TO_US(x) = (x - 992) * 5 / 8 + 1500: 172, 992 and 1811 are 988, 1500 and 2012 µs."""
    pulses = Pulses(CrsfLinkConfig())
    told = [172, 191, 992, 1792, 1811, *[992] * 11]
    pulses.receiver.receive(crsf_of(told), 0.0)
    expected = [(count - 992) * 5 / 8 + 1500 for count in told]
    assert pulses.given[-1] == pytest.approx(expected, abs=0.7)


def test_counts_of_dsm_are_988_and_the_count() -> None:
    """Betaflight's spektrum.c in the 22 ms mode of 1024 steps: a count of 512 is 1500 µs."""
    pulses = Pulses(DsmLinkConfig())
    counts = [96, 512, 928, 300, 700, 512]
    channels = (bytes((i << 2 | c >> 8, c & 0xFF)) for i, c in enumerate(counts))
    pulses.receiver.receive(bytes((0x18, 0)) + b"".join(channels), 0.0)
    assert pulses.given[-1] == pytest.approx([988 + count for count in counts])


def test_the_order_of_the_first_four_channels_is_the_modules() -> None:
    assert describe_pulses(CrsfLinkConfig()) == (512.0, "AETR1234")
    assert describe_pulses(DsmLinkConfig()) == (416.0, "TAER1234")


@pytest.mark.parametrize(
    ("failsafe", "gives"), [("hold", []), ("cut", [None]), ("invalid", [[0.0] * 16])]
)
def test_a_receiver_that_hears_nothing_more_does_as_it_was_set(
    failsafe: Failsafe, gives: list[object]
) -> None:
    pulses = Pulses(CrsfLinkConfig(), failsafe)
    pulses.receiver.receive(CRSF_CENTRE, 1.0)
    before = len(pulses.given)
    pulses.receiver.watch(1.0 + 0.99 * FAILSAFE_S)
    assert len(pulses.given) == before
    pulses.receiver.watch(1.0 + FAILSAFE_S)
    assert pulses.given[before:] == gives
    pulses.receiver.receive(CRSF_CENTRE, 3.0)
    assert pulses.given[-1] == pytest.approx([1500.0] * 16, abs=0.5)
    assert not pulses.receiver.failsafe
