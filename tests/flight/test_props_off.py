"""The props-off test against simulated vehicles: commands sent, and every end of it disarms."""

import asyncio
import contextlib
from collections.abc import Awaitable, Callable
from typing import Any

import msgspec
import pytest

from groundstation.flight import make_ends
from groundstation.lab.props_off import Guide, GuideStopped, Hand, News, NotProven
from groundstation.lab.props_off_hand import disarm, hold, idle_n
from groundstation.settings import Config
from links.mavlink.protocol import MavlinkCodec
from sim.autopilots import AUTOPILOTS
from sim.runs import Stage, from_floor
from sim.scenarios import SCENARIOS, prepare
from sim.time import VirtualTimeLoop
from tests.known import known
from tests.loops import in_virtual_time, running, until

Script = Callable[["Bench"], Awaitable[None]]
AUTOPILOT = pytest.mark.parametrize("autopilot", AUTOPILOTS)


class Bench:
    """A simulated vehicle, and a hand that holds it."""

    def __init__(self, config: Config, stage: Stage) -> None:
        self.config, self.stage = config, stage
        self.news: list[News] = []
        self.ordered = asyncio.Event()
        self.thrusts: list[tuple[float, float]] = []
        """When each set-point left, and its thrust [0..1]."""

    def heard(self, event: str) -> News:
        return next(news for news in self.news if news.event == event)

    async def until(self, event: str) -> News:
        await until(lambda: any(news.event == event for news in self.news))
        return self.heard(event)


def held(
    script: Script,
    idle_thrust: float = 0.0,
    *,
    autopilot: str = "px4",
    link: str = "mavlink",
    **parameters: float,
) -> Bench:
    """Have a hand hold the vehicle in virtual time while ``script`` runs, then let go."""

    async def main() -> Bench:
        world, config = from_floor(*prepare(SCENARIOS["paper"], [], link=link), None)
        flight = msgspec.structs.replace(config.flight, idle_thrust=idle_thrust)
        config = msgspec.structs.replace(config, flight=flight)
        stage = Stage(world, config, 0, autopilot=autopilot, parameters=parameters)
        bench, codec, loop = Bench(config, stage), MavlinkCodec(9, 1), asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)

        def tap(time_s: float, source: Any, _: Any, data: bytes) -> None:
            if source[1] == 14540:
                frames = codec.feed(data)
                bench.thrusts += [
                    (time_s, m.thrust) for m in frames if m.get_type() == "SET_ATTITUDE_TARGET"
                ]

        loop.tap = tap
        async with running(stage):
            ends = make_ends(config, stage.wires)
            news = bench.news.append
            holding = asyncio.create_task(hold(config, *ends, bench.ordered.wait(), news))
            try:
                await script(bench)
            finally:
                bench.ordered.set()
                await holding
                await asyncio.sleep(2.0)
        return bench

    return in_virtual_time(main)()


@AUTOPILOT
def test_motors_idle_by_arming_alone_until_it_is_told_to_let_go(autopilot: str) -> None:
    async def script(bench: Bench) -> None:
        await bench.until("armed")
        await asyncio.sleep(3.0)
        assert bench.stage.autopilot.armed

    bench = held(script, 0.5, autopilot=autopilot)
    assert [news.event for news in bench.news] == ["arming", "armed", "off"]
    assert not bench.stage.autopilot.armed
    assert {thrust for _, thrust in bench.thrusts} == {0.0}
    truth = bench.stage.plant.truth(ended_s(bench))
    # It stands where it stood.
    assert (truth.position_ned[2], truth.velocity_ned) == (1.0, (0.0, 0.0, 0.0))
    assert bench.heard("armed").firmware.endswith("1.16.0 release 73696d756c617465")


def ended_s(bench: Bench) -> float:
    """When the hand had let go [s]."""
    return bench.news[-1].at_s


@AUTOPILOT
def test_poses_that_stop_end_it_and_poses_that_come_back_start_nothing(autopilot: str) -> None:
    async def script(bench: Bench) -> None:
        await bench.until("armed")
        known(bench.stage.mocap).cover(True)
        await bench.until("silent")
        known(bench.stage.mocap).cover(False)
        await asyncio.sleep(2.0)

    bench = held(script, autopilot=autopilot)
    silent = bench.heard("silent")
    assert 0.25 <= silent.at_s - known(silent.pose_s) < 0.25 + 0.05
    assert max(time_s for time_s, _ in bench.thrusts) <= silent.at_s
    assert not bench.stage.autopilot.armed


