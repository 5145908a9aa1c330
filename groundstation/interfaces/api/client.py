"""Client of a running ground station: the newest snapshot, who holds control, and orders with their
answers.

::

    async with open_client(path) as client:
        print(client.hello.vehicle)
        answer = await client.ask(Request(Ask.LAND, "too windy"))
        async for message in client:  # Snapshot or Control; ends when the ground station does
            ...

It is also what gives orders from a shell: ``groundstation request`` to one ground station,
``stop-all`` to all.
"""

import argparse
import asyncio
import signal
import sys
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Literal, cast

import msgspec

from groundstation.config import ConfigError, locate
from groundstation.core.messages import Ask, Request, Snapshot, Waypoint, notice
from groundstation.interfaces.api.messages import (
    ANYONE,
    LINE_MAX_BYTES,
    SNAPSHOT_PREFIX,
    VERSION,
    ClientOrder,
    Control,
    OrderAnswer,
    Refusal,
    StationHello,
    decode,
    encode_order,
)
from groundstation.machine import (
    BRIDGE,
    FLEET,
    ApiError,
    Running,
    find_socket,
    foreign_services,
    note_stop,
    owner,
    running_processes,
    send_signal,
)
from groundstation.runtime import Exit
from links.text import printable

ANSWER_S = 3.0
"""Timeout for a station's hello, answer and next snapshot, and for a broker's answer [s]."""


