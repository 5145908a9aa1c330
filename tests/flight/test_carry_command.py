"""``groundstation carry`` towards a simulated tracker and autopilot, through their real bytes."""

import asyncio
import json
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import msgspec
import pytest

from groundstation.config import ConfigError, load
from groundstation.core.geometry import so3
from groundstation.lab import pose_monitor as command
from groundstation.machine import sleep_until
from groundstation.runtime import Exit
from groundstation.settings import Config
from links.io import parse_address
from links.mavlink.protocol import MavlinkCodec
from sim.autopilots import AUTOPILOTS, AutopilotPeer
from sim.time import VirtualTimeLoop
from sim.trackers import TrackedBody, make_tracker
from sim.world import TrueState, make_hand
from tests.airframe_double import Brick
from tests.carried import START
from tests.known import known
from tests.loops import in_virtual_time

LATENCY_S = 0.035
LAB = """\
# our lab
[vehicle]
name = "mqx"

[pose]  # the cameras
kind = "vicon"
latency_s = 0.02   # a guess

[pose.alignment]
centre_of_mass_m = [0.0, 0.0, 0.06]

[link]
listen = "127.0.0.1:14540"
"""


class Hand(Brick):
    """Carried along the moves, whatever it is told."""

    def __init__(self, seed: int) -> None:
        super().__init__(1.0, held=True)
        self._at = make_hand(seed, *START)

    def truth(self, time_s: float) -> TrueState:
        place, attitude, rates = self._at(max(time_s - 1.0, 0.0))
        moved = {"position_ned": place, "attitude": attitude, "rates_rad_s": rates}
        return msgspec.structs.replace(super().truth(time_s), **moved)


class Room:
    """A tracker with axes of its own and an autopilot; both follow one hand."""

    def __init__(
        self, config: Config, autopilot: str = "px4", *, armed_at_s: float | None = None
    ) -> None:
        self.config = config
        self.hand = Hand(2)
        self.autopilot = AUTOPILOTS[autopilot](self.hand)
        self.armed_at_s = armed_at_s
        self.sent: set[str] = set()
        self._reader = MavlinkCodec(255, 1)

    def run(self, work: Coroutine[Any, Any, Any]) -> Any:
        """``asyncio.run`` in this room."""

        async def main() -> Any:
            loop = asyncio.get_running_loop()
            assert isinstance(loop, VirtualTimeLoop)
            loop.tap = self._tap
            peer = AutopilotPeer(self.autopilot, parse_address("127.0.0.1:14540"))
            tasks = [asyncio.create_task(peer.run()), asyncio.create_task(self._track())]
            try:
                return await work
            finally:
                for task in tasks:
                    task.cancel()
                await asyncio.gather(*tasks, return_exceptions=True)

        return in_virtual_time(main)()

    def _tap(
        self, _time_s: float, source: tuple[str, int], _target: tuple[str, int], data: bytes
    ) -> None:
        if source[1] == 14540:
            self.sent |= {message.get_type() for message in self._reader.feed(data)}

    async def _track(self) -> None:
        loop = asyncio.get_running_loop()
        made = known(make_tracker(self.config.pose))
        name, tracker = made
        await tracker.open()
        for frame in range(100_000):
            when = frame / 50.0
            await sleep_until(when)
            if self.armed_at_s is not None and when > self.armed_at_s:
                self.autopilot.armed = True
            truth = self.hand.truth(when)
            jitter = 2e-4 * ((frame * 7919) % 13 - 6)  # so that a held vehicle does not look frozen
            attitude = so3.rotate(truth.attitude, (jitter, 0.0, 0.0))
            seen = TrackedBody(name, truth.position_ned, attitude, True)
            loop.call_at(when + LATENCY_S, tracker.send, frame, when, [seen])


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    """A lab's file, of Vicon's cameras."""
    path = tmp_path / "lab.toml"
    path.write_text(LAB)
    return path


Carry = Callable[..., tuple[Room, int, str, str]]


