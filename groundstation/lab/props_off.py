"""Propellers-off test: asks, leads through the steps with the vehicle's lock held, and keeps what was proven."""

import asyncio
import contextlib
import os
import signal
import sys
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from datetime import UTC, datetime
from typing import Literal, Protocol

import msgspec

from groundstation.config import ConfigError, dump
from groundstation.flight import Proof, digest, line_from_terminal, place, save
from groundstation.machine import (
    ApiError,
    Taken,
    hold_lock,
    lock_path,
    precise_loop,
    socket_path,
    to_the_end,
)
from groundstation.runtime import Exit
from groundstation.settings import Config
from links.io import open_child

ARM_S = 90.0
"""Timeout to connect and to arm [s]."""
LOOK_S = 3.0
"""The motors turn this long before the program is killed, and are watched this long to stay off
[s]."""
ACT_S = 60.0
"""Timeout for the operator's action in a step [s]."""
STOP_S = 15.0
"""Timeout for motors to stop that nobody here can stop [s]: the longest failsafe of an
autopilot."""
HEAR_S = 0.05
"""Time in which everything reported meanwhile is read [s]."""
NEWS_S = 3.0
"""Largest age of the vehicle's report [s]; it reports once a second."""
TRIES = 3
"""Attempts at a step that the vehicle ends by disarming itself, and at a disarming."""
AGAIN_S = 3.0
"""Wait before it is tried again to disarm [s]: the pacer of a radio that was killed holds the port for so long."""


Event = Literal["arming", "armed", "silent", "lost", "disarmed", "failed", "off"]


class News(msgspec.Struct, frozen=True):
    """Report of the vehicle."""

    event: Event
    """``arming``: from here on the motors may turn. ``armed``: they do. ``silent``: nothing leaves any more. ``lost``:
    the link is. ``disarmed``: the vehicle tells so. ``failed``: it can't go on. ``off``: the order to stop was
    acknowledged, and that is the last."""
    at_s: float
    """On the machine's monotonic clock [s]."""
    text: str = ""
    """Why."""
    pose_s: float | None = None
    """Stamp of the newest pose [s, the same clock]."""
    firmware: str = ""
    """The autopilot's firmware as reported."""


class GuideStopped(Exception):
    """The test can't go on; the text says why."""


class NotProven(Exception):
    """A step has shown that the vehicle is not safe; the text says which."""


class _StepAgain(Exception):
    """The vehicle has disarmed itself before the step was over."""


class Hand(Protocol):
    """Holder of one armed vehicle, which can also disarm it."""

    heard: list[News]
    """All that it has told."""

    async def until(self, event: str, within_s: float) -> News:
        """Its next news of ``event``.

        Raises:
            TimeoutError: none comes within ``within_s`` [s].
            Trouble: it can't go on.
        """

    async def listen(self, for_s: float) -> None:
        """Hear what it tells for ``for_s`` [s]."""

    async def off(self) -> News | None:
        """Have it order the motors off; its news of the acknowledgement, None where there was none."""

    async def kill(self) -> None:
        """End it at once, with SIGKILL."""


Ask = Callable[[str], Awaitable[str]]
"""Puts a question to the operator."""


