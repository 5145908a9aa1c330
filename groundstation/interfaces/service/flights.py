"""Flights in real time: one in a terminal, or as a daemon one after the other, armed by name.

Signals are requests: the first Ctrl-C or SIGTERM lands, more of them do more, SIGQUIT kills. A
flight has a crew, who watch it and ask of it: clients of the socket, and MQTT. It ends with none of
them. systemd knows a daemon by its unit (docs/how-to/install.md) and hears of it by sd_notify(3),
here without its library.

A daemon is monitored by log lines, and by whoever attaches to its socket.
"""

import asyncio
import gc
import json
import logging
import os
import re
import shlex
import signal
import socket
import sys
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Iterable, Mapping
from contextlib import asynccontextmanager, suppress
from functools import partial
from pathlib import Path
from string import Template
from typing import Any, Protocol

import msgspec

from groundstation.config import ConfigError, describe_pattern, dump
from groundstation.core.messages import (
    Ask,
    FlightEvent,
    Notice,
    Reply,
    Request,
    Say,
    Sentence,
    Severity,
    Snapshot,
    SourceError,
    notice,
    tell_lines,
)
from groundstation.core.mission import FINAL, IN_AIR, ON_GROUND, Interrupts, State
from groundstation.core.safety import CERTAIN_S
from groundstation.flight import (
    Flight,
    FlightOutcome,
    StepTimer,
    make_ends,
    make_flight,
    recorder,
)
from groundstation.flight.preflight import confirm_arming, entry_of, examine_trajectory
from groundstation.interfaces.api import ANSWER_S, Core, Server, open_client
from groundstation.machine import (
    ApiError,
    IdleSlots,
    Latest,
    NonBlockingWriter,
    Taken,
    explain_stop,
    find_socket,
    hold_lock,
    precise_loop,
    registration,
    running_processes,
    socket_path,
    wait_at_most,
)
from groundstation.recording import END_S
from groundstation.runtime import Exit, __version__
from groundstation.settings import Config
from links.core import DISARM_S, LinkError
from links.io import make_child_command


def health_command(vehicle: str | None, socket: Path | None, *, as_json: bool) -> Exit:
    """Print how a flight or daemon is.

    0 where it is well, 1 where it is not, 2 where there is none.
    """
    try:
        wrong, facts = asyncio.run(_look(vehicle, socket))
    except ApiError as error:
        print(f"groundstation: health: {error}", file=sys.stderr)
        return Exit.NOBODY
    if as_json:
        print(json.dumps({"well": not wrong, "why": wrong, **facts}))
    else:
        print(f"{wrong or 'well'}{''.join(f'; {key} {value}' for key, value in facts.items())}")
    return Exit.FAILED if wrong else Exit.DONE


async def _look(vehicle: str | None, socket: Path | None) -> tuple[str, dict[str, Any]]:
    """Return the fault of whoever flies ``vehicle``, or serves at ``socket``, empty for none, and
    what is flown.

    Raises:
        ApiError: nobody does.
    """
    path = socket or await find_socket(vehicle)
    try:
        async with open_client(path, "health") as client, asyncio.timeout(ANSWER_S):
            async for seen in client:
                if isinstance(seen, Snapshot):
                    facts = {"vehicle": seen.vehicle, "state": seen.state, "reason": seen.reason}
                    lost = seen.state in IN_AIR and seen.link.state == "lost"
                    return "the link is lost" if lost else "", {**facts, "pid": client.hello.pid}
    except (TimeoutError, ApiError) as error:
        return str(error) or f"{path}: no snapshot within {ANSWER_S:g} s", {}
    except OSError as error:
        raise ApiError(notice("station.unserved", path=path, why=error.strerror)) from None
    return f"{path}: it has just ended", {}


