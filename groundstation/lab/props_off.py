"""Propellers-off test: asks, leads through the steps with the vehicle's lock held, and keeps what
was proven.
"""

import asyncio
import contextlib
import os
import signal
import sys
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from datetime import UTC, datetime
from typing import Literal

import msgspec

from groundstation.config import ConfigError, dump, refuse_io
from groundstation.core.messages import notice
from groundstation.flight.preflight import (
    Proof,
    hash_sections,
    line_from_terminal,
    proof_path,
    save_proof,
)
from groundstation.lab.pose_monitor import PATIENCE_S
from groundstation.machine import ApiError, Taken, hold_lock, precise_loop, socket_path, to_the_end
from groundstation.runtime import Exit
from groundstation.settings import Config
from links.core import NEWS_S
from links.io import open_child
from links.rf import AFTERLIFE_S
from links.text import Sentence

LOOK_S = 3.0
"""Motors turn this long before the program is killed, and are watched this long to stay off [s]."""
STOP_S = 15.0
"""Timeout for motors to stop that nobody here can stop, and for a hand to let go [s]: the longest
failsafe of an autopilot. An order that nobody acknowledges is repeated for 5 s."""
HEAR_S = 0.05
"""Time in which everything reported meanwhile is read [s]."""
TRIES = 3
"""Attempts at a step that the vehicle ends by disarming itself, and at a disarming."""


Event = Literal["arming", "armed", "silent", "lost", "disarmed", "failed", "off"]


class News(msgspec.Struct, frozen=True):
    """Report of the vehicle."""

    event: Event
    """``arming``: from here on the motors may turn. ``armed``: they do. ``silent``: nothing leaves
    any more. ``lost``: the link is. ``disarmed``: the vehicle tells so. ``failed``: it can't go on.
    ``off``: the order to stop was acknowledged, and that is the last."""
    at_s: float
    """On the machine's monotonic clock [s]."""
    text: str = ""
    """Why."""
    pose_s: float | None = None
    """Stamp of the newest pose [s, the same clock]."""
    firmware: str = ""
    """The autopilot's firmware as reported."""


class GuideStopped(Exception):
    """The test can't go on; the sentence says why."""


class NotProven(Exception):
    """A step has shown that the vehicle is not safe; the sentence says which."""


class _StepAgain(Exception):
    """The vehicle has disarmed itself before the step was over."""


class Hand:
    """Process that holds one armed vehicle, and can also disarm it
    (groundstation/lab/props_off_hand.py).
    """

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        assert process.stdin is not None and process.stdout is not None, "both are pipes"
        self._process = process
        self._in, self._out = process.stdin, process.stdout
        self.heard: list[News] = []
        """All that it has told."""

    async def until(self, event: str, within_s: float) -> News:
        """Its next news of ``event``.

        Raises:
            TimeoutError: none comes within ``within_s`` [s].
            GuideStopped: it can't go on.
        """
        async with asyncio.timeout(within_s):
            while True:
                news = await self._next()
                if news is None:
                    raise GuideStopped(notice("props.hand_ended"))
                if news.event == event:
                    return news
                if news.event == "failed":
                    raise GuideStopped(news.text)

    async def listen(self, for_s: float) -> None:
        """Hear what it tells for ``for_s`` [s]."""
        with suppress(TimeoutError):
            async with asyncio.timeout(for_s):
                while await self._next() is not None:
                    pass

    async def _next(self) -> News | None:
        line = await self._out.readline()
        if not line:
            return None
        news = msgspec.json.decode(line, type=News)
        self.heard.append(news)
        return news

    async def off(self) -> News | None:
        """Have it order the motors off.

        Its news of the acknowledgement, None where there was none.
        """
        self._in.close()
        try:
            await self.listen(STOP_S)
            if self._process.returncode is None:
                async with asyncio.timeout(1.0):
                    await self._process.wait()
        except TimeoutError:
            await self.kill()
        return next((news for news in self.heard if news.event == "off"), None)

    async def kill(self) -> None:
        """End it at once, with SIGKILL."""
        with suppress(ProcessLookupError):
            os.kill(self._process.pid, signal.SIGKILL)
        await self._process.wait()


async def open_hand(config: Config, *words: str) -> Hand:
    """Start a hand; with the word ``disarm`` one that disarms only."""
    process = await open_child(
        "groundstation.lab.props_off_hand", *words, stdin=asyncio.subprocess.PIPE
    )
    hand = Hand(process)
    assert process.stdin is not None, "it is a pipe"
    process.stdin.write(msgspec.json.encode(dump(config)) + b"\n")
    await process.stdin.drain()
    return hand


Ask = Callable[[str], Awaitable[str]]
"""Puts a question to the operator."""