class Guide:
    """One test of one vehicle. Times are on the event loop's clock [s], which is the hand's."""

    def __init__(
        self, config: Config, open_hand: Callable[..., Awaitable[Hand]], ask: Ask, say: Callable[[str], None]
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
            Trouble: it can't go on.
        """
        steps: list[tuple[str, Callable[[], Awaitable[str]]]] = [("motors and kill", self._motors)]
        if not self._config.pose.by_autopilot:
            steps.append(("no poses", self._poses))
        steps += [("program killed", self._kill_program), ("plug pulled", self._pull_plug)]
        if self._tells:
            steps.append(("remote control's kill switch", self._switch))
        shown: dict[str, str] = {}
        for number, (name, step) in enumerate(steps, 1):
            self._say(f"\n{number}/{len(steps)}  {name}")
            shown[name] = await self._try(step)
            self._say(f"     proven: {shown[name]}")
        return shown

    async def _try(self, step: Callable[[], Awaitable[str]]) -> str:
        for _ in range(TRIES):
            try:
                return await step()
            except _StepAgain:
                self._say(
                    "     The vehicle disarmed itself before the step was over, as one that does not take off does "
                    "(COM_DISARM_PRFLT, DISARM_DELAY). Once more."
                )
        raise GuideStopped(f"the vehicle disarmed itself {TRIES} times before the step was over: allow it more time")

    # ---- the steps

    async def _motors(self) -> str:
        async with self._hold_armed() as hand:
            await self._yes("Do all motors turn, slowly, and each the right way round?")
            await self._ensure_armed(hand)
            told_s = _now()
            acknowledged = await hand.off()
            if acknowledged is None:
                raise NotProven("nobody acknowledged the order to stop the motors")
        await self._yes("They were ordered off, as Ctrl-\\ does. Did they stop at once?")
        if not self._tells:
            return "stopped, by the operator's eye"
        return f"stopped, acknowledged {1e3 * (acknowledged.at_s - told_s):.0f} ms after the order"

    async def _poses(self) -> str:
        coast_s = self._config.flight.coast_s
        async with self._hold_armed() as hand:
            self._say("     Cover the markers, or close the tracker, NOW. The motors must stop.")
            silent = await self._event(hand, "silent", "poses still come")
            if silent.pose_s is None or silent.at_s - silent.pose_s < coast_s:
                raise _StepAgain
            disarmed = await self._await_disarmed(hand)
            await self._yes("Did the motors stop?")
            await self._go_on(
                "Uncover the markers, or open the tracker again, and press Enter: the motors must stay off. "
            )
            await hand.listen(LOOK_S)
            await self._yes("Did they stay off?")
        says = f"nothing left {1e3 * (silent.at_s - silent.pose_s):.0f} ms after the last pose"
        if disarmed is not None:
            says += f", the vehicle told {disarmed.at_s - silent.pose_s:.1f} s after it that it is disarmed"
        return says

    async def _kill_program(self) -> str:
        async with self._hold_armed() as hand:
            self._say(
                f"     In {LOOK_S:g} s the program that flies is killed (SIGKILL). The motors must stop by themselves."
            )
            await asyncio.sleep(LOOK_S)
            await self._ensure_armed(hand)
            await hand.kill()
            lasted_s = await self._time_stop("It is killed.")
        return f"the motors stopped {lasted_s:.1f} s after it, by the operator's eye"

    async def _pull_plug(self) -> str:
        async with self._hold_armed() as hand:
            self._say(
                "     Pull the plug between this program and the vehicle NOW: the network's, the telemetry radio's, or "
                "the module's. The motors must stop by themselves."
            )
            lost = await self._event(hand, "lost", "this program noticed nothing: was it the right plug?")
            lasted_s = await self._time_stop(f"This program has noticed: {lost.text}.")
            await self._go_on("Put the plug back, and press Enter. ")
        return f"the motors stopped {lasted_s:.1f} s after this program had noticed, by the operator's eye"

    async def _switch(self) -> str:
        async with self._hold_armed():
            lasted_s = await self._time_stop("Use the remote control's kill switch NOW.")
        return f"the motors stopped within {lasted_s:.1f} s, by the operator's eye"

    # ---- what they are made of

    @asynccontextmanager
    async def _hold_armed(self) -> AsyncIterator[Hand]:
        """The vehicle armed and idling; disarmed afterwards, however that comes."""
        self._say("     Arming: THE MOTORS START.")
        hand = await self._open(self._config)
        try:
            try:
                news = await hand.until("armed", ARM_S)
            except TimeoutError:
                raise GuideStopped(f"not armed within {ARM_S:g} s") from None
            self.firmware = news.firmware
            yield hand
        finally:
            await to_the_end(self._disarm(hand))

    async def _disarm(self, hand: Hand) -> None:
        acknowledged = await hand.off()
        if not any(news.event == "arming" for news in hand.heard):
            return  # what somebody else may have armed is not ours to stop
        if acknowledged is not None:
            self._say("     Ordered off.")
            return
        why = ""
        for attempt in range(TRIES):
            if attempt:
                await asyncio.sleep(AGAIN_S)
            other = await self._open(self._config, "disarm")
            if await other.off() is not None:
                self._say("     Ordered off.")
                return
            why = "; ".join(news.text for news in other.heard if news.event == "failed") or why
        self._say(
            f"\nTHE VEHICLE MAY STILL BE ARMED: nobody acknowledged the order to disarm ({why or 'no answer'}). "
            "Stop it by the remote control, or by its battery plug, before you touch it."
        )

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
        """Wait for the event that the operator was asked for."""
        try:
            news = await hand.until(event, ACT_S)
        except TimeoutError:
            raise NotProven(otherwise) from None
        if any(one.event == "disarmed" and one.at_s < news.at_s - NEWS_S for one in hand.heard):
            raise _StepAgain
        return news

    async def _time_stop(self, says: str) -> float:
        """Measure the time until the motors stop, as the operator sees it [s]."""
        since_s = _now()
        try:
            async with asyncio.timeout(STOP_S):
                await self._ask(f"     {says} Press Enter as soon as the motors have stopped (within {STOP_S:g} s). ")
        except TimeoutError:
            raise NotProven(f"the motors still turned {STOP_S:g} s later: see `groundstation doctor`") from None
        lasted_s = _now() - since_s
        await self._yes("Did they stop by that, and are they off?")
        return lasted_s

    async def _yes(self, question: str) -> None:
        answer = await self._ask(f"     {question} [y/n] ")
        if answer.strip().lower() not in ("y", "yes"):
            raise NotProven(f"“{question}” was not answered with y")

    async def _go_on(self, what: str) -> None:
        await self._ask(f"     {what}")


def _now() -> float:
    return asyncio.get_running_loop().time()


OFF_S = 12.0
"""Longest wait for a hand to let go [s]: an order that nobody acknowledges is repeated for 5 s."""


class HandProcess:
    """Implements :class:`groundstation.lab.props_off.Hand`."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        assert process.stdin is not None and process.stdout is not None, "both are pipes"
        self._process = process
        self._in, self._out = process.stdin, process.stdout
        self.heard: list[News] = []

    async def until(self, event: str, within_s: float) -> News:
        """The news of ``event``; see there."""
        async with asyncio.timeout(within_s):
            while True:
                news = await self._next()
                if news is None:
                    raise GuideStopped("the program that holds the vehicle has ended by itself")
                if news.event == event:
                    return news
                if news.event == "failed":
                    raise GuideStopped(news.text)

    async def listen(self, for_s: float) -> None:
        """Hear for a while what is told."""
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
        """Let go; see there."""
        self._in.close()
        try:
            await self.listen(OFF_S)
            if self._process.returncode is None:
                async with asyncio.timeout(1.0):
                    await self._process.wait()
        except TimeoutError:
            await self.kill()
        return next((news for news in self.heard if news.event == "off"), None)

    async def kill(self) -> None:
        """End it at once, as the kernel does."""
        with suppress(ProcessLookupError):
            os.kill(self._process.pid, signal.SIGKILL)
        await self._process.wait()


async def open_hand(config: Config, *words: str) -> HandProcess:
    """Start a hand; with the word ``disarm`` one that disarms only."""
    process = await open_child("groundstation.lab.props_off_hand", *words, stdin=asyncio.subprocess.PIPE)
    hand = HandProcess(process)
    assert process.stdin is not None, "it is a pipe"
    process.stdin.write(msgspec.json.encode(dump(config)) + b"\n")
    await process.stdin.drain()
    return hand


SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)

