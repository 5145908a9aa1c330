"""Virtual time: an asyncio event loop with datagram endpoints and stream connections in memory.

Application code runs on it unchanged: nothing ever waits, time jumps to the next scheduled callback, and
``create_datagram_endpoint`` and ``create_connection`` connect endpoints by address inside the process. What is
written to a stream arrives in the loop's next turn. A run is bit-identical to the next one, and 60 s of flight take a
fraction of a second. No threads and no real sockets in this mode.
"""

import asyncio
import errno
import selectors
from collections import deque
from collections.abc import Callable, Coroutine, Mapping
from contextvars import Context, ContextVar, copy_context
from functools import wraps
from heapq import heapify, heappop, heappush
from typing import Any, ParamSpec, TypeAlias, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

Address: TypeAlias = tuple[str, int]
Hear: TypeAlias = Callable[[Address, Address, bytes], None]


class MemoryStream(asyncio.Transport):
    """One end of a connection. It never has to wait, so nothing is ever buffered."""

    def __init__(self, loop: asyncio.AbstractEventLoop, hear: Hear, local: Address, remote: Address) -> None:
        """``hear(source, target, data)`` sees what leaves this end."""
        super().__init__({"sockname": local, "peername": remote})
        self._loop = loop
        self._hear = hear
        self._way = (local, remote)
        self._protocol: Any = asyncio.Protocol()
        self._closing = False
        self.other: MemoryStream | None = None

    def write(self, data: Any) -> None:
        """Send bytes; nothing happens on a closed connection."""
        if not self._closing and self.other is not None:
            self._hear(*self._way, bytes(data))
            self._loop.call_soon(self.other.receive, bytes(data))

    def receive(self, data: bytes) -> None:
        """Take what the other end has sent."""
        if not self._closing:
            self._protocol.data_received(data)

    def close(self) -> None:
        """Close both ends."""
        if not self._closing:
            self._closing = True
            self._loop.call_soon(self._protocol.connection_lost, None)
            if self.other is not None:
                self._loop.call_soon(self.other.close)

    def abort(self) -> None:
        """Close at once: nothing waits to leave."""
        self.close()

    def get_write_buffer_size(self) -> int:
        """Nothing waits."""
        return 0

    def is_closing(self) -> bool:
        """True once it is closed."""
        return self._closing

    def set_protocol(self, protocol: asyncio.BaseProtocol) -> None:
        """Whoever takes what arrives."""
        self._protocol = protocol

    def get_protocol(self) -> asyncio.BaseProtocol:
        """Whoever takes what arrives."""
        taker: asyncio.BaseProtocol = self._protocol
        return taker


class Listener:
    """Server as ``create_server`` returns it, as far as it is used here."""

    def __init__(self, protocol_factory: Callable[[], asyncio.BaseProtocol], forget: Callable[[], Any]) -> None:
        """``forget`` takes it off the network."""
        self.protocol_factory = protocol_factory
        self._forget = forget

    def close(self) -> None:
        """Take no further connections."""
        self._forget()

    async def wait_closed(self) -> None:
        """Nothing is left to wait for."""


def connect_ends(
    loop: asyncio.AbstractEventLoop,
    hear: Hear,
    client: asyncio.BaseProtocol,
    client_address: Address,
    server: asyncio.BaseProtocol,
    server_address: Address,
) -> tuple[MemoryStream, asyncio.BaseProtocol]:
    """Two ends that know each other; returns the client's."""
    here = MemoryStream(loop, hear, client_address, server_address)
    there = MemoryStream(loop, hear, server_address, client_address)
    here.other, there.other = there, here
    for end, protocol in ((here, client), (there, server)):
        end.set_protocol(protocol)
        protocol.connection_made(end)
    return here, client


FREE_PORTS = range(61000, 65536)
"""Whoever asks for any port gets one of these: above those of Linux, as above every port that listens by default."""

RESOLUTION_S = 1e-9
"""Timers that are less apart are due in the same turn [s]."""
MANY_CANCELLED = 100
"""Timers that were cancelled are forgotten when there are more, and half of all."""