class LogHandler(logging.Handler):
    """Writes to a file descriptor only what it takes at once."""

    def __init__(self, number: int, *, as_json: bool, journal: bool) -> None:
        """``journal``: begin each line with its priority, ``<6>``, as sd-daemon(3) has it."""
        super().__init__()
        self._line = partial(line_of, as_json=as_json, journal=journal)
        self._writer = NonBlockingWriter(
            number, lambda count: self._line(logging.WARNING, notice("log.lost", count=count).text)
        )

    def emit(self, record: logging.LogRecord) -> None:
        """Write one line, or count it as lost."""
        try:
            event = getattr(record, "event", None)
            self._writer.say(self._line(record.levelno, record.getMessage(), event))
        except Exception:  # noqa: BLE001  # a log must not end a flight
            self._writer.lost += 1


def line_of(
    level: int,
    message: str,
    event: Notice | Sentence | None = None,
    *,
    as_json: bool,
    journal: bool,
) -> str:
    """One line: ``level`` is logging's, ``event`` what it tells of, which JSON has as the status
    socket sends it.
    """
    message = " ".join(message.split("\n"))
    prefix = f"<{_PRIORITY.get(level, 6)}>" if journal else ""
    name = logging.getLevelName(level)
    if not as_json:
        return prefix + (message if journal else f"{name} {message}")
    told = {} if event is None else {"event": msgspec.to_builtins(event)}
    return prefix + json.dumps({"level": name.lower(), "msg": message, **told}, ensure_ascii=False)


_PRIORITY = {
    logging.DEBUG: 7,
    logging.INFO: 6,
    logging.WARNING: 4,
    logging.ERROR: 3,
    logging.CRITICAL: 2,
}


def is_journal(number: int) -> bool:
    """Whether what is written to ``number`` goes to the journal (systemd.exec(5),
    ``$JOURNAL_STREAM``).
    """
    info = os.fstat(number)
    return os.environ.get("JOURNAL_STREAM", "") == f"{info.st_dev}:{info.st_ino}"


def _log(told: Notice | Sentence, /) -> None:
    level = logging.WARNING if told.severity is Severity.WARNING else logging.INFO
    text = told.line if isinstance(told, Notice) else told.text
    said = text.removeprefix("WARNING: ")  # the line of a log has its level before it
    logging.getLogger("groundstation").log(level, "%s", said, extra={"event": told})


SPARE_S = 40.0
"""To come to rest before the landing, and for the link's bring-down should it fail [s]; chosen."""


def longest_landing_s(config: Config) -> float:
    """Return the longest time from SIGTERM to the process's end for this configuration [s].

    From the top of the fence, or else the highest point flown to, at the landing's speeds.
    """
    floor = config.flight.floor_z_m
    top = max(floor - examine_trajectory(config).lowest_ned[2], config.takeoff.height_m)
    if config.fence is not None:
        top = max(top, config.fence.height_m)
    landing = config.landing
    slow = min(landing.touchdown_m_s, config.flight.descent_m_s)
    sinking_s = top / config.flight.descent_m_s + landing.approach_m / slow
    return sinking_s + CERTAIN_S + DISARM_S + END_S + SPARE_S


USER = r"\A[A-Za-z0-9_][A-Za-z0-9_.@-]*\Z"
"""Name or number of a user of the system, or of a domain. systemd also takes ``a b`` and ``"root"``
as names, and expands ``%``."""
UNIT_ESCAPES = (("\\", "\\\\"), ("\n", "\\n"), ("%", "%%"))
"""Characters that systemd reads in another way than a shell within quotes (systemd.service(5),
"Command lines"), and how they are written."""
ARGUMENT_ESCAPES = (*UNIT_ESCAPES, ("$", "$$"))
"""Characters of arguments: systemd expands variables in all words but the program's path."""