class Guide:
    """One test of one vehicle. Times are on the event loop's clock [s], which is the hand's."""

    def __init__(
        self,
        config: Config,
        open_hand: Callable[..., Awaitable[Hand]],
        ask: Ask,
        say: Callable[[str], None],
    ) -> None:
        """``open_hand(config, *words)`` is :func:`groundstation.lab.props_off.open_hand`."""
        self._config = config
        self._open = open_hand
        self._ask = ask
        self._say = say
        self._tells = config.link.has_autopilot
        """Whether the vehicle tells that it is disarmed."""
        self.firmware = ""
        """The autopilot's firmware as reported."""

    async def run(self) -> dict[str, str]:
        """Go through all steps; returns each with what it has shown.

        Raises:
            NotProven: one of them failed.
            GuideStopped: it can't go on.
        """
        steps: list[tuple[str, Callable[[], Awaitable[str]]]] = [("motors and kill", self._motors)]
        if not self._config.pose.by_autopilot:
            steps.append(("no poses", self._poses))
        steps += [("program killed", self._kill_program), ("plug pulled", self._pull_plug)]
        if self._tells:
            steps.append(("remote control's kill switch", self._switch))
        shown: dict[str, str] = {}
        for number, (name, step) in enumerate(steps, 1):
            self._say(f"\n{notice('props.step', number=number, count=len(steps), name=name)}")
            shown[name] = await self._try(step)
            self._tell("props.proven", what=shown[name])
        return shown

    async def _try(self, step: Callable[[], Awaitable[str]]) -> str:
        for _ in range(TRIES):
            try:
                return await step()
            except _StepAgain:
                self._tell("props.once_more")
        raise GuideStopped(notice("props.disarms_itself", count=TRIES))

    # ---- the steps

    async def _motors(self) -> str:
        async with self._hold_armed() as hand:
            await self._yes("props.ask_turning")
            await self._ensure_armed(hand)
            told_s = _now()
            acknowledged = await hand.off()
            if acknowledged is None:
                raise NotProven(notice("props.unacknowledged"))
        await self._yes("props.ask_stopped_at_once")
        if not self._tells:
            return notice("props.by_eye").text
        return notice("props.acknowledged", after_ms=1e3 * (acknowledged.at_s - told_s)).text

    async def _poses(self) -> str:
        coast_s = self._config.flight.coast_s
        async with self._hold_armed() as hand:
            self._tell("props.cover")
            silent = await self._event(hand, "silent", "props.poses_come")
            if silent.pose_s is None or silent.at_s - silent.pose_s < coast_s:
                raise _StepAgain
            disarmed = await self._await_disarmed(hand)
            await self._yes("props.ask_stopped")
            await self._go_on("props.uncover")
            await hand.listen(LOOK_S)
            await self._yes("props.ask_stayed_off")
        after_ms = 1e3 * (silent.at_s - silent.pose_s)
        if disarmed is None:
            return notice("props.silent", after_ms=after_ms).text
        disarmed_s = disarmed.at_s - silent.pose_s
        return notice("props.silent_disarmed", after_ms=after_ms, disarmed_s=disarmed_s).text

    async def _kill_program(self) -> str:
        async with self._hold_armed() as hand:
            self._tell("props.kill_soon", after_s=LOOK_S)
            await asyncio.sleep(LOOK_S)
            await self._ensure_armed(hand)
            await hand.kill()
            lasted_s = await self._time_stop(notice("props.killed"))
        return notice("props.after_kill", after_s=lasted_s).text

    async def _pull_plug(self) -> str:
        async with self._hold_armed() as hand:
            self._tell("props.pull")
            lost = await self._event(hand, "lost", "props.unnoticed")
            lasted_s = await self._time_stop(notice("props.noticed", what=lost.text))
            await self._go_on("props.plug_back")
        return notice("props.after_notice", after_s=lasted_s).text

    async def _switch(self) -> str:
        async with self._hold_armed():
            lasted_s = await self._time_stop(notice("props.switch"))
        return notice("props.within", after_s=lasted_s).text

    # ---- what they are made of

    @asynccontextmanager
    async def _hold_armed(self) -> AsyncIterator[Hand]:
        """The vehicle armed and idling; disarmed afterwards, however that comes."""
        self._tell("props.arming")
        hand = await self._open(self._config)
        try:
            try:
                news = await hand.until("armed", PATIENCE_S)
            except TimeoutError:
                raise GuideStopped(notice("props.not_armed", limit_s=PATIENCE_S)) from None
            self.firmware = news.firmware
            yield hand
        finally:
            await to_the_end(self._disarm(hand))

    async def _disarm(self, hand: Hand) -> None:
        acknowledged = await hand.off()
        if not any(news.event == "arming" for news in hand.heard):
            return  # what somebody else may have armed is not ours to stop
        if acknowledged is not None:
            self._tell("props.off")
            return
        why = ""
        for attempt in range(TRIES):
            if attempt:
                await asyncio.sleep(AFTERLIFE_S)  # a killed radio's pacer holds the port so long
            other = await self._open(self._config, "disarm")
            if await other.off() is not None:
                self._tell("props.off")
                return
            why = "; ".join(news.text for news in other.heard if news.event == "failed") or why
        self._say(f"\n{notice('props.may_be_armed', why=why or 'no answer')}")

    async def _await_disarmed(self, hand: Hand) -> News | None:
        """Wait until the vehicle tells that it is disarmed; None where it does not in time."""
        for news in hand.heard:
            if news.event == "disarmed":
                return news
        try:
            return await hand.until("disarmed", STOP_S) if self._tells else None
        except TimeoutError:
            return None

    async def _ensure_armed(self, hand: Hand) -> None:
        await hand.listen(HEAR_S)
        if any(news.event in ("disarmed", "silent") for news in hand.heard):
            raise _StepAgain

    async def _event(self, hand: Hand, event: str, otherwise: str) -> News:
        """Wait for the event that the operator was asked for.

        Where none comes, the sentence ``otherwise`` is true.
        """
        try:
            news = await hand.until(event, PATIENCE_S)
        except TimeoutError:
            raise NotProven(notice(otherwise)) from None
        if any(one.event == "disarmed" and one.at_s < news.at_s - NEWS_S for one in hand.heard):
            raise _StepAgain
        return news

    async def _time_stop(self, says: Sentence) -> float:
        """Measure the time until the motors stop, as the operator sees it [s]."""
        since_s = _now()
        try:
            async with asyncio.timeout(STOP_S):
                await self._ask(f"     {notice('props.press_enter', what=says, limit_s=STOP_S)}")
        except TimeoutError:
            raise NotProven(notice("props.still_turning", limit_s=STOP_S)) from None
        lasted_s = _now() - since_s
        await self._yes("props.ask_stopped_by_that")
        return lasted_s

    async def _yes(self, id: str) -> None:
        question = notice(id)
        answer = await self._ask(f"     {question} [y/n] ")
        if answer.strip().lower() not in ("y", "yes"):
            raise NotProven(notice("props.not_confirmed", question=question))

    async def _go_on(self, id: str) -> None:
        await self._ask(f"     {notice(id)}")

    def _tell(self, id: str, **values: object) -> None:
        self._say(f"     {notice(id, **values)}")


