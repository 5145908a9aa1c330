"""Fleet supervisor: runs the cores of a fleet, one process each, and their relay of poses.

It prints what they say, and passes signals on. Nothing is shared: a core that crashes or stands
still takes no other with it. None is ever started again: who knows where its vehicle is. Cores have
sessions of their own: a terminal's Ctrl-C reaches each of them once, from here. Vehicles are armed
once every core stands ready: a program that still starts would disturb who flies.
"""

import argparse
import asyncio
import os
import shlex
import signal
import sys
import tempfile
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

from groundstation.config import ConfigError, dump, refuse_value
from groundstation.core.messages import Ask, Request, SourceError, notice
from groundstation.core.mission import State
from groundstation.flight import ensure_held
from groundstation.flight.preflight import ensure_flyable, ensure_guarded, ensure_link
from groundstation.interfaces.api import END_S, ask_station, snapshots
from groundstation.interfaces.mqtt import ensure_mqtt
from groundstation.lab import FleetPlan, Member, Relay, read_fleet, run_relay
from groundstation.machine import (
    FLEET,
    ApiError,
    Running,
    explain_stop,
    registration,
    socket_path,
    write_whole,
)
from groundstation.runtime import Exit
from groundstation.settings import REHEARSAL, Config, describe_rehearsal, ensure_served
from links.core import REOPEN_S
from links.io import describe_exit, open_child


async def until_ready(socket: Path) -> None:
    """Wait until the core that serves ``socket`` has passed its checks and waits to be armed."""
    while True:
        with suppress(OSError, ApiError):
            async for snapshot in snapshots(socket):
                if snapshot.state == State.READY:
                    return
        await asyncio.sleep(REOPEN_S)


async def arm_vehicle(name: str, socket: Path) -> str:
    """Ask for the motors of ``name``; returns why that was refused, or nothing."""
    try:
        answer = await ask_station(Request(Ask.ARM, "groundstation fleet --arm"), name, socket)
    except (ApiError, OSError) as error:
        return str(error)
    return "" if answer.done else answer.says


async def tell_end(why: Request, name: str, socket: Path) -> None:
    """Ask the core of ``name`` to end, as soon as it can be asked: it may only start yet."""
    while True:
        with suppress(OSError, ApiError):
            await ask_station(why, name, socket)
            return
        await asyncio.sleep(REOPEN_S)


SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGQUIT, signal.SIGHUP)
"""Passed on to every core, which knows what each means: land, failsafe descent, motors off."""
READY_S = 120.0
"""Timeout for the relay to begin, and then for all cores to be ready to be armed [s]."""


