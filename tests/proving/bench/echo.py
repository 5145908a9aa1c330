"""The floor of a latency measurement: asyncio sends every datagram back.

Run as ``-m tests.proving.bench.echo``.
"""

import asyncio
from typing import Any


class Echo(asyncio.DatagramProtocol):
    """Sends back what comes."""

    def connection_made(self, transport: Any) -> None:
        """Say where (called by the event loop)."""
        self._transport = transport
        print(transport.get_extra_info("sockname")[1], flush=True)

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Take one datagram (called by the event loop)."""
        self._transport.sendto(data, addr)


async def main() -> None:
    """Echo until killed, on a free port, whose number is printed."""
    loop = asyncio.get_running_loop()
    await loop.create_datagram_endpoint(Echo, local_addr=("127.0.0.1", 0))
    await loop.create_future()


if __name__ == "__main__":
    asyncio.run(main())