def _now() -> float:
    return asyncio.get_running_loop().time()


SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)


def props_off_command(config: Config, now_s: float) -> Exit:
    """The test of the vehicle of ``config``.

    ``now_s`` is the wall time at its beginning [s since 1970].

    Raises:
        ConfigError: nobody sits at a terminal, or what was proven can't be kept.
    """
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise ConfigError("props-off", notice("props.terminal"))
    try:
        with (
            hold_lock(socket_path(config.status, config.vehicle.name), config.vehicle.name),
            asyncio.Runner(loop_factory=precise_loop) as runner,
        ):
            return runner.run(_guide(config, now_s))
    except Taken as error:
        print(f"groundstation: {error}", file=sys.stderr)
        return Exit.TAKEN
    except ApiError as error:
        raise ConfigError("status.path", str(error)) from None


async def _guide(config: Config, now_s: float) -> Exit:
    loop, guided = asyncio.get_running_loop(), asyncio.current_task()
    assert guided is not None, "this is a task"
    for number in SIGNALS:  # the motors are ordered off first, whatever wants this to end
        loop.add_signal_handler(number, guided.cancel)
    began_s, name = loop.time(), config.vehicle.name
    guide = Guide(config, open_hand, line_from_terminal, _say)
    try:
        _say(notice("props.begin", vehicle=name))
        if (await line_from_terminal(notice("props.confirm", vehicle=name).text)).strip() != name:
            _say(notice("props.not_begun"))
            return Exit.FAILED
        steps = await guide.run()
    except NotProven as error:
        _say(f"\n{notice('props.not_proven', why=error)}")
        return Exit.FAILED
    except GuideStopped as error:
        _say(f"\n{notice('props.stopped', why=error)}")
        return Exit.FAILED
    except asyncio.CancelledError:
        _say(f"\n{notice('props.interrupted')}")
        return Exit.FAILED
    date = datetime.fromtimestamp(now_s + loop.time() - began_s, tz=UTC).isoformat(
        timespec="seconds"
    )
    path = proof_path(config)
    with refuse_io("props-off", "props.unwritable", path):
        save_proof(
            Proof(
                vehicle=name,
                digest=hash_sections(config),
                firmware=guide.firmware,
                date=date,
                steps=steps,
            ),
            path,
        )
    _say(f"\n{notice('props.passed', path=path, firmware=guide.firmware or 'not told')}")
    return Exit.DONE


def _say(line: str | Sentence) -> None:
    with contextlib.suppress(OSError):  # a terminal that is gone: its hang-up ends the test
        print(line, flush=True)
