"""An asyncio event loop in virtual time, with datagram endpoints in memory.

Application code runs on it unchanged: nothing ever waits, time jumps to the next scheduled callback, and
``create_datagram_endpoint`` connects endpoints by address inside the process. A run is bit-identical to the
next one, and 60 s of flight take a fraction of a second. No threads and no real sockets in this mode.
"""

import asyncio
import selectors
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

Address: TypeAlias = tuple[str, int]
Tap: TypeAlias = Callable[[float, Address, Address, bytes], None]


class SimulationStuck(RuntimeError):
    """Every task waits and nothing is scheduled: a deadlock, found for free."""


class _Idle(selectors.BaseSelector):
    """A selector that watches nothing and, instead of waiting, lets virtual time pass."""

    def __init__(self) -> None:
        self.now = 0.0
        self._map: dict[int, selectors.SelectorKey] = {}

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        key = selectors.SelectorKey(fileobj, fileobj if isinstance(fileobj, int) else fileobj.fileno(), events, data)
        self._map[key.fd] = key
        return key

    def unregister(self, fileobj: Any) -> selectors.SelectorKey:
        return self._map.pop(fileobj if isinstance(fileobj, int) else fileobj.fileno())

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if timeout is None:
            raise SimulationStuck("the simulation is stuck: every task waits and nothing is scheduled")
        if timeout > 0.0:
            self.now += timeout
        return []

    def get_map(self) -> Mapping[Any, selectors.SelectorKey]:
        return self._map


class _Endpoint(asyncio.DatagramTransport):
    """One in-memory datagram socket."""

    def __init__(self, loop: "VirtualTimeLoop", local: Address, remote: Address | None) -> None:
        super().__init__({"sockname": local, "peername": remote})
        self._loop = loop
        self.local = local
        self.remote = remote
        self.protocol: asyncio.DatagramProtocol | None = None
        self._closing = False

    def sendto(self, data: Any, addr: Any = None) -> None:
        target = addr or self.remote
        if target is None:
            raise ValueError("sendto needs an address: this endpoint is not connected")
        if not self._closing:
            self._loop.carry(self.local, (target[0], target[1]), bytes(data))

    def close(self) -> None:
        if not self._closing:
            self._closing = True
            self._loop.endpoints.pop(self.local, None)
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


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """``asyncio.Runner(loop_factory=VirtualTimeLoop)`` runs a simulation as fast as the processor allows."""

    def __init__(self) -> None:
        """Start at time 0 with an empty network."""
        self._idle = _Idle()
        super().__init__(self._idle)
        self.endpoints: dict[Address, _Endpoint] = {}
        self.tap: Tap | None = None
        self._next_port = 49152

    def time(self) -> float:
        """Virtual time [s]."""
        return self._idle.now

    async def create_datagram_endpoint(  # type: ignore[override]  # the in-memory network needs only these
        self,
        protocol_factory: Callable[[], asyncio.DatagramProtocol],
        local_addr: Address | None = None,
        remote_addr: Address | None = None,
        **_: Any,
    ) -> tuple[asyncio.DatagramTransport, asyncio.DatagramProtocol]:
        """An endpoint of the in-memory network; port 0 picks a free one.

        Raises:
            OSError: the address is in use.
        """
        host, port = local_addr or ("127.0.0.1", 0)
        if port == 0:
            port, self._next_port = self._next_port, self._next_port + 1
        local = (host, port)
        if local in self.endpoints:
            raise OSError(98, f"address {host}:{port} is already in use")
        endpoint = _Endpoint(self, local, remote_addr)
        protocol = protocol_factory()
        endpoint.protocol = protocol
        self.endpoints[local] = endpoint
        protocol.connection_made(endpoint)
        return endpoint, protocol

    def carry(self, source: Address, target: Address, data: bytes) -> None:
        """Bring one datagram to ``target`` in the next turn of the loop; lost where nobody listens, as in UDP."""
        if self.tap is not None:
            self.tap(self._idle.now, source, target, data)
        endpoint = self.endpoints.get(target)
        if endpoint is not None:
            self.call_soon(endpoint.receive, data, source)