Tap: TypeAlias = Callable[[float, Address, Address, bytes], None]


class SimulationStuck(RuntimeError):
    """Every task waits and nothing is scheduled: a deadlock, found for free."""


class _Idle(selectors.BaseSelector):
    """A selector that watches nothing: in virtual time nobody waits."""

    def __init__(self) -> None:
        self._map: dict[int, selectors.SelectorKey] = {}

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        key = selectors.SelectorKey(fileobj, fileobj if isinstance(fileobj, int) else fileobj.fileno(), events, data)
        self._map[key.fd] = key
        return key

    def unregister(self, fileobj: Any) -> selectors.SelectorKey:
        return self._map.pop(fileobj if isinstance(fileobj, int) else fileobj.fileno())

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        return []

    def get_map(self) -> Mapping[Any, selectors.SelectorKey]:
        return self._map


class _Handle(asyncio.TimerHandle):
    """A callback that is due; made with fewer steps than asyncio's own, as a flight makes a thousand a second."""

    __slots__ = ()
    __eq__, __hash__ = object.__eq__, object.__hash__  # asyncio's own compare all that is in them
    _scheduled: bool  # whether it waits for its time

    def __init__(
        self, when: float, callback: Callable[..., object], args: tuple[Any, ...], loop: Any, context: Context | None
    ) -> None:
        self._context = copy_context() if context is None else context
        self._loop = loop
        self._callback = callback
        self._args = args
        self._cancelled = False
        self._repr = None
        self._source_traceback = None
        self._when = when
        self._scheduled = False

    def cancel(self) -> None:
        """Do not call it."""
        if not self._cancelled:
            self._cancelled = True
            if self._scheduled:
                self._loop.forget()
            self._callback = self._args = None  # type: ignore[assignment]  # as asyncio's own does


class _Endpoint(asyncio.DatagramTransport):
    """One in-memory datagram socket."""

    def __init__(self, loop: "VirtualTimeLoop", local: Address, remote: Address | None) -> None:
        super().__init__({"sockname": local, "peername": remote, "socket": _Socket(self)})
        self._loop = loop
        self.local = local
        self.remote = remote
        self.context = copy_context()
        """Context of the opener: arriving data are taken there, as by a socket's reader."""
        self.protocol: asyncio.DatagramProtocol | None = None
        self._closing = False

    def sendto(self, data: Any, addr: Any = None) -> None:
        target = addr or self.remote
        if target is None:
            raise ValueError("sendto needs an address: this endpoint is not connected")
        if not self._closing:
            self._loop.carry(self.local, (target[0], target[1]), bytes(data))

    def join(self, group: str) -> None:
        self._loop.groups.setdefault((group, self.local[1]), []).append(self)

    def close(self) -> None:
        if not self._closing:
            self._closing = True
            if self._loop.endpoints.get(self.local) is self:
                del self._loop.endpoints[self.local]
            for members in self._loop.groups.values():
                members[:] = [member for member in members if member is not self]
            if self.protocol is not None:
                self._loop.call_soon(self.protocol.connection_lost, None)

    def abort(self) -> None:
        self.close()

    def get_write_buffer_size(self) -> int:
        return 0

    def is_closing(self) -> bool:
        return self._closing

    def receive(self, data: bytes, source: Address) -> None:
        if not self._closing and self.protocol is not None and (self.remote is None or self.remote == source):
            self.protocol.datagram_received(data, source)