def unit_file(config: Config, path: Path, overrides: list[str], *, user: str) -> str:
    """The unit file's text.

    ``path`` is the configuration's, ``overrides`` as on the command line.

    Raises:
        ConfigError: ``user`` is no user's name.
    """
    if re.search(USER, user) is None:
        form = f"a user's name matching {describe_pattern(USER)}"
        raise ConfigError("--user", notice("value.form", form=form, found=user))
    sets = [word for override in overrides for word in ("--set", override)]
    program, *arguments = _program()
    arguments += ["daemon", str(path.resolve()), *sets]
    words = (_quote(word, ARGUMENT_ESCAPES) for word in arguments)
    landing_s = longest_landing_s(config)
    text = Template((Path(__file__).parent / "groundstation.service").read_text("utf-8"))
    return text.substitute(
        vehicle=config.vehicle.name,
        command=" ".join((_quote(program, UNIT_ESCAPES), *words)),
        user=user,
        stop_s=f"{landing_s:.0f}",
        landing_s=f"{landing_s:.0f}",
    )


def _quote(word: str, escapes: Iterable[tuple[str, str]]) -> str:
    """``word`` of a command line as systemd reads it."""
    quoted = shlex.quote(word)
    for letter, escaped in escapes:
        quoted = quoted.replace(letter, escaped)
    return quoted


def _program() -> list[str]:
    """This very installation, not whatever a path leads to."""
    script = Path(sys.executable).with_name("groundstation")
    return [str(script)] if script.exists() else make_child_command("groundstation")


WATCHDOG_SHARE = 1.0 / 3.0
"""The watchdog is fed so often, as a share of the time after which it bites."""


class Notify:
    """Datagrams to ``$NOTIFY_SOCKET``, if there is one.

    Never raises, nor waits: a manager that is gone is no fault.
    """

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        """Read where to, and how often the watchdog wants to be fed."""
        address = environment.get("NOTIFY_SOCKET", "")
        # @: an abstract name.
        self._address = "\0" + address[1:] if address.startswith("@") else address
        usec = environment.get("WATCHDOG_USEC", "")
        ours = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        self.feed_s = (
            float(usec) / 1e6 * WATCHDOG_SHARE
            if usec.isdigit() and ours and int(usec) > 0
            else None
        )
        """Period of feeding the watchdog [s]; None for never."""

    def send(self, text: str) -> None:
        """Send a line of sd_notify(3), such as READY=1 once all that is needed is open."""
        if self._address[:1] in ("/", "\0"):
            wire = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)  # noqa: TID251  # no daemon is simulated
            with wire, suppress(OSError):
                wire.sendto(text.replace("\n", " ").encode(), socket.MSG_DONTWAIT, self._address)


class WatchedCore(Core, Protocol):
    """Flight or daemon that clients watch and command."""

    def snapshot(self) -> Snapshot:
        """As it is now."""


@asynccontextmanager
async def crew(
    config: Config,
    core: WatchedCore,
    say: Say,
    quiet: IdleSlots | None = None,
    *,
    needed: bool = False,
) -> AsyncIterator[Server]:
    """Run the clients' socket and MQTT beside ``core``. Failures are reported and left behind.

    Snapshots are made, and sent to clients, when it is ``quiet``.

    Raises:
        ApiError: the socket can't be served, where it is ``needed``.
    """
    latest: Latest[Snapshot] = Latest()
    quiet = quiet or IdleSlots()
    server = Server(
        config.status,
        config.vehicle.name,
        latest,
        core,
        quiet=quiet,
        pid=os.getpid(),
        version=__version__,
        config_text=dump(config),
        log=say,
    )
    await (server.open() if needed else _isolate("status socket", server.open(), say))
    work = {"status socket": server.publish(), "snapshots": _publish(core, latest, quiet)}
    if config.mqtt.enabled:
        from groundstation.interfaces.mqtt import publish_forever

        work["MQTT"] = publish_forever(config.mqtt, latest, server.desk.from_afar)
    tasks = [asyncio.create_task(_isolate(what, one, say)) for what, one in work.items()]
    try:
        try:
            yield server
        finally:
            latest.put(core.snapshot())
            await asyncio.sleep(0.1)  # the last word reaches whoever watches
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        server.close()


