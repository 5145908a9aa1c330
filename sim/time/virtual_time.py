"""Virtual time: an asyncio event loop with datagram endpoints and stream connections in memory.

Application code runs on it unchanged. Time jumps to the next scheduled callback instead of waiting
for it, and ``create_datagram_endpoint`` and ``create_connection`` connect endpoints by address
inside the process. Data that is sent arrives in the loop's next turn. Two runs are identical to the
bit, and 60 s of flight take a fraction of a second. There are no threads and no real sockets.
"""

import asyncio
import errno
import selectors
from collections.abc import Callable, Coroutine, Mapping
from contextvars import copy_context
from functools import wraps
from typing import Any, ParamSpec, TypeAlias, TypeVar

from groundstation.core.messages import ROUNDING_S

P = ParamSpec("P")
T = TypeVar("T")

Address: TypeAlias = tuple[str, int]
"""Host and port."""
OnSent: TypeAlias = Callable[[Address, Address, bytes], None]
"""Function that takes data as they are sent: source, target, data."""
Tap: TypeAlias = Callable[[float, Address, Address, bytes], None]
"""Function that takes data as they are sent: virtual time [s], source, target, data."""

FREE_PORTS = range(61000, 65536)
"""Ports of endpoints that bind to port 0: above those that Linux assigns itself (32768 to 60999),
and above every port that listens by default."""


class MemoryStream(asyncio.Transport):
    """One end of a connection. It never has to wait, so nothing is ever buffered."""

    def __init__(
        self, loop: asyncio.AbstractEventLoop, on_sent: OnSent, local: Address, remote: Address
    ) -> None:
        """``on_sent`` is called with all data that leave this end."""
        super().__init__({"sockname": local, "peername": remote})
        self._loop = loop
        self._on_sent = on_sent
        self._local, self._remote = local, remote
        self._protocol: Any = asyncio.Protocol()
        self._closing = False
        self.other: MemoryStream | None = None
        """Other end of the connection."""

    def write(self, data: Any) -> None:
        """Send bytes; nothing happens on a closed connection."""
        if not self._closing and self.other is not None:
            self._on_sent(self._local, self._remote, bytes(data))
            self._loop.call_soon(self.other.receive, bytes(data))

    def receive(self, data: bytes) -> None:
        """Take the bytes that the other end has sent."""
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
        """Close at once: as nothing is buffered, the same as :meth:`close`."""
        self.close()

    def get_write_buffer_size(self) -> int:
        """Return 0, as nothing is buffered."""
        return 0

    def is_closing(self) -> bool:
        """Whether it is closed."""
        return self._closing

    def set_protocol(self, protocol: asyncio.BaseProtocol) -> None:
        """Have ``protocol`` take the data that arrive."""
        self._protocol = protocol


class Listener:
    """Server as ``create_server`` returns it, as far as it is used here."""

    def __init__(
        self, protocol_factory: Callable[[], asyncio.BaseProtocol], forget: Callable[[], Any]
    ) -> None:
        """``forget`` removes it from the network."""
        self.protocol_factory = protocol_factory
        self._forget = forget

    def close(self) -> None:
        """Take no further connections."""
        self._forget()


def connect_ends(
    loop: asyncio.AbstractEventLoop,
    on_sent: OnSent,
    client: asyncio.BaseProtocol,
    client_address: Address,
    server: asyncio.BaseProtocol,
    server_address: Address,
) -> tuple[MemoryStream, asyncio.BaseProtocol]:
    """Connect ``client`` and ``server`` by a stream; return the client's end and protocol."""
    here = MemoryStream(loop, on_sent, client_address, server_address)
    there = MemoryStream(loop, on_sent, server_address, client_address)
    here.other, there.other = there, here
    for end, protocol in ((here, client), (there, server)):
        end.set_protocol(protocol)
        protocol.connection_made(end)
    return here, client


class SimulationStuck(RuntimeError):
    """Deadlock: every task waits and nothing is scheduled."""


