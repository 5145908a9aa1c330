"""Hand of the propellers-off test: a process that holds one vehicle armed, its motors idling, until
told to let go.

Thrust never leaves that is more than idling: none at all over MAVLink, where arming alone turns the
motors and an ArduPilot in GUIDED takes off by any; ``flight.idle_thrust`` over a radio. However
this ends, the motors are ordered off first, by force. The process gets one line with the
configuration from standard input, and tells news on standard output. It is deaf to what a terminal
sends; the end of its input is the order to let go: so it disarms when its guide dies, too.
"""

import asyncio
import contextlib
import os
import signal
import sys
import tomllib
from collections.abc import Awaitable, Callable

import msgspec

from groundstation.config import from_dict
from groundstation.core.messages import Pose, PoseSource, SourceError, notice
from groundstation.core.pilot import Pilot
from groundstation.flight import make_ends
from groundstation.lab.props_off import Event, News
from groundstation.machine import precise_loop, to_the_end
from groundstation.pose.sources import GatedSource
from groundstation.settings import Config
from links.core import CommandLink, LinkError

Tell = Callable[[News], None]


def idle_n(config: Config) -> float:
    """The thrust that is sent [N]."""
    return 0.0 if config.link.has_autopilot else config.flight.idle_thrust * config.weight_n


async def hold(
    config: Config, link: CommandLink, source: PoseSource, ordered: Awaitable[object], tell: Tell
) -> None:
    """Arm, and hold it idling until ``ordered`` is done.

    Then, or where it can't go on, the motors are ordered off.
    """
    loop = asyncio.get_running_loop()
    begun = False

    def note(news: News) -> None:
        nonlocal begun
        begun = begun or news.event == "arming"
        tell(news)

    pilot = Pilot(config.vehicle, config.controller, config.flight.coast_s, config.flight.floor_z_m)
    source = GatedSource(source, config.gate, lost_s=config.flight.coast_s, say=lambda event: None)
    come = asyncio.Event()

    def take(pose: Pose) -> None:
        pilot.estimate_state(pose)
        come.set()

    async def let_go() -> None:
        await asyncio.gather(end, work, return_exceptions=True)
        await _off(link, source, tell, begun=begun)

    end = asyncio.ensure_future(ordered)
    work = asyncio.ensure_future(_hold_armed(config, link, source, pilot, take, come, note))
    try:
        await asyncio.wait({end, work}, return_when=asyncio.FIRST_COMPLETED)
        if work.done():
            work.result()
    except (LinkError, SourceError, TimeoutError) as error:
        no_pose = notice("props.no_pose", limit_s=config.flight.pose_wait_s)
        tell(News("failed", loop.time(), str(error) or no_pose.text))
    finally:
        for task in (end, work):
            task.cancel()
        await to_the_end(let_go())


async def disarm(link: CommandLink, source: PoseSource, tell: Tell) -> None:
    """Order the motors off, whatever somebody before has left; that one is gone."""
    try:
        await link.connect()
    except LinkError as error:
        tell(News("failed", asyncio.get_running_loop().time(), str(error)))
    finally:
        await to_the_end(_off(link, source, tell, begun=True))


async def _hold_armed(
    config: Config,
    link: CommandLink,
    source: PoseSource,
    pilot: Pilot,
    take: Callable[[Pose], None],
    come: asyncio.Event,
    tell: Tell,
) -> None:
    loop, thrust_n = asyncio.get_running_loop(), idle_n(config)
    pilot.set_on_floor()
    await source.start(take)
    await link.connect()
    async with asyncio.timeout(config.flight.pose_wait_s):
        await come.wait()
    await link.examine()
    if link.status.unfit:
        raise LinkError(link.status.unfit)
    if link.status.state == "armed":
        raise LinkError(notice("props.armed_already"))
    tell(News("arming", loop.time()))
    await link.arm(lambda: pilot.idle(loop.time(), thrust_n))
    tell(News("armed", loop.time(), firmware=link.status.firmware))
    told: set[Event] = set()
    # Also after the link has fallen silent: poses that come back must not start the motors again.
    while True:
        now = loop.time()
        link.send(pilot.idle(now, thrust_n))
        for event in _find_events(config, link):
            if event not in told:
                told.add(event)
                newest = pilot.state.newest_pose
                tell(News(event, now, link.status.text, None if newest is None else newest.time_s))
        await asyncio.sleep(link.period_s)


def _find_events(config: Config, link: CommandLink) -> list[Event]:
    status = link.status
    holds: dict[Event, bool] = {
        "lost": status.state == "lost",
        "disarmed": config.link.has_autopilot and status.state == "connected",  # no radio tells
        "silent": status.phase == "over",
    }
    return [event for event, is_so in holds.items() if is_so]


async def _off(link: CommandLink, source: PoseSource, tell: Tell, *, begun: bool) -> None:
    """Order the motors off where we may have started them (``begun``), and close both ends."""
    loop = asyncio.get_running_loop()
    was = link.status.state
    try:
        if begun and was not in ("closed", "connecting"):
            await link.kill()
            tell(News("off", loop.time(), was))
    except LinkError as error:
        tell(News("failed", loop.time(), str(error)))
    finally:
        await link.close()
        await source.close()


def main() -> None:
    """Hold it armed, or with the argument ``disarm`` disarm it."""
    for number in (
        signal.SIGINT,
        signal.SIGHUP,
        signal.SIGTERM,
        signal.SIGQUIT,
        signal.SIGTSTP,
        signal.SIGPIPE,
    ):
        signal.signal(number, signal.SIG_IGN)
    text = msgspec.json.decode(sys.stdin.buffer.readline(), type=str)
    config = from_dict(tomllib.loads(text), Config)
    with asyncio.Runner(loop_factory=precise_loop) as runner:
        runner.run(_work(config, sys.argv[1:]))


async def _work(config: Config, words: list[str]) -> None:
    link, source = make_ends(config)
    if words == ["disarm"]:
        await disarm(link, source, _tell)
        return
    loop = asyncio.get_running_loop()
    ordered: asyncio.Future[None] = loop.create_future()

    def end() -> None:
        loop.remove_reader(0)
        ordered.set_result(None)

    loop.add_reader(0, end)
    await hold(config, link, source, ordered, _tell)


def _tell(news: News) -> None:
    with contextlib.suppress(OSError):  # nobody guides any more: that it disarms is what counts
        os.write(1, msgspec.json.encode(news) + b"\n")


if __name__ == "__main__":
    main()