class Supervisor:
    """One fleet in the air."""

    def __init__(self, fleet: FleetPlan, arm: Collection[str], say: Callable[[str], None]) -> None:
        """``say`` takes lines for the operator.

        ``arm`` names the vehicles that are armed without asking, for one flight; the others are
        served until a signal comes.
        """
        self._fleet = fleet
        self._arm = arm
        self._say = say
        self._width = max(len(member.name) for member in fleet.members)
        self.cores: dict[str, asyncio.subprocess.Process] = {}
        """The processes, by the vehicle's name."""
        self.relay: asyncio.subprocess.Process | None = None
        """The process that hands poses on, where there is one."""
        self._sent: set[signal.Signals] = set()
        self._starting = ExitStack()
        """Entry in the register until all are armed: `stop-all` ends a fleet that only starts."""

    async def run(self) -> Exit:
        """Run all until each has ended; 0 where every flight went as it was meant to, else 1.

        Raises:
            ApiError: the folder of sockets is not ours alone.
        """
        loop = asyncio.get_running_loop()
        if self._arm:
            fleet = f"fleet of {', '.join(member.name for member in self._fleet.members)}"
            entry = Running(pid=os.getpid(), command=FLEET, vehicle=fleet)
            self._starting.enter_context(registration(entry))
            if stopped := explain_stop():
                self._starting.close()
                self._say(stopped.text)
                return Exit.FAILED
        # The relay lives for as long as anybody holds the other end of this pipe: we, or a core
        # that outlives us.
        relay_lives, held = os.pipe()
        with tempfile.TemporaryDirectory(prefix="groundstation-fleet-") as folder:
            try:
                relaying = await self._start_relay(relay_lives)
                if relaying is None:
                    return Exit.FAILED
                for member in self._fleet.members:
                    self.cores[member.name] = await self._start_core(member, Path(folder), held)
                for number in SIGNALS:
                    loop.add_signal_handler(number, self._pass_on, number)
                watching = {name: asyncio.ensure_future(self._watch(name)) for name in self.cores}
                arming = asyncio.ensure_future(self._arm_all(watching))
                codes = await asyncio.gather(*watching.values())
                arming.cancel()
            finally:
                self._starting.close()
                os.close(held)
                os.close(relay_lives)
                for number in SIGNALS:
                    loop.remove_signal_handler(number)
            await relaying
        return Exit.DONE if not any(codes) else Exit.FAILED

    async def _start_relay(self, lives: int) -> "asyncio.Future[None] | None":
        """Begin to hand poses on; returns its life, or None where it can't."""
        fleet, done = self._fleet, asyncio.get_running_loop().create_future()
        if fleet.relay_listen is None:
            done.set_result(None)
            return done
        words = _relay_words(fleet.relay_listen, fleet.relay_targets)
        self.relay = relay = await _python([*words, "--until-eof"], stdin=lives)
        assert relay.stdout is not None, "it is a pipe"
        with suppress(TimeoutError):
            async with asyncio.timeout(READY_S):
                line = await relay.stdout.readline()
                self._tell("relay", line)
                if line.startswith(b"relaying"):
                    return asyncio.ensure_future(self._watch_relay(relay))
        with suppress(ProcessLookupError):
            relay.kill()
        self._say(str(notice("fleet.no_relay")))
        return None

    async def _watch_relay(self, relay: asyncio.subprocess.Process) -> None:
        code = await self._listen("relay", relay)
        if any(core.returncode is None for core in self.cores.values()):
            self._say(str(notice("fleet.relay_ended", how=describe_exit(code))))

    async def _start_core(
        self, member: Member, folder: Path, held: int
    ) -> asyncio.subprocess.Process:
        file = folder / f"{member.name}.toml"
        write_whole(file, dump(member.core))  # what was checked is what flies
        once = ["--once"] if member.name in self._arm else []
        words = [
            "groundstation.interfaces.service.fleet_core",
            str(os.getpid()),
            "daemon",
            str(file),
            *once,
        ]
        return await _python(words, keeps=(held,))

    async def _arm_all(self, watching: Mapping[str, "asyncio.Future[int]"]) -> None:
        """Once every core is ready, arm those that were named.

        Where one does not get there, end the flights.
        """
        sockets = {one.name: socket_path(one.core.status, one.name) for one in self._fleet.members}
        ready = {
            name: asyncio.ensure_future(until_ready(socket)) for name, socket in sockets.items()
        }
        all_ready = asyncio.ensure_future(asyncio.wait(ready.values()))
        ends: set[asyncio.Future[Any]] = {all_ready, *watching.values()}
        try:
            await asyncio.wait(ends, timeout=READY_S, return_when=asyncio.FIRST_COMPLETED)
            ended = [name for name, core in watching.items() if core.done()]
            late = ended or [name for name, task in ready.items() if not task.done()]
        finally:
            for task in (all_ready, *ready.values()):
                task.cancel()
        if late:
            if self._arm:
                told = notice("fleet.nobody_armed", names=", ".join(late))
                self._say(str(told))
                why = Request(Ask.LAND, told.text)
                await asyncio.gather(
                    *(self._end_core(why, name, sockets[name], watching[name]) for name in sockets)
                )
                self._send(signal.SIGTERM)
            return
        for name in self._arm:
            refused = await arm_vehicle(name, sockets[name])
            if refused:
                self._say(str(notice("fleet.not_armed", name=name, why=refused)))
        self._starting.close()

    async def _end_core(
        self, why: Request, name: str, socket: Path, watched: "asyncio.Future[int]"
    ) -> None:
        """Ask one core to end, so that its flight tells ``why``, unless it has ended.

        A signal follows where it does not.
        """
        asked = asyncio.ensure_future(tell_end(why, name, socket))
        await asyncio.wait((asked, watched), timeout=END_S, return_when=asyncio.FIRST_COMPLETED)
        asked.cancel()

    async def _watch(self, name: str) -> int:
        code = await self._listen(name, self.cores[name])
        if -code in self._sent:  # in flight it handles every signal that we send
            self._say(str(notice("fleet.core_early", name=name)))
            return Exit.DONE
        if code < 0:
            self._say(str(notice("fleet.core_died", name=name, how=describe_exit(code))))
        else:
            self._say(str(notice("fleet.core_ended", name=name, code=code)))
        return code

    async def _listen(self, name: str, process: asyncio.subprocess.Process) -> int:
        """Print what ``process`` says until it has ended; returns its exit code."""
        assert process.stdout is not None, "it is a pipe"
        while True:
            try:
                line = await process.stdout.readline()
            except (
                ValueError
            ):  # longer than any line of ours, 64 KiB: the reader has thrown it away
                continue
            if not line:
                return await process.wait()
            self._tell(name, line)

    def _tell(self, name: str, line: bytes) -> None:
        text = line.decode(errors="replace").rstrip("\n")
        if text:
            self._say(f"{name:{self._width}} | {text}")

    def _pass_on(self, number: signal.Signals) -> None:
        # The same to a core; but while it starts, SIGTERM ends it in silence, and SIGINT with
        # Python's own traceback.
        told = self._send(signal.SIGTERM if number is signal.SIGINT else number)
        names = ", ".join(told) or "nobody: all have ended"
        self._say(str(notice("fleet.passed_on", signal=number.name, names=names)))

    def _send(self, number: signal.Signals) -> list[str]:
        """Send ``number`` to every core that lives; the names of their vehicles."""
        told = []
        self._sent.add(number)
        for name, core in self.cores.items():
            with suppress(ProcessLookupError):
                if core.returncode is None:
                    core.send_signal(number)
                    told.append(name)
        return told


