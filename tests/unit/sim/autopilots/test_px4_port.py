"""PX4's MAVLink port in lockstep: what was said has been taken before the next step."""

from collections import deque
from pathlib import Path
from typing import Any

import pytest

from links.mavlink.protocol import MavlinkCodec
from sim.autopilots import Px4, px4

THEIRS = ("127.0.0.1", 14580)


class Port:
    """The firmware's port; PX4 behind it ``answers`` a TIMESYNC after some telemetry."""

    def __init__(self) -> None:
        self.answers = True
        self.said: list[bytes] = []
        self.waits: deque[bytes] = deque()
        self._codec = MavlinkCodec(1, 1)

    def sendto(self, data: bytes, to: tuple[str, int]) -> None:
        assert to == THEIRS
        self.said.append(data)
        for question in self._codec.feed(data):
            if self.answers:
                self.waits.extend((b"telemetry", self._codec.timesync_reply(question, 3.0)))

    def recv(self, size: int) -> bytes:
        del size
        return self.waits.popleft()

    def recvfrom(self, size: int) -> tuple[bytes, tuple[str, int]]:
        if not self.waits:
            raise BlockingIOError
        return self.recv(size), THEIRS

    def close(self) -> None:
        pass


@pytest.fixture
def port() -> Port:
    return Port()


@pytest.fixture
def firmware(tmp_path: Path, port: Port, monkeypatch: pytest.MonkeyPatch) -> Px4:
    one = Px4(tmp_path / "px4", tmp_path, iter(()))
    one.mavlink.close()
    one.mavlink = port  # type: ignore[assignment]  # what it needs of one

    def select(reads: list[Any], *_: object) -> tuple[list[Any], list[Any], list[Any]]:
        return (reads if port.waits else []), [], []

    monkeypatch.setattr(px4, "select", select)
    return one


def test_the_plant_waits_until_its_thread_has_taken_what_was_said(
    firmware: Px4, port: Port
) -> None:
    port.waits.append(b"first")
    assert firmware.hear() == [b"first"]
    firmware.say_all([b"one", b"two"])
    assert port.said[:2] == [b"one", b"two"]
    assert not port.waits, "it was waited for"
    assert firmware.hear() == [b"telemetry"], "the answer is ours alone"


def test_a_thread_that_sleeps_in_the_plants_time_is_not_waited_for(
    firmware: Px4, port: Port
) -> None:
    port.waits.append(b"first")
    firmware.hear()
    port.answers = False
    firmware.say_all([b"one"])
    (question,) = MavlinkCodec(1, 1).feed(port.said[-1])
    port.waits.extend((MavlinkCodec(1, 1).timesync_reply(question, 3.0), b"telemetry"))
    assert firmware.hear() == [b"telemetry"], "an answer that comes later is ours, too"


def test_before_it_has_spoken_nothing_is_said(firmware: Px4, port: Port) -> None:
    firmware.say_all([b"one"])
    assert port.said == []