class _Clock(selectors.BaseSelector):
    """Selector of the loop that watches no file: instead of waiting for the next timer, time jumps
    to it.
    """

    def __init__(self) -> None:
        self.now_s = 0.0
        """Virtual time [s]."""
        self._map: dict[int, selectors.SelectorKey] = {}

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        key = selectors.SelectorKey(
            fileobj, fileobj if isinstance(fileobj, int) else fileobj.fileno(), events, data
        )
        self._map[key.fd] = key
        return key

    def unregister(self, fileobj: Any) -> selectors.SelectorKey:
        return self._map.pop(fileobj if isinstance(fileobj, int) else fileobj.fileno())

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Advance time to the next timer, ``timeout`` [s] from now; no file is ever ready.

        Raises:
            SimulationStuck: there is no timer.
        """
        if timeout is None:
            raise SimulationStuck(
                "the simulation is stuck: every task waits and nothing is scheduled"
            )
        self.now_s += timeout
        return []

    def get_map(self) -> Mapping[Any, selectors.SelectorKey]:
        return self._map


class _Endpoint(asyncio.DatagramTransport):
    """One in-memory datagram socket."""

    def __init__(self, loop: "VirtualTimeLoop", local: Address, remote: Address | None) -> None:
        super().__init__({"sockname": local, "peername": remote, "socket": _Socket(self)})
        self._loop = loop
        self.local = local
        self.remote = remote
        self.context = copy_context()
        """Context variables at the opening: the protocol takes arriving data in these, as with a
        real socket."""
        self.protocol: asyncio.DatagramProtocol | None = None
        self._closing = False

    def sendto(self, data: Any, addr: Any = None) -> None:
        target = addr or self.remote
        if target is None:
            raise ValueError("sendto needs an address: this endpoint is not connected")
        if not self._closing:
            self._loop.carry(self.local, (target[0], target[1]), bytes(data))

    def join(self, group: str) -> None:
        """Receive the datagrams to the multicast address ``group``, too."""
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
        """Take a datagram; a connected endpoint takes those of its remote address only."""
        if (
            not self._closing
            and self.protocol is not None
            and (self.remote is None or self.remote == source)
        ):
            self.protocol.datagram_received(data, source)


class _Socket:
    """Socket of an endpoint for application code: it sends without ever blocking, and joins
    multicast groups.
    """

    def __init__(self, endpoint: _Endpoint) -> None:
        self._endpoint = endpoint

    def dup(self) -> "_Socket":
        return self

    def send(self, data: bytes) -> None:
        self._endpoint.sendto(data)

    def sendto(self, data: bytes, target: Address) -> None:
        self._endpoint.sendto(data, target)

    def setsockopt(self, level: int, option: int, value: bytes) -> None:
        """Join a multicast group by an ``ip_mreq``: 4 bytes of its address, 4 of an interface's.

        The address of an interface alone selects the one to send by; here there is only one.
        """
        if len(value) == 8:
            self._endpoint.join(".".join(map(str, value[:4])))

    def close(self) -> None:
        """Do nothing: the endpoint stays open without its socket."""


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """``asyncio.Runner(loop_factory=VirtualTimeLoop)`` runs a simulation as fast as the processor
    allows.
    """

    def __init__(self) -> None:
        self._clock = _Clock()
        super().__init__(self._clock)
        self._clock_resolution = ROUNDING_S  # timers less apart are due in the same turn
        self.endpoints: dict[Address, _Endpoint] = {}
        """Newest open endpoint of each address."""
        self.groups: dict[Address, list[_Endpoint]] = {}
        """Members of each multicast group, by its address and port."""
        self.listeners: dict[Address, Listener] = {}
        """Servers that take connections, by address."""
        self.tap: Tap | None = None
        """Called with everything that is sent; None for nothing."""
        self._next_port = FREE_PORTS.start

    def time(self) -> float:
        """Virtual time [s]."""
        return self._clock.now_s

    # ---- the network

    async def create_datagram_endpoint(  # type: ignore[override]  # the in-memory network needs only these
        self,
        protocol_factory: Callable[[], asyncio.DatagramProtocol],
        local_addr: Address | None = None,
        remote_addr: Address | None = None,
        reuse_port: bool | None = None,
        **_: Any,
    ) -> tuple[asyncio.DatagramTransport, asyncio.DatagramProtocol]:
        """Open an endpoint of the in-memory network; port 0 takes a free one.

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
        """Open a stream to the server that listens at ``host``:``port``.

        Raises:
            ConnectionRefusedError: none listens there.
        """
        listener = self.listeners.get((host, port))
        if listener is None:
            raise ConnectionRefusedError(errno.ECONNREFUSED, f"nobody listens at {host}:{port}")
        local = self._bind(None)

        def on_sent(source: Address, target: Address, data: bytes) -> None:
            if self.tap is not None:
                self.tap(self.time(), source, target, data)

        return connect_ends(
            self, on_sent, protocol_factory(), local, listener.protocol_factory(), (host, port)
        )

    async def create_server(  # type: ignore[override]  # the in-memory network needs only these
        self, protocol_factory: Callable[[], asyncio.BaseProtocol], host: str, port: int, **_: Any
    ) -> Listener:
        """Listen for streams that are opened to ``host``:``port``.

        Raises:
            OSError: the address is in use.
        """
        if (host, port) in self.listeners:
            raise OSError(errno.EADDRINUSE, f"address {host}:{port} is already in use")
        listener = Listener(protocol_factory, lambda: self.listeners.pop((host, port), None))
        self.listeners[host, port] = listener
        return listener

    def _bind(self, address: Address | None) -> Address:
        """Return ``address`` with a free port in the place of 0; None is any port of loopback."""
        host, port = address or ("127.0.0.1", 0)
        return host, port or self._find_free_port(host)

    def _find_free_port(self, host: str) -> int:
        """Return the next free port in turn: data under way to a port that was closed must not
        reach a new endpoint.
        """
        for _ in FREE_PORTS:
            port = self._next_port
            self._next_port = port + 1 if port + 1 in FREE_PORTS else FREE_PORTS.start
            if (host, port) not in self.endpoints:
                return port
        raise OSError(errno.EADDRINUSE, f"every port of {host} is in use")

    def carry(self, source: Address, target: Address, data: bytes) -> None:
        """Deliver one datagram to ``target`` in the next turn of the loop.

        Without an endpoint there it is lost, as in UDP.
        """
        if self.tap is not None:
            self.tap(self.time(), source, target, data)
        members = self.groups.get(target)
        if members is not None:
            for member in members:
                self.call_soon(member.receive, data, source, context=member.context)
            return
        endpoint = self.endpoints.get(target)
        if endpoint is not None:
            self.call_soon(endpoint.receive, data, source, context=endpoint.context)


def in_virtual_time(
    work: Callable[P, Coroutine[Any, Any, T]], loop: Callable[[], VirtualTimeLoop] | None = None
) -> Callable[P, T]:
    """Return ``work`` as a plain function: each call runs on a new loop, made by ``loop``."""

    @wraps(work)
    def run(*args: P.args, **options: P.kwargs) -> T:
        with asyncio.Runner(loop_factory=loop or VirtualTimeLoop) as runner:
            return runner.run(work(*args, **options))

    return run
