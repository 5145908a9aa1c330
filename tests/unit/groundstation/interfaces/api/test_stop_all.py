"""``stop-all`` signals a process that can't be asked, tells of it, and keeps no other waiting."""

import asyncio
import signal
from pathlib import Path

import pytest

from groundstation.core.messages import Ask, Request
from groundstation.interfaces.api import stop_all
from groundstation.interfaces.api.client import request_command
from tests.unit.groundstation.machine.test_register import another


@pytest.fixture(autouse=True)
def _alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))


@pytest.mark.parametrize(
    ("ask", "number", "means"),
    [
        (Ask.LAND, signal.SIGTERM, "lands"),
        (Ask.DESCEND, signal.SIGTERM, "lands"),
        (Ask.KILL, signal.SIGQUIT, "motors off"),
    ],
)
def test_a_flight_whose_socket_is_not_served_gets_the_signal_that_means_the_same(
    ask: Ask, number: signal.Signals, means: str
) -> None:
    with another("bee") as bee:
        [told] = asyncio.run(stop_all(ask))
        assert not told.answered
        assert told.says.startswith(f"bee (process {bee.pid}): NOT ANSWERED: ")
        assert f"{number.name} sent ({means} as soon as it runs)" in told.says
        assert bee.wait(60) == -number


def test_a_kill_that_nobody_answers_is_given_by_signal_to_the_one_that_is_meant(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with another("bee") as bee, another("ant") as ant:
        assert request_command(Request(Ask.LAND), "bee", None) == 2
        assert request_command(Request(Ask.KILL), None, None) == 2  # either may be meant
        assert request_command(Request(Ask.KILL), "cat", None) == 2
        assert (bee.poll(), ant.poll()) == (None, None)
        assert request_command(Request(Ask.KILL), "bee", None) == 1
        assert "SIGQUIT sent (motors off as soon as it runs)" in capsys.readouterr().err
        assert bee.wait(60) == -signal.SIGQUIT
        assert ant.poll() is None


def test_a_bridge_is_left_to_its_station_and_stopped_by_kill() -> None:
    with another("0.0.0.0:14600", command="rf-bridge") as bridge:
        [told] = asyncio.run(stop_all(Ask.LAND))
        assert told.answered
        assert f"kill {bridge.pid} ends it and brings down what flies" in told.says
        assert bridge.poll() is None
        [told] = asyncio.run(stop_all(Ask.KILL))
        assert told.answered
        assert bridge.wait(60) == -signal.SIGQUIT