async def _python(
    words: list[str], *, stdin: int = asyncio.subprocess.DEVNULL, keeps: Collection[int] = ()
) -> asyncio.subprocess.Process:
    """One of our own programs in a session of its own, which keeps the open files ``keeps``."""
    environment = dict(os.environ)
    environment.pop("NOTIFY_SOCKET", None)  # a service manager is told by us, not by each core
    return await open_child(
        *words,
        stdin=stdin,
        stderr=asyncio.subprocess.STDOUT,
        pass_fds=tuple(keeps),
        env=environment,
    )


def _relay_words(listen: str, targets: Iterable[str]) -> list[str]:
    """The command line of a relay."""
    return [
        "groundstation",
        "fleet",
        "relay",
        listen,
        *(word for target in targets for word in ("--to", target)),
    ]


def describe_core(fleet: FleetPlan, member: Member) -> str:
    """The configuration of one core as TOML, with the relay's command line where it needs one."""
    lines = [f"# {member.name} alone: groundstation fly THIS_FILE"]
    if fleet.relay_listen is not None:
        lines.append(
            "# Its poses come from: "
            f"{shlex.join(_relay_words(fleet.relay_listen, fleet.relay_targets))}"
        )
    return "\n".join([*lines, "", dump(member.core)])


def fleet_command(args: argparse.Namespace, say: Callable[[str], None]) -> Exit:
    """Fly the vehicles of a fleet file; or show the configuration of one.

    Raises:
        ConfigError: one of them must not fly.
    """
    found = read_fleet(args.fleet, args.overrides)
    if args.rehearse:
        found = _rehearse(found, args)
    names = [member.name for member in found.members]
    if args.rehearse and args.arm == [REHEARSAL]:
        args.arm = names
    for option, asked in (("--arm", args.arm), ("--show", [args.show] if args.show else [])):
        for name in asked:
            if name not in names:
                raise ConfigError(option, notice("value.choice", choices=names, found=name))
    if args.arm and "NOTIFY_SOCKET" in os.environ:
        raise ConfigError("--arm", notice("arm.service", vehicle=args.arm[0]))
    if args.show:
        print(describe_core(found, found.members[names.index(args.show)]))
        return Exit.DONE
    _require_flyable(found, args.fleet)
    with refuse_value("XDG_RUNTIME_DIR", ApiError):
        return asyncio.run(Supervisor(found, list(dict.fromkeys(args.arm)), say).run())


def require_flyable(config: Config) -> Config:
    """``config``, which must have all that a flight needs.

    Raises:
        ConfigError: the vehicle can't fly this, the poses are recorded, a real vehicle has no fence
            or no speed limit, or a key can't be used.
    """
    if config.pose.never_flies is not None:
        raise ConfigError(*config.pose.never_flies)
    ensure_guarded(config)
    ensure_link(config)
    ensure_mqtt(config.mqtt)
    ensure_held(config.operator)
    ensure_flyable(config)
    return config


def _require_flyable(fleet: FleetPlan, file: Path) -> None:
    for member in fleet.members:
        try:
            require_flyable(member.lab)
        except ConfigError as error:
            raise ConfigError(error.key, error.problem, f"{file}: vehicle {member.name}") from None


def _rehearse(fleet: FleetPlan, args: argparse.Namespace) -> FleetPlan:
    """Move the fleet to the loopback network, once it may fly in earnest."""
    _require_flyable(fleet, args.fleet)
    turned = read_fleet(args.fleet, args.overrides, rehearsed=True)
    rooms = [member.lab.rehearsal for member in turned.members if member.lab.rehearsal is not None]
    for room in rooms:
        print(describe_rehearsal(room), file=sys.stderr, flush=True)
    if not args.show:
        ensure_served(rooms[0], args.fleet)
    return turned


def relay_command(args: argparse.Namespace, say: Callable[[str], None]) -> Exit:
    """Hand datagrams on until told to end.

    Raises:
        ConfigError: an address is none.
    """
    with refuse_value("relay"):
        made = Relay(args.listen, args.to, group=args.group or "", interface=args.interface or "")
    try:
        asyncio.run(run_relay(made, say, until_eof=args.until_eof))
    except SourceError as error:
        print(f"groundstation: {error}", file=sys.stderr)
        return Exit.FAILED
    return Exit.DONE
