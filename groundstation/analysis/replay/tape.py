"""An event loop whose time is that of a recording, and whose wires carry what was recorded on them.

Sources and links run on it unchanged: they open their wires, and hear what they heard in flight, at the same instants
and in the same turns of the loop. What they send goes nowhere.
"""

import asyncio
import selectors
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

Wire = tuple[str, str, str]
"""Kind, and both addresses as they were asked for (records.WireRecord)."""


class _Stopper(selectors.DefaultSelector):
    """Instead of waiting for anything, stops the loop."""

    loop: "TapeLoop"

    def select(self, timeout: float | None = None) -> Any:
        if timeout is None or timeout > 0.0:
            self.loop.stop()
        return super().select(0)


class TapeLoop(asyncio.SelectorEventLoop):
    """Runs only while :meth:`settle` does."""

    def __init__(self) -> None:
        """Begin at time 0, without wires."""
        self.now = 0.0
        """What the running code is told the time is [s]."""
        selector = _Stopper()
        selector.loop = self
        super().__init__(selector)
        self._protocols: dict[Wire, list[Any]] = defaultdict(list)

    def time(self) -> float:
        """The recording's time [s]."""
        return self.now

    def settle(self) -> None:
        """Run until every task waits for something that is not on the tape yet, or for a later time."""
        self.run_forever()

    def protocol(self, wire: Wire) -> Any:
        """The code at our end of a wire that the recording says was opened now; None where nobody opened it."""
        opened = self._protocols[wire]
        return opened.pop(0) if opened else None

    async def create_datagram_endpoint(
        self, protocol_factory: Callable[[], Any], local_addr: Any = None, remote_addr: Any = None, **_: Any
    ) -> tuple[Any, Any]:
        """A datagram endpoint that only hears."""
        return self._open(("udp", _address(local_addr), _address(remote_addr)), protocol_factory, local_addr)

    async def create_connection(
        self, protocol_factory: Callable[[], Any], host: Any = None, port: Any = None, **_: Any
    ) -> tuple[Any, Any]:
        """A connection that only hears."""
        return self._open(("tcp", "", _address((host, port))), protocol_factory, None)

    async def create_serial_connection(self, factory: Callable[[], Any], path: str, _baud: int) -> tuple[Any, Any]:
        """A serial port that only hears, and is none."""
        return self._open(("serial", "", path), factory, None)

    def _open(self, wire: Wire, factory: Callable[[], Any], local: Any) -> tuple[Any, Any]:
        protocol = factory()
        self._protocols[wire].append(protocol)
        peer = tuple(wire[2].rsplit(":", 1)) if wire[2] and wire[0] != "serial" else None
        transport = _Mute({"sockname": local or ("127.0.0.1", 0), "peername": peer, "socket": _NoSocket()})
        protocol.connection_made(transport)
        return transport, protocol


@contextmanager
def tape_loop() -> Iterator[TapeLoop]:
    """A loop, and the end of all that still runs on it."""
    loop = TapeLoop()
    try:
        yield loop
    finally:
        for task in asyncio.all_tasks(loop):
            task.cancel()
        loop.settle()
        loop.close()


def _address(address: Any) -> str:
    return "" if address is None else f"{address[0]}:{address[1]}"


class _Mute(asyncio.DatagramTransport, asyncio.Transport):
    """A transport into nowhere."""

    def sendto(self, data: Any, addr: Any = None) -> None:
        pass

    def write(self, data: Any) -> None:
        pass

    def send(self, data: bytes) -> int:
        return len(data)

    def waiting(self) -> int:
        return 0

    def get_write_buffer_size(self) -> int:
        return 0

    def is_closing(self) -> bool:
        return False

    def close(self) -> None:
        pass

    def abort(self) -> None:
        pass


class _NoSocket:
    """What code finds behind a wire."""

    def setsockopt(self, *_: Any) -> None:
        pass

    def send(self, *_: Any) -> None:
        pass

    def sendto(self, *_: Any) -> None:
        pass

    def close(self) -> None:
        pass

    def dup(self) -> "_NoSocket":
        return self

    def fileno(self) -> int:
        return 1 << 24