async def _publish(core: WatchedCore, latest: Latest[Snapshot], quiet: IdleSlots) -> None:
    while True:
        latest.put(core.snapshot())
        await asyncio.sleep(0.1)
        await quiet.moment()


async def _isolate(what: str, work: Awaitable[None], say: Say) -> None:
    """A screen or a broker must not end a flight: say what failed and go on without it."""
    try:
        await work
    except Exception as error:  # noqa: BLE001  # whatever it is, the flight goes on
        say(notice("service.stopped", what=what, why=error))


PAUSE_S = 5.0
"""Pause between a flight's end and the next one's beginning, also where it could not begin [s]."""
RENEW_S = 3600.0
"""A flight not armed for this long begins anew with a new recording [s]: poses at rest would fill
the disk."""


class Daemon:
    """Flies when it is told to, until it is stopped."""

    def __init__(
        self, config: Config, notify: Notify, *, arm: bool = False, once: bool = False
    ) -> None:
        """``arm``: the first flight arms without being asked.

        ``once``: end with the first flight.
        """
        self._config = config
        self._notify = notify
        self._arm = arm
        self._once = once
        self._quiet = IdleSlots()
        self._armed = 0
        self._stop = asyncio.Event()
        self._server: Server | None = None
        self._flight = self._make_flight(None)

    # ---- what may be asked of it, as of a flight

    def ask(self, request: Request) -> Reply:
        """Ask the flight that is, or was last."""
        return self._flight.ask(request)

    def set_gain(self, key: str, value: float) -> Reply:
        """Ask the flight."""
        return self._flight.set_gain(key, value)

    def say(self, sentence: Sentence) -> None:
        """Tell the flight's events."""
        self._flight.say(sentence)

    def snapshot(self) -> Snapshot:
        """The flight as it is now, or as it ended."""
        return self._flight.snapshot()

    def stop(self) -> None:
        """No flight after this one. Whoever asks the flight to land does that beside it."""
        self._stop.set()
        self._notify.send("STOPPING=1")  # landing first, where it flies

    # ---- its life

    async def run(self) -> Exit:
        """Serve clients, and fly, until :meth:`stop`, or with ``once`` to the first flight's end.

        Raises:
            ApiError: the socket can't be served.
            SourceError, LinkError, OSError: the first flight can't begin.
        """
        async with crew(self._config, self, _log, self._quiet, needed=True) as server:
            self._server = server
            feeding = asyncio.ensure_future(self._feed_watchdog())
            try:
                return await self._flights()
            finally:
                feeding.cancel()

    async def _flights(self) -> Exit:
        first = True
        self._notify.send("READY=1")
        while not self._stop.is_set():
            before = self._armed
            try:
                outcome = await self._fly()
            except (SourceError, LinkError, OSError) as error:
                if self._once or first:
                    raise
                outcome = FlightOutcome(State.ABORTED, str(error), str(error))
                _log(notice("service.no_flight", why=error).as_warning())
            first = False
            flew = self._armed > before
            if self._once or (flew and self._stop.is_set()):
                return (
                    Exit.DONE
                    if outcome.state is State.LANDED and not outcome.fault
                    else Exit.FAILED
                )
            next_flight = notice("service.next", state=self._flight.state, pause_s=PAUSE_S)
            self._notify.send(f"STATUS={next_flight}")
            await wait_at_most(self._stop.wait(), PAUSE_S)
        return Exit.DONE

    async def _fly(self) -> FlightOutcome:
        """One flight from connecting to its end, recorded.

        Of one that was never armed no recording is kept.
        """
        before = self._armed

        def keep() -> bool:
            return self._armed > before or self._once

        def describe_tracking_error() -> Sentence | None:
            return self._flight.describe_tracking_error() if self._armed > before else None

        async with recorder(
            self._config, _log, self._quiet, keep, describe_tracking_error=describe_tracking_error
        ) as give:
            self._flight = self._make_flight(give)
            renewing = asyncio.ensure_future(self._renew(self._flight))
            try:
                return await self._flight.run()
            finally:
                renewing.cancel()

    def _make_flight(self, give: Callable[..., None] | None) -> Flight:
        return make_flight(
            self._config,
            confirm=self._confirm,
            subscribers=(self._hear,),
            give=give,
            quiet=self._quiet,
            running=running_processes,
        )

    async def _confirm(self) -> bool:
        """Arm by itself only where the operator has said so on the command line, and only once."""
        name = self._config.vehicle.name
        if not self._arm:
            _log(notice("service.waits", vehicle=name))
            await asyncio.Event().wait()
        return await confirm_arming(self._config, name)

    def _hear(self, event: FlightEvent) -> None:
        if not isinstance(event, Notice):
            return
        _log(event)
        if event.kind == "state":
            self._armed += event.state == State.ARMING
            if event.state == State.ARMING or event.state in FINAL:
                self._arm = False
            self._notify.send(f"STATUS={event.says}")

    async def _renew(self, flight: Flight) -> None:
        """End a flight that nobody has armed for long, unless somebody is about to."""
        if not self._config.recording.enabled or self._arm:
            return
        while True:
            await asyncio.sleep(RENEW_S)
            held = self._server is not None and self._server.desk.is_held
            if flight.state in ON_GROUND and flight.state is not State.ARMING and not held:
                flight.ask(Request(Ask.LAND, notice("service.renews").text))

    async def _feed_watchdog(self) -> None:
        """Feed it from the loop that flies: a loop that hangs does not."""
        while self._notify.feed_s is not None:
            self._notify.send("WATCHDOG=1")
            await asyncio.sleep(self._notify.feed_s)