BEFORE = """\
THE MOTORS OF {name} WILL START, several times. Its propellers must be OFF: take them off now.
Hold the vehicle down, keep fingers, hair and cables away, and have its battery plug and the remote control at hand.
Thrust is never more than idling. Ctrl-C at any time orders the motors off and ends the test.
"""


def props_off_command(config: Config, now_s: float) -> Exit:
    """The test of the vehicle of ``config``; ``now_s`` is the wall time at its beginning [s since 1970].

    Raises:
        ConfigError: nobody sits at a terminal, or what was proven can't be kept.
    """
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise ConfigError("props-off", "motors will turn: it needs somebody at a terminal, and can't be scripted")
    try:
        with (
            hold_lock(lock_path(socket_path(config.status, config.vehicle.name)), config.vehicle.name),
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
        _say(BEFORE.format(name=name))
        if (await line_from_terminal(f"Propellers off? Type the vehicle's name, {name}, to begin: ")).strip() != name:
            _say("Nothing was begun.")
            return Exit.FAILED
        steps = await guide.run()
    except NotProven as error:
        _say(f"\nNOT PROVEN: {error}. Do not fly before this test is passed.")
        return Exit.FAILED
    except GuideStopped as error:
        _say(f"\nThe test can't go on: {error}. Nothing was kept.")
        return Exit.FAILED
    except asyncio.CancelledError:
        _say("\nInterrupted. Nothing was kept.")
        return Exit.FAILED
    date = datetime.fromtimestamp(now_s + loop.time() - began_s, tz=UTC).isoformat(timespec="seconds")
    path = place(config)
    try:
        save(Proof(vehicle=name, digest=digest(config), firmware=guide.firmware, date=date, steps=steps), path)
    except OSError as error:
        raise ConfigError("props-off", f"passed, but {path} can't be written: {error.strerror}") from None
    _say(f"\nPassed. Kept in {path}, for this vehicle, configuration and firmware ({guide.firmware or 'not told'}).")
    return Exit.DONE


def _say(line: str) -> None:
    with contextlib.suppress(OSError):  # a terminal that is gone: its hang-up ends the test
        print(line, flush=True)
