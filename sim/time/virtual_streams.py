"""Stream connections in memory, for the event loop in virtual time: what is written arrives in its next turn."""

import asyncio
from collections.abc import Callable
from typing import Any, TypeAlias

Address: TypeAlias = tuple[str, int]
Hear: TypeAlias = Callable[[Address, Address, bytes], None]


class Stream(asyncio.Transport):
    """One end of a connection. It never has to wait, so nothing is ever buffered."""

    def __init__(self, loop: asyncio.AbstractEventLoop, hear: Hear, local: Address, remote: Address) -> None:
        """``hear(source, target, data)`` sees what leaves this end."""
        super().__init__({"sockname": local, "peername": remote})
        self._loop = loop
        self._hear = hear
        self._way = (local, remote)
        self._protocol: asyncio.BaseProtocol = asyncio.Protocol()
        self._closing = False
        self.other: Stream | None = None

    def write(self, data: Any) -> None:
        """Send bytes; nothing happens on a closed connection."""
        if not self._closing and self.other is not None:
            self._hear(*self._way, bytes(data))
            self._loop.call_soon(self.other.receive, bytes(data))

    def receive(self, data: bytes) -> None:
        """Take what the other end has sent."""
        if not self._closing and isinstance(self._protocol, asyncio.Protocol):
            self._protocol.data_received(data)

    def close(self) -> None:
        """Close both ends."""
        if not self._closing:
            self._closing = True
            self._loop.call_soon(self._protocol.connection_lost, None)
            if self.other is not None:
                self._loop.call_soon(self.other.close)

    def abort(self) -> None:
        """The same: there is nothing that waits to leave."""
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
        return self._protocol


class Listener:
    """What ``create_server`` returns, as far as it is used here."""

    def __init__(self, protocol_factory: Callable[[], asyncio.BaseProtocol], forget: Callable[[], Any]) -> None:
        """``forget`` takes it off the network."""
        self.protocol_factory = protocol_factory
        self._forget = forget

    def close(self) -> None:
        """Take no further connections."""
        self._forget()

    async def wait_closed(self) -> None:
        """Nothing is left to wait for."""


def connected(
    loop: asyncio.AbstractEventLoop,
    hear: Hear,
    client: asyncio.BaseProtocol,
    client_address: Address,
    server: asyncio.BaseProtocol,
    server_address: Address,
) -> tuple[Stream, asyncio.BaseProtocol]:
    """Two ends that know each other; returns the client's."""
    here = Stream(loop, hear, client_address, server_address)
    there = Stream(loop, hear, server_address, client_address)
    here.other, there.other = there, here
    for end, protocol in ((here, client), (there, server)):
        end.set_protocol(protocol)
        protocol.connection_made(end)
    return here, client