def test_a_vehicle_that_somebody_else_has_armed_is_left_alone() -> None:
    async def script(bench: Bench) -> None:
        bench.stage.autopilot.armed = True
        failed = await bench.until("failed")
        assert "somebody else has armed it" in failed.text

    bench = held(script)
    assert [news.event for news in bench.news] == ["failed"]
    assert bench.stage.autopilot.armed
    assert bench.thrusts == []


def test_an_autopilot_that_would_take_thrust_for_a_climb_rate_is_not_armed() -> None:
    async def script(bench: Bench) -> None:
        assert "GUID_OPTIONS" in (await bench.until("failed")).text

    bench = held(script, autopilot="ardupilot", GUID_OPTIONS=0.0)
    assert [news.event for news in bench.news] == ["failed"]


def test_one_that_disarms_itself_tells_so_and_no_poses_are_told_as_such() -> None:
    async def disarms(bench: Bench) -> None:
        await bench.until("armed")
        bench.stage.autopilot.armed = False
        assert "silent" in [(await bench.until(event)).event for event in ("disarmed", "silent")]

    held(disarms)

    async def blind(bench: Bench) -> None:
        known(bench.stage.mocap).cover(True)
        assert "no pose within 5 s" in (await bench.until("failed")).text

    held(blind)


def test_a_radio_gets_the_configured_idle_thrust_and_disarm_frames_last() -> None:
    async def script(bench: Bench) -> None:
        await bench.until("armed")
        await asyncio.sleep(1.0)

    bench = held(script, 0.1, link="dsm")
    assert idle_n(bench.config) == pytest.approx(0.1 * bench.config.weight_n)
    assert [news.event for news in bench.news] == ["arming", "armed", "off"]
    assert bench.stage.plant.truth(ended_s(bench)).on_ground


def test_a_hand_that_only_disarms_stops_what_another_has_left() -> None:
    async def main() -> tuple[list[News], Stage]:
        world, config = prepare(SCENARIOS["paper"], [])
        stage, told = Stage(world, config, 0), list[News]()
        stage.autopilot.armed = True
        async with running(stage):
            await disarm(*make_ends(config, stage.wires), told.append)
        return told, stage

    told, stage = in_virtual_time(main)()
    assert [news.event for news in told] == ["off"]
    assert not stage.autopilot.armed


# ---- the guide


class ScriptedHand(Hand):
    """A hand without a process: it tells what it is told to, and notes what becomes of it."""

    def __init__(self, coming: list[tuple[float, News]], *, acknowledges: bool = True) -> None:
        self.heard: list[News] = []
        self.end = ""
        self._coming = coming
        self._acknowledges = acknowledges

    async def until(self, event: str, within_s: float) -> News:
        async with asyncio.timeout(within_s):
            while self._coming:
                wait_s, news = self._coming[0]
                await asyncio.sleep(wait_s)
                self._coming.pop(0)
                now_s = asyncio.get_running_loop().time()
                news = News(news.event, now_s, news.text, news.pose_s, news.firmware)
                self.heard.append(news)
                if news.event == event:
                    return news
                if news.event == "failed":
                    raise GuideStopped(news.text)
            await asyncio.sleep(1e6)
        raise AssertionError

    async def listen(self, for_s: float) -> None:
        with contextlib.suppress(TimeoutError):
            await self.until("nothing", for_s)

    async def off(self) -> News | None:
        self.end = self.end or "off"
        await asyncio.sleep(0.05)
        if self.end != "off" or not self._acknowledges:
            return None
        return News("off", asyncio.get_running_loop().time())

    async def kill(self) -> None:
        self.end = "killed"


ARMS = [(0.1, News("arming", 0.0)), (1.0, News("armed", 0.0, firmware="PX4 1.16.0"))]
SILENT = (5.0, News("silent", 0.0, pose_s=0.0))
LOST = (5.0, News("lost", 0.0, "no HEARTBEAT for 3 s"))
WHOLE: list[list[tuple[float, News]]] = [[], [SILENT], [], [LOST], []]


class Scene:
    """One test as it was guided."""

    def __init__(self, more: list[list[tuple[float, News]]], **changes: Any) -> None:
        self._more = [list(each) for each in more]
        self._changes = changes
        self.hands: list[ScriptedHand] = []
        self.disarming: list[ScriptedHand] = []
        self.asked: list[str] = []
        self.said: list[str] = []
        self.answers: Callable[[str], str] = lambda question: "y"
        self.shown: dict[str, str] = {}

    async def open(self, config: Config, *words: str) -> ScriptedHand:
        if words == ("disarm",):
            hand = ScriptedHand([], acknowledges=self._changes.get("disarms", True))
            self.disarming.append(hand)
        else:
            acknowledges = self._changes.get("acknowledges", True)
            hand = ScriptedHand([*ARMS, *self._more.pop(0)], acknowledges=acknowledges)
            self.hands.append(hand)
        return hand

    async def ask(self, question: str) -> str:
        self.asked.append(question)
        await asyncio.sleep(1.5)
        return self.answers(question)

    async def guide(self) -> None:
        _, config = prepare(SCENARIOS["paper"], [])
        self.shown = await Guide(config, self.open, self.ask, self.said.append).run()

    def run(self) -> None:
        in_virtual_time(self.guide)()