def obey(
    ask: Callable[[Request], Reply],
    say: Say,
    timer: StepTimer,
    on_stop: Callable[[], None] = lambda: None,
) -> None:
    """Have ``ask`` do what signals mean from now on.

    ``timer`` has SIGALRM, ``on_stop`` hears of each.
    """
    loop = asyncio.get_running_loop()
    interrupts = Interrupts()

    def press(name: str) -> None:
        on_stop()
        request, words = interrupts.press(name, loop.time())
        if request is not None:
            ask(request)
        say(words)

    def order(request: Request, words: Sentence | None = None) -> None:
        on_stop()
        ask(request)
        if words is not None:
            say(words)

    loop.add_signal_handler(signal.SIGINT, press, "SIGINT")
    loop.add_signal_handler(signal.SIGTERM, press, "SIGTERM")
    kill = Request(Ask.KILL, "told by SIGQUIT")
    loop.add_signal_handler(signal.SIGQUIT, order, kill, notice("key.kill", key="SIGQUIT"))
    # A terminal that closes is no second opinion: it lands, and never more than that.
    loop.add_signal_handler(signal.SIGHUP, order, Request(Ask.LAND, "the terminal closed"))
    land = {  # by default they end the program at once
        number: partial(
            order, Request(Ask.LAND, f"told by {number.name}"), notice("key.lands", key=number.name)
        )
        for number in (signal.SIGUSR1, signal.SIGUSR2, signal.SIGALRM)
    }
    for number in (signal.SIGUSR1, signal.SIGUSR2):
        loop.add_signal_handler(number, land[number])
    timer.on_alarm = partial(loop.call_soon_threadsafe, land[signal.SIGALRM])
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGQUIT):
        timer.interrupt_by(number)  # the loop hears of it as before, by its descriptor
    loop.add_signal_handler(signal.SIGTSTP, say, notice("key.no_pause"))
    # One in the background would be stopped as it prints.
    signal.signal(signal.SIGTTOU, signal.SIG_IGN)