class _Socket:
    """Socket of an endpoint for application code: it sends, always with room, and joins groups."""

    def __init__(self, endpoint: _Endpoint) -> None:
        self._endpoint = endpoint

    def dup(self) -> "_Socket":
        return self

    def send(self, data: bytes) -> None:
        self._endpoint.sendto(data)

    def sendto(self, data: bytes, target: Address) -> None:
        self._endpoint.sendto(data, target)

    def setsockopt(self, level: int, option: int, value: bytes) -> None:
        """Join a group: its address, then that of an interface. An interface alone is where to send: all are one."""
        if len(value) == 8:
            self._endpoint.join(".".join(map(str, value[:4])))

    def close(self) -> None:
        """The endpoint stays: this was but a handle on it."""


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """``asyncio.Runner(loop_factory=VirtualTimeLoop)`` runs a simulation as fast as the processor allows."""

    __slots__ = (  # with those of asyncio's own it would have so many that a dictionary is slow
        "_held", "_later", "_later_cancelled", "_next_port", "_now", "_suspended", "endpoints", "groups", "listeners",
        "tap",
    )  # fmt: skip
    _ready: deque[asyncio.Handle]  # asyncio's own, of which typeshed does not tell
    _closed: bool
    _stopping: bool

    def __init__(self) -> None:
        super().__init__(_Idle())
        self._now = 0.0
        self._later: list[tuple[float, _Handle]] = []
        self._later_cancelled = 0
        self.endpoints: dict[Address, _Endpoint] = {}
        self.groups: dict[Address, list[_Endpoint]] = {}
        self.listeners: dict[Address, Listener] = {}
        self.tap: Tap | None = None
        self._next_port = FREE_PORTS.start
        self._suspended: ContextVar[bool] | None = None
        self._held: list[asyncio.Handle] = []

    def suspend(self, process: ContextVar[bool]) -> None:
        """Run nothing in whose context ``process`` is true, until :meth:`resume`: its timers and datagrams wait."""
        self._suspended = process

    def resume(self) -> None:
        """Let what was suspended go on: all that has waited is due now, in its order."""
        self._suspended = None
        self._ready.extend(self._held)
        self._held.clear()

    def time(self) -> float:
        """Virtual time [s]."""
        return self._now

    # ---- what asyncio's own does in more steps: no threads, no sockets, no debugging of slow callbacks here

    def call_soon(  # type: ignore[override]  # typeshed's has a type for each number of arguments
        self, callback: Callable[..., object], *args: Any, context: Context | None = None
    ) -> asyncio.Handle:
        """Call ``callback`` in the next turn of the loop."""
        if self._closed:
            raise RuntimeError("Event loop is closed")
        handle = _Handle(0.0, callback, args, self, context)
        self._ready.append(handle)
        return handle

    def call_at(  # type: ignore[override]
        self, when: float, callback: Callable[..., object], *args: Any, context: Context | None = None
    ) -> asyncio.TimerHandle:
        """Call ``callback`` at ``when`` [s]."""
        if self._closed:
            raise RuntimeError("Event loop is closed")
        handle = _Handle(when, callback, args, self, context)
        handle._scheduled = True
        heappush(self._later, (when, handle))
        return handle

    def call_later(  # type: ignore[override]
        self, delay: float, callback: Callable[..., object], *args: Any, context: Context | None = None
    ) -> asyncio.TimerHandle:
        """Call ``callback`` after ``delay`` [s]."""
        return self.call_at(self._now + delay, callback, *args, context=context)

    def forget(self) -> None:
        """A callback that waits for its time was cancelled."""
        self._later_cancelled += 1

    def _run_once(self) -> None:
        """One turn: let time pass to the next callback, where none is due; then call those that are.

        What is due at the same instant comes in the order that asyncio's own heap gives it.
        """
        due, timers = self._ready, self._later
        if len(timers) > MANY_CANCELLED and self._later_cancelled > 0.5 * len(timers):
            timers[:] = [timer for timer in timers if not timer[1]._cancelled]
            heapify(timers)
            self._later_cancelled = 0
        while timers and timers[0][1]._cancelled:
            heappop(timers)
            self._later_cancelled -= 1
        if not due and not self._stopping:
            if not timers:
                raise SimulationStuck("the simulation is stuck: every task waits and nothing is scheduled")
            wait = timers[0][0] - self._now
            if wait > 0.0:
                self._now += wait
        by = self._now + RESOLUTION_S
        while timers and timers[0][0] < by:
            timer = heappop(timers)[1]
            timer._scheduled = False
            due.append(timer)
        for _ in range(len(due)):
            handle = due.popleft()
            if handle._cancelled:
                continue
            if self._suspended is not None and handle._context.get(self._suspended, False):  # type: ignore[attr-defined]  # asyncio's own, of which typeshed does not tell
                self._held.append(handle)
            else:
                handle._run()

    # ---- the network

    async def create_datagram_endpoint(  # type: ignore[override]  # the in-memory network needs only these
        self,
        protocol_factory: Callable[[], asyncio.DatagramProtocol],
        local_addr: Address | None = None,
        remote_addr: Address | None = None,
        reuse_port: bool | None = None,
        **_: Any,
    ) -> tuple[asyncio.DatagramTransport, asyncio.DatagramProtocol]:
        """An endpoint of the in-memory network; port 0 picks a free one.

        Raises:
            OSError: the address is in use.
        """
        local = host, port = self._bind(local_addr)
        if local in self.endpoints and not reuse_port:
            raise OSError(errno.EADDRINUSE, f"address {host}:{port} is already in use")
        endpoint = _Endpoint(self, local, remote_addr)
        protocol = protocol_factory()
        endpoint.protocol = protocol
        self.endpoints[local] = endpoint
        protocol.connection_made(endpoint)
        return endpoint, protocol

    async def create_connection(  # type: ignore[override]  # the in-memory network needs only these
        self, protocol_factory: Callable[[], asyncio.BaseProtocol], host: str, port: int, **_: Any
    ) -> tuple[asyncio.Transport, asyncio.BaseProtocol]:
        """A stream to whoever listens at ``host``:``port``.

        Raises:
            ConnectionRefusedError: nobody does.
        """
        listener = self.listeners.get((host, port))
        if listener is None:
            raise ConnectionRefusedError(errno.ECONNREFUSED, f"nobody listens at {host}:{port}")
        local = self._bind(None)

        def hear(source: Address, target: Address, data: bytes) -> None:
            if self.tap is not None:
                self.tap(self.time(), source, target, data)

        return connect_ends(self, hear, protocol_factory(), local, listener.protocol_factory(), (host, port))

    async def create_server(  # type: ignore[override]  # the in-memory network needs only these
        self, protocol_factory: Callable[[], asyncio.BaseProtocol], host: str, port: int, **_: Any
    ) -> Listener:
        """Take the streams that are opened to ``host``:``port``.

        Raises:
            OSError: the address is in use.
        """
        if (host, port) in self.listeners:
            raise OSError(errno.EADDRINUSE, f"address {host}:{port} is already in use")
        listener = Listener(protocol_factory, lambda: self.listeners.pop((host, port), None))
        self.listeners[host, port] = listener
        return listener

    def _bind(self, address: Address | None) -> Address:
        host, port = address or ("127.0.0.1", 0)
        return host, port or self._free_port(host)

    def _free_port(self, host: str) -> int:
        """The next one in turn, so that what is on its way to a port that was closed meets nobody new there."""
        for _ in FREE_PORTS:
            port = self._next_port
            self._next_port = port + 1 if port + 1 in FREE_PORTS else FREE_PORTS.start
            if (host, port) not in self.endpoints:
                return port
        raise OSError(errno.EADDRINUSE, f"every port of {host} is in use")

    def carry(self, source: Address, target: Address, data: bytes) -> None:
        """Bring one datagram to ``target`` in the next turn of the loop; lost where nobody listens, as in UDP."""
        if self.tap is not None:
            self.tap(self._now, source, target, data)
        members = self.groups.get(target)
        if members is not None:
            for member in members:
                self.call_soon(member.receive, data, source, context=member.context)
            return
        endpoint = self.endpoints.get(target)
        if endpoint is not None:
            self.call_soon(endpoint.receive, data, source, context=endpoint.context)


def in_virtual_time(work: Callable[P, Coroutine[Any, Any, T]]) -> Callable[P, T]:
    """``work`` as a plain function: each call runs on a :class:`VirtualTimeLoop` of its own."""

    @wraps(work)
    def run(*args: P.args, **options: P.kwargs) -> T:
        with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
            return runner.run(work(*args, **options))

    return run