def test_all_steps_are_gone_through_and_what_was_measured_is_shown() -> None:
    scene = Scene(WHOLE)
    scene.run()
    steps = "motors and kill, no poses, program killed, plug pulled, remote control's kill switch"
    assert ", ".join(scene.shown) == steps
    assert "acknowledged 50 ms after the order" in scene.shown["motors and kill"]
    assert "ms after the last pose" in scene.shown["no poses"]
    assert "the motors stopped 1.5 s after it" in scene.shown["program killed"]
    assert [hand.end for hand in scene.hands] == ["off", "off", "killed", "off", "off"]
    assert len(scene.disarming) == 1, "after the one that was killed"


@pytest.mark.parametrize("number", range(7))
def test_an_answer_that_is_not_yes_ends_it_with_the_motors_off(number: int) -> None:
    scene, yes = Scene(WHOLE), 0

    def answers(question: str) -> str:
        nonlocal yes
        if "[y/n]" not in question:
            return ""
        yes += 1
        return "" if yes == number + 1 else "y"

    scene.answers = answers
    with pytest.raises(NotProven):
        scene.run()
    assert all(hand.end == "off" for hand in scene.hands if hand.end != "killed")
    assert len(scene.disarming) == sum(hand.end == "killed" for hand in scene.hands)


@pytest.mark.parametrize("after_s", [0.5, 2.0, 4.0, 11.0, 24.0])
@in_virtual_time
async def test_an_interruption_at_any_time_ends_it_with_the_motors_off(after_s: float) -> None:
    scene = Scene(WHOLE)
    guided = asyncio.create_task(scene.guide())
    await asyncio.sleep(after_s)
    guided.cancel()
    await asyncio.sleep(0.02)
    guided.cancel()  # an operator who presses twice
    with pytest.raises(asyncio.CancelledError):
        await guided
    assert scene.hands
    assert all(hand.end in ("off", "killed") for hand in scene.hands)
    assert len(scene.disarming) == sum(hand.end == "killed" for hand in scene.hands)


def test_a_vehicle_that_disarms_itself_too_early_has_the_step_once_more() -> None:
    early = [(0.0, News("disarmed", 0.0)), (0.0, News("silent", 0.0, pose_s=1e9))]
    scene = Scene([[], early, *WHOLE[1:]])
    scene.run()
    assert len(scene.hands) == 6
    assert any("Once more" in line for line in scene.said)
    scene = Scene([[], early, early, early])
    with pytest.raises(GuideStopped, match="disarmed itself 3 times"):
        scene.run()


def test_motors_that_nobody_sees_stop_prove_nothing() -> None:
    scene = Scene(WHOLE)
    told = scene.ask

    async def ask(question: str) -> str:
        if "as soon as the motors have stopped" in question:
            await asyncio.sleep(1000.0)
        return await told(question)

    scene.ask = ask  # type: ignore[method-assign]
    with pytest.raises(NotProven, match="still turned 15 s later"):
        scene.run()
    assert len(scene.disarming) == 1


def test_a_vehicle_that_nobody_can_disarm_is_said_loudly() -> None:
    scene = Scene(WHOLE, acknowledges=False, disarms=False)
    with pytest.raises(NotProven, match="nobody acknowledged"):
        scene.run()
    assert len(scene.disarming) == 3
    assert any("THE VEHICLE MAY STILL BE ARMED" in line for line in scene.said)


def test_a_hand_that_cannot_arm_ends_it_and_nothing_is_disarmed_that_it_did_not_arm() -> None:
    scene = Scene([[]])

    async def refused(config: Config, *words: str) -> ScriptedHand:
        failed = News("failed", 0.0, "somebody else has armed it")
        hand = ScriptedHand([(0.1, failed)], acknowledges=False)
        scene.hands.append(hand)
        return hand

    scene.open = refused  # type: ignore[method-assign]
    with pytest.raises(GuideStopped, match="somebody else"):
        scene.run()
    assert len(scene.hands) == 1