def fly_command(
    config: Config, confirm: Callable[[], Awaitable[bool]], write: Callable[[str], None]
) -> Exit:
    """One flight, with the lock of its vehicle held."""
    try:
        with hold_lock(socket_path(config.status, config.vehicle.name), config.vehicle.name):
            logging.getLogger().addHandler(LogHandler(2, as_json=False, journal=False))
            with registration(entry_of(config, "fly", os.getpid())):
                if stopped := explain_stop():
                    write(stopped.text)
                    return Exit.FAILED
                return _run_precisely(_fly(config, confirm, write))
    except Taken as error:
        print(f"groundstation: {error}", file=sys.stderr)
        return Exit.TAKEN
    except ApiError as error:
        raise ConfigError("status.path", str(error)) from None


async def _fly(
    config: Config, confirm: Callable[[], Awaitable[bool]], write: Callable[[str], None]
) -> Exit:
    """Fly until landed or aborted, and land on the first signal."""

    def say(sentence: Sentence, /) -> None:
        write(sentence.text)

    quiet = IdleSlots()
    timer = StepTimer.start()
    flight: Flight | None = None

    def describe_tracking_error() -> Sentence | None:
        return None if flight is None else flight.describe_tracking_error()

    async with recorder(
        config, say, quiet, describe_tracking_error=describe_tracking_error
    ) as give:
        subscribers = (tell_lines(write),)
        flight = make_flight(
            config,
            confirm=confirm,
            subscribers=subscribers,
            give=give,
            quiet=quiet,
            running=running_processes,
        )
        obey(flight.ask, say, timer)
        calm_memory()
        try:
            async with crew(config, flight, say, quiet):
                outcome = await flight.run()
        except SourceError:  # ``write`` has told
            return Exit.FAILED
        return Exit.DONE if outcome.state is State.LANDED and not outcome.fault else Exit.FAILED


def daemon_command(config: Config, *, arm: bool, once: bool, as_json: bool) -> Exit:
    """Flights until a signal comes, with the lock of the vehicle held; log lines to stderr.

    Raises:
        ConfigError: ``arm`` under a service manager, which might start it again and again.
    """
    if arm and "NOTIFY_SOCKET" in os.environ:
        raise ConfigError("--arm", notice("arm.service", vehicle=config.vehicle.name))
    make_ends(config)  # what it names must go together, before anything is opened
    log = logging.getLogger("groundstation")
    log.setLevel(logging.INFO)
    number = sys.stderr.fileno()
    logging.getLogger().addHandler(LogHandler(number, as_json=as_json, journal=is_journal(number)))

    try:
        with (
            hold_lock(socket_path(config.status, config.vehicle.name), config.vehicle.name),
            registration(entry_of(config, "daemon", os.getpid())),
        ):
            if arm and (stopped := explain_stop()):
                log.error("%s", stopped)
                return Exit.FAILED
            return _run_precisely(_serve(config, arm=arm, once=once))
    except (Taken, ApiError) as error:
        log.error("%s", error)
        return Exit.TAKEN
    except (SourceError, LinkError, OSError) as error:
        log.error("%s", error)
        return Exit.FAILED


async def _serve(config: Config, *, arm: bool, once: bool) -> Exit:
    timer = StepTimer.start()
    daemon = Daemon(config, Notify(), arm=arm, once=once)
    obey(daemon.ask, _log, timer, daemon.stop)
    calm_memory()
    return await daemon.run()


def _run_precisely(work: Coroutine[None, None, Exit]) -> Exit:
    with asyncio.Runner(loop_factory=precise_loop) as runner:
        return runner.run(work)


def calm_memory() -> None:
    """No long garbage collection in flight: what start-up made is never looked at again, whole
    sweeps are rare.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(700, 10, 1000)  # short ones as often as Python itself has them