@pytest.fixture
def carry(lab: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Carry:
    """Carry the vehicle of ``lab``: the room, the exit code, both streams."""

    def carry(
        autopilot: str = "px4", *, as_json: bool = True, **more: Any
    ) -> tuple[Room, int, str, str]:
        told = load(lab, Config)
        pose: Any = told.pose
        turned = {"lab_rotation_deg": (0.0, 0.0, 40.0), "body_rotation_deg": (0.0, 0.0, 15.0)}
        alignment = msgspec.structs.replace(pose.alignment, **turned)
        true = msgspec.structs.replace(pose, world="eus", body="rub", alignment=alignment)
        there = Room(msgspec.structs.replace(told, pose=true), autopilot, **more)
        monkeypatch.setattr(asyncio, "run", there.run)
        code = command.carry_command(told, lab, [], as_json=as_json, keep=False)
        return there, code, *capsys.readouterr()

    return carry


@pytest.mark.parametrize(("kind", "autopilot"), [("vicon", "px4"), ("json", "ardupilot")])
def test_the_axes_and_the_latency_are_found_and_written(
    kind: str, autopilot: str, lab: Path, carry: Carry
) -> None:
    lab.write_text(LAB.replace("vicon", kind))
    there, code, out, errors = carry(autopilot)
    assert code == 0
    facts = json.loads(out)
    assert facts["ok"] is True
    assert facts["synchronised"] is True
    assert (facts["found"]["world"], facts["found"]["body"]) == ("eus", "rub")
    pose: Any = load(lab, Config).pose
    assert (pose.world, pose.body) == ("eus", "rub")
    assert pose.alignment.lab_rotation_deg == pytest.approx((0.0, 0.0, 40.0), abs=1.0)
    assert pose.alignment.body_rotation_deg == pytest.approx((0.0, 0.0, 15.0), abs=1.0)
    assert pose.alignment.centre_of_mass_m == (0.0, 0.0, 0.06), "what was not measured stays"
    assert pose.latency_s == pytest.approx(LATENCY_S, abs=0.005)
    assert "# our lab" in lab.read_text()
    assert lab.with_name("lab.toml.before-carry").read_text() == LAB.replace("vicon", kind)
    assert sorted(lab.parent.iterdir()) == [lab, lab.with_name("lab.toml.before-carry")]
    assert errors.startswith("Propellers off")
    assert [line[:6] for line in errors.splitlines()[1:10]] == [f"{n} of 9" for n in range(1, 10)]
    assert there.sent <= {"HEARTBEAT", "TIMESYNC", "COMMAND_LONG"}


@pytest.mark.parametrize("armed_at_s", [-1.0, 12.0])
def test_an_armed_vehicle_is_refused_at_once_and_on_the_way(
    armed_at_s: float, lab: Path, carry: Carry
) -> None:
    there, code, out, errors = carry(armed_at_s=armed_at_s)
    assert code == 1
    assert "ARMED" in json.loads(out)["why"]
    assert "9 of 9" not in errors
    assert lab.read_text() == LAB
    assert "SET_ATTITUDE_TARGET" not in there.sent


def test_without_an_autopilot_json_is_one_object_with_the_reason(lab: Path, carry: Carry) -> None:
    lab.write_text(LAB.replace("14540", "14541"))
    _, code, out, errors = carry()
    facts = json.loads(out)
    assert (code, facts["ok"], facts["found"], facts["written"]) == (3, False, None, None)
    assert facts["why"] in errors


def test_ctrl_c_leaves_one_object_and_writes_nothing(
    lab: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:

    def pressed(work: Coroutine[Any, Any, Any]) -> None:
        work.close()
        raise KeyboardInterrupt

    monkeypatch.setattr(asyncio, "run", pressed)
    code = command.carry_command(load(lab, Config), lab, [], as_json=True, keep=False)
    assert code == Exit.INTERRUPTED
    facts = json.loads(capsys.readouterr().out)
    assert (facts["ok"], facts["why_id"]) == (False, "carry.interrupted")
    assert lab.read_text() == LAB


def test_a_file_that_can_not_be_changed_is_left_and_the_lines_shown(
    lab: Path, carry: Carry
) -> None:
    text = 'pose = { kind = "vicon", latency_s = 0.02 }\n'
    lab.write_text(text)
    with pytest.raises(ConfigError, match=r'put this into it: .*world = "eus"'):
        carry(as_json=False)
    assert lab.read_text() == text
    assert [*lab.parent.iterdir()] == [lab]