class StationClient:
    """One connection, made by :func:`open_client`.

    Iterate over it for the newest snapshot and changes of control.
    """

    hello: StationHello
    """The station's introduction."""
    control: Control
    """The newest message on who holds control."""

    def __init__(
        self, path: Path, name: str, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        """``path`` is named in errors; ``name`` is what the other clients read of this one."""
        self._path = path
        self._name = name
        self._writer = writer
        self._next_id = 1
        self._answers: dict[int, asyncio.Future[OrderAnswer]] = {}
        self._controls: list[Control] = []
        self._newest: bytes | None = None
        self._news = asyncio.Event()
        self._over = False
        self._trouble = ""
        self.ready: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        """Done once it has been greeted, with an ApiError where it has not."""
        self._listening = asyncio.create_task(self._listen(reader))

    # ---- orders

    async def ask(self, request: Request, vehicle: str = "") -> OrderAnswer:
        """Have ``request`` done; ``vehicle`` names the one to arm.

        Raises:
            ApiError: the connection is lost, or there was no answer.
        """
        return await self._order(
            ask=request.ask, why=request.why, vehicle=vehicle, points=request.points
        )

    async def take_control(self) -> OrderAnswer:
        """Take control; refused where somebody else holds it.

        Raises:
            ApiError: see :meth:`ask`.
        """
        return await self._order(control="take")

    async def give_control(self) -> OrderAnswer:
        """Give it away again; the end of the connection does, too.

        Raises:
            ApiError: see :meth:`ask`.
        """
        return await self._order(control="give")

    async def set_gains(self, gains: dict[str, float]) -> OrderAnswer:
        """Have gains moved in flight, by their dotted keys in the configuration.

        Raises:
            ApiError: see :meth:`ask`.
        """
        return await self._order(gains=gains)

    async def _order(
        self,
        *,
        ask: Ask | None = None,
        control: Literal["take", "give"] | None = None,
        gains: dict[str, float] | None = None,
        why: str = "",
        vehicle: str = "",
        points: tuple[Waypoint, ...] = (),
    ) -> OrderAnswer:
        if self._over:
            raise ApiError(
                notice(
                    "value.refused", value=self._path, why=self._trouble or notice("station.lost")
                )
            )
        number, self._next_id = self._next_id, self._next_id + 1
        loop = asyncio.get_running_loop()
        order = ClientOrder(
            id=number,
            ask=ask,
            control=control,
            gains=gains,
            points=points,
            why=why[:200],
            vehicle=vehicle,
            name=self._name,
            until_s=loop.time() + ANSWER_S,  # nobody waits for its answer any more
        )
        future: asyncio.Future[OrderAnswer] = loop.create_future()
        self._answers[number] = future
        self._writer.write(encode_order(order))
        try:
            async with asyncio.timeout(ANSWER_S):
                return await future
        except TimeoutError:
            raise ApiError(notice("station.no_answer", path=self._path, limit_s=ANSWER_S)) from None
        finally:
            self._answers.pop(number, None)

    # ---- what it hears

    def __aiter__(self) -> "StationClient":
        return self

    async def __anext__(self) -> Snapshot | Control:
        """The next change of control, or the newest snapshot that was not taken yet.

        Raises:
            ApiError: what is served there is not this protocol.
        """
        while True:
            if self._controls:
                return self._controls.pop(0)
            if self._newest is not None:
                line, self._newest = self._newest, None
                try:
                    return cast("Snapshot", decode(line))
                except ValueError as error:
                    raise ApiError(
                        notice("station.other_version", path=self._path, why=error)
                    ) from error
            if self._trouble:
                raise ApiError(f"{self._trouble} ({self._path})")
            if self._over:
                raise StopAsyncIteration
            self._news.clear()
            await self._news.wait()

    def close(self) -> None:
        """Leave; control, where it was held, goes with it."""
        self._writer.close()

    async def _listen(self, reader: asyncio.StreamReader) -> None:
        """Sort what comes; only the newest snapshot is kept."""
        try:
            while not self._trouble and (line := await reader.readline()).endswith(b"\n"):
                if line.startswith(SNAPSHOT_PREFIX) and self.ready.done():
                    self._newest = line
                else:
                    self._hear(line)
                self._news.set()
        except ValueError:
            self._trouble = f"not a ground station: a line is longer than {LINE_MAX_BYTES} bytes"
        except OSError:
            pass  # the connection is lost
        self._end()

    def _end(self) -> None:
        """Whoever waits hears of it."""
        self._writer.close()
        self._over = True
        lost = ApiError(f"{self._trouble or notice('station.closed')} ({self._path})")
        if not self.ready.done():
            self.ready.set_exception(lost)
        for future in self._answers.values():
            if not future.done():
                future.set_exception(lost)
        self._news.set()

    def _hear(self, line: bytes) -> None:
        try:
            message = decode(line)
        except ValueError as error:
            self._trouble = f"not a ground station of this version: {error}"
            return
        match message:
            case StationHello():
                if message.version != VERSION:
                    self._trouble = (
                        f"speaks version {message.version} of the protocol, this program {VERSION}"
                    )
                self.hello = message
            case Control():
                self.control = message
                if not self.ready.done():
                    self.ready.set_result(None)
                self._controls.append(message)
            case OrderAnswer():
                future = self._answers.get(message.id)
                if future is not None and not future.done():
                    future.set_result(message)
            case Refusal():
                for future in self._answers.values():
                    if not future.done():
                        future.set_exception(ApiError(f"{self._path}: {message.text}"))
            case _:
                pass


@asynccontextmanager
async def open_client(path: Path, name: str = "client") -> AsyncIterator[StationClient]:
    """A client of the ground station at ``path``; leaving gives up what control it has.

    Raises:
        OSError: nobody serves there.
        ApiError: what serves there is no ground station of this version, has too many clients, or
            is another user's.
    """
    try:
        client = StationClient(
            path, name, *await asyncio.open_unix_connection(path, limit=LINE_MAX_BYTES)
        )
    except PermissionError:
        raise ApiError(notice("station.other_user", path=path, user=owner(path))) from None
    try:
        try:
            async with asyncio.timeout(ANSWER_S):
                await client.ready
        except TimeoutError:
            raise ApiError(notice("station.no_greeting", path=path, limit_s=ANSWER_S)) from None
        yield client
    finally:
        client.close()


async def snapshots(path: Path) -> AsyncIterator[Snapshot]:
    """The snapshots served at ``path``, the newest where several wait; ends when the server closes.

    Raises:
        OSError: nobody serves there.
        ApiError: what is served there is not this protocol.
    """
    async with open_client(path) as client:
        async for message in client:
            if isinstance(message, Snapshot):
                yield message


END_S = 20.0
"""Timeout for a ground station that has not taken off to end [s].

The start of one takes 2 s, on a loaded machine of two processors up to 10."""
STOP_ANSWER_S = 1.0
"""Whom ``stop-all``, or a kill, has asked and who has not answered by then, gets a signal [s]."""


def request_command(request: Request, vehicle: str | None, socket: Path | None) -> Exit:
    """Ask, print the answer, and return 0 where it is done, 1 where it is refused, 2 where nobody
    is there.

    Where a kill is not answered, the process that is meant gets the signal instead.
    """
    kill = request.ask is Ask.KILL
    try:
        asked = ask_station(request, vehicle, socket)
        answer = asyncio.run(_at_once(asked) if kill else asked)
    except (ApiError, OSError) as error:
        says = str(error)
        meant = _find_flight(vehicle, socket) if kill else None
        if meant is not None:
            told = _stop_by_signal(meant, Ask.KILL, says)
            print(printable(told.says), file=sys.stderr)
            return Exit.DONE if told.answered else Exit.FAILED
        print(f"groundstation: request: {says}", file=sys.stderr)
        return Exit.NOBODY
    print(answer.says)
    return Exit.DONE if answer.done else Exit.FAILED


async def _at_once(asked: Awaitable[OrderAnswer]) -> OrderAnswer:
    try:
        async with asyncio.timeout(STOP_ANSWER_S):
            return await asked
    except TimeoutError:
        raise ApiError(notice("request.no_answer", limit_s=STOP_ANSWER_S)) from None


def _find_flight(vehicle: str | None, socket: Path | None) -> Running | None:
    """The one flight of this machine that a request is for.

    None where there is none, or more than one.
    """
    there = [
        one
        for one in running_processes()
        if one.command not in (BRIDGE, FLEET)
        and vehicle in (None, one.vehicle)
        and (socket is None or socket.absolute() == Path(one.socket))
    ]
    return there[0] if len(there) == 1 else None


async def ask_station(
    request: Request, vehicle: str | None = None, socket: Path | str | None = None
) -> OrderAnswer:
    """Send ``request`` and return the answer; control is taken meanwhile where it is needed.

    ``vehicle`` is the name of the one that is meant; without it, the only one that flies here.

    Raises:
        ConfigError: one of the arguments is not of its type.
        ApiError: nobody flies it, or it is not clear who is meant.
        OSError: the socket can't be opened.
    """
    request = _as_sent(request)
    for name, given in (("vehicle", vehicle), ("socket", socket)):
        if not isinstance(given, str | Path | None):
            raise ConfigError(name, notice("value.form", form="text", found=given))
    path = Path(socket) if socket is not None else await find_socket(vehicle)
    try:
        async with open_client(path, "request") as client:
            served = client.hello.vehicle
            if request.ask is Ask.ARM and vehicle is None:
                raise ApiError(notice("request.name_it", vehicle=served))
            if vehicle is not None and vehicle != served:
                raise ApiError(
                    notice("request.other_vehicle", path=path, found=served, wanted=vehicle)
                )
            if request.ask not in ANYONE:
                taken = await client.take_control()
                if not taken.done:
                    return taken
            return await client.ask(request, vehicle=vehicle or "")
    except (FileNotFoundError, ConnectionRefusedError):
        raise ApiError(notice("request.nobody", path=path)) from None


def _as_sent(request: object) -> Request:
    """``request`` as it is read at the other end: Python lets anything into a :class:`Request`.

    Raises:
        ConfigError: it would not be read.
    """
    if not isinstance(request, Request):
        raise ConfigError("request", notice("request.not_one", found=request))
    try:
        return msgspec.convert(msgspec.to_builtins(request), Request)
    except msgspec.ValidationError as error:
        key, problem = locate(error)
        raise ConfigError(f"request.{key}", problem) from None
    except TypeError as error:
        raise ConfigError("request", str(error)) from None


class StopReport(msgspec.Struct, frozen=True):
    """Result of stopping one flight."""

    answered: bool
    says: str
    """A line for the operator, with its name."""


async def stop_all(ask: Ask, why: str = "stop-all") -> list[StopReport]:
    """Ask all that run to come down by ``ask``, each on its own: none waits for another.

    Programs that only start end before they arm.
    """
    note_stop()  # first, so that one that is not in the register yet finds it
    return list(await asyncio.gather(*(_stop(one, ask, why) for one in running_processes())))


async def _stop(one: Running, ask: Ask, why: str) -> StopReport:
    who = f"{one.vehicle} (process {one.pid})"
    if one.command == BRIDGE:
        return _bridge(one, ask)
    if one.command == FLEET:
        # To land, a signal that never asks for more: cores that fly are asked themselves, too.
        send_signal(one, signal.SIGQUIT if ask is Ask.KILL else signal.SIGHUP)
        return StopReport(True, str(notice("stop_all.fleet", who=who)))
    try:
        async with (
            asyncio.timeout(STOP_ANSWER_S),
            open_client(Path(one.socket), "stop-all") as client,
        ):
            answer = await client.ask(Request(ask, why))
        return StopReport(True, str(notice("stop_all.answered", who=who, answer=answer.says)))
    except TimeoutError:
        trouble = str(notice("request.no_answer", limit_s=STOP_ANSWER_S))
    except ApiError as error:
        trouble = str(error)
    except OSError as error:
        trouble = str(notice("stop_all.socket", socket=one.socket, why=error.strerror or error))
    return _stop_by_signal(one, ask, trouble)


def _stop_by_signal(one: Running, ask: Ask, trouble: str) -> StopReport:
    """Stop a station that can't be asked by the signal of the same meaning."""
    who = f"{one.vehicle} (process {one.pid})"
    number = signal.SIGQUIT if ask is Ask.KILL else signal.SIGTERM
    if not send_signal(one, number):
        return StopReport(True, str(notice("stop_all.ended", who=who, trouble=trouble)))
    means = "motors off" if number is signal.SIGQUIT else "lands"
    says = notice("stop_all.signal", who=who, trouble=trouble, signal=number.name, means=means)
    return StopReport(False, str(says))


def _bridge(one: Running, ask: Ask) -> StopReport:
    """A bridge is not asked to land: what flies by it lands by its own station's commands."""
    who = f"{BRIDGE} at {one.vehicle} (process {one.pid})"
    if ask is Ask.KILL:
        done = send_signal(one, signal.SIGQUIT)
        return StopReport(
            done,
            str(notice("stop_all.bridge_killed" if done else "stop_all.bridge_ended", who=who)),
        )
    return StopReport(True, str(notice("stop_all.bridge", who=who, pid=f"{one.pid}")))


def stop_all_command(args: argparse.Namespace, ask_back: Callable[[str], str] | None) -> Exit:
    """Ask, print a line for each, and return 0 only where every one has answered.

    ``ask_back`` asks the operator; None where nobody is there to answer.

    Raises:
        ConfigError: motors off would need a yes that nobody can give.
    """
    ask = Ask.KILL if args.kill else Ask.DESCEND if args.descend else Ask.LAND
    there = running_processes()
    if ask is Ask.KILL and there and not args.yes:
        names = ", ".join(one.vehicle for one in there)
        if ask_back is None:
            raise ConfigError("--kill", notice("stop_all.needs_yes", names=names))
        if ask_back(str(notice("stop_all.question", names=names))).strip() != "yes":
            print(notice("stop_all.not_done"))
            return Exit.FAILED
    told = asyncio.run(stop_all(ask))
    for one in told:
        print(printable(one.says), file=sys.stdout if one.answered else sys.stderr)
    for folder in foreign_services():
        whose = owner(folder)
        print(notice("stop_all.foreign", folder=folder, user=whose))
    if not told:
        print(notice("stop_all.nothing"))
    return Exit.DONE if all(one.answered for one in told) else Exit.FAILED
