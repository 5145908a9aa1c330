"""Local server: a flight to the clients of a UNIX socket.

None of them can hold it up: see docs/reference/api.md.
"""

import asyncio
import socket
import struct
from typing import cast

from groundstation.core.messages import Say, Snapshot, notice
from groundstation.interfaces.api.messages import (
    ORDER_MAX_BYTES,
    VERSION,
    Allowance,
    ClientOrder,
    Core,
    Desk,
    Message,
    Party,
    Refusal,
    StationHello,
    TokenBucket,
    decode_order,
    encode,
)
from groundstation.machine import (
    ApiError,
    IdleSlots,
    Latest,
    StatusConfig,
    claim_socket,
    socket_path,
)

CLIENTS_MAX = 20
"""At most this many clients; the next takes the place of one that only reads, so that an order
always gets in."""
BACKLOG_MAX_BYTES = 65536
"""A client that leaves more than this unread, beyond its greeting and what the kernel holds for it,
is dropped."""
ORDERS = Allowance(rate_hz=20.0, burst=20.0)
"""Lines read of a client; more wait in its own socket."""


class Server:
    """Serves the newest snapshot and takes orders; encodes only while somebody is attached."""

    def __init__(
        self,
        config: StatusConfig,
        vehicle: str,
        latest: Latest[Snapshot],
        core: Core,
        *,
        quiet: IdleSlots | None = None,
        pid: int = 0,
        version: str = "",
        config_text: str = "",
        log: Say = lambda _: None,
    ) -> None:
        """Serve what ``latest`` holds for that vehicle, and have ``core`` do what is ordered.

        Snapshots leave when it is ``quiet``. ``pid``, ``version`` and ``config_text`` are told to
        clients; ``log`` takes a line about each that misbehaves.
        """
        self.path = socket_path(config, vehicle)
        self.desk = Desk(vehicle, core)
        self._period_s = 1.0 / config.rate_hz
        self._latest = latest
        self._quiet = quiet or IdleSlots()
        self._hello = encode(StationHello(VERSION, vehicle, pid, version, config_text))
        self._log = log
        # To the number of the snapshot that it got last.
        self._clients: dict[_AttachedClient, int] = {}
        self._attached = asyncio.Event()
        self._line = (0, b"")
        self._server: asyncio.Server | None = None

    async def open(self) -> None:
        """Let clients attach, until :meth:`close`.

        Raises:
            ApiError: another ground station serves there, or the path can't be used.
        """
        await claim_socket(self.path)
        try:
            self._server = await asyncio.start_unix_server(
                self._talk,
                self.path,
                limit=ORDER_MAX_BYTES,
                start_serving=False,
                backlog=CLIENTS_MAX,
            )
        except (OSError, ValueError) as error:
            raise ApiError(notice("socket.failed", path=self.path, why=error)) from error
        self.path.chmod(0o600)  # nobody can connect before it: not listening yet
        await self._server.start_serving()

    async def _talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Take the lines of one more client, as many as it may send by then.

        The others fill its own socket.
        """
        client, allowance, loop = (
            _AttachedClient(writer.transport, BACKLOG_MAX_BYTES + len(self._hello)),
            TokenBucket(ORDERS),
            asyncio.get_running_loop(),
        )
        self._attach(client)
        try:
            while (line := await reader.readline()).endswith(
                b"\n"
            ) and not client.transport.is_closing():
                while not allowance.take(loop.time()):  # noqa: ASYNC110  # time allows it, not an event
                    await asyncio.sleep(1.0 / ORDERS.rate_hz)
                self._order(line, client)
        except ValueError:
            self._refuse(client, "oversized", f"a line is longer than {ORDER_MAX_BYTES} bytes")
        except OSError:
            pass  # it is gone
        except asyncio.CancelledError:
            pass  # the station ends; before Python 3.12 asyncio logs this as an error
        finally:
            client.transport.close()
            self._detach(client)

    async def publish(self) -> None:
        """Send snapshots until cancelled."""
        while True:
            await self._attached.wait()
            await self._quiet.moment()
            self._publish()
            await asyncio.sleep(self._period_s)

    def close(self) -> None:
        """Send the last snapshot, and the end; the socket goes away."""
        if self._server is not None:
            self.path.unlink(missing_ok=True)
            self._server.close()
        self._publish()
        for client in list(self._clients):
            client.transport.close()

    def _attach(self, client: "_AttachedClient") -> None:
        """Take a new client, whose order may be the one that counts.

        Where there are too many, another one goes.
        """
        if len(self._clients) >= CLIENTS_MAX:
            self._make_room()
        self._clients[client] = 0
        self._attached.set()
        client.write(self._hello)
        client.write(encode(self.desk.control(client.party)))

    def _make_room(self) -> None:
        """Drop the client that came first of those that only read, else who lacks control."""
        reading = [client for client in self._clients if not client.orders]
        free = [client for client in self._clients if not self.desk.control(client.party).yours]
        dropped = next(iter(reading or free))
        self._detach(dropped)
        dropped.transport.abort()

    def _detach(self, client: "_AttachedClient") -> None:
        """Forget a client that went away; control goes with it."""
        if self._clients.pop(client, None) is not None and self.desk.leave(client.party):
            self._tell_control()
        if not self._clients:
            self._attached.clear()

    def _order(self, line: bytes, client: "_AttachedClient") -> None:
        """Do what a line of ``client`` says; whatever is no order does nothing."""
        order = decode_order(line)
        if not isinstance(order, ClientOrder):
            return self._refuse(client, "malformed", order)
        if client.party.replays(order):
            return self._refuse(
                client, "replayed", f"id {order.id} is not greater than those before it"
            )
        client.orders = True
        before = self.desk.control(client.party)
        client.write(encode(self.desk.take(order, client.party, asyncio.get_running_loop().time())))
        if self.desk.control(client.party) != before:
            self._tell_control()
        return None

    def _refuse(self, client: "_AttachedClient", reason: str, text: str) -> None:
        if reason not in client.refused:
            client.refused.add(reason)
            self._log(notice("order.none", client=client.party.label, why=text).as_warning())
        client.write(encode(Refusal(text)))

    def _tell_control(self) -> None:
        for client in list(self._clients):
            client.write(encode(self.desk.control(client.party)))

    def _publish(self) -> None:
        """Send the newest snapshot to every client that has not got it."""
        if not self._clients or self._latest.newest is None:
            return
        number, snapshot = self._latest.newest
        if number != self._line[0]:
            self._line = (number, encode(cast("Message", snapshot)))
        for client, last in list(self._clients.items()):
            if last != number:
                self._clients[client] = number
                client.write(self._line[1])


class _AttachedClient:
    """One attached client. It is never waited for: one that does not read is dropped."""

    def __init__(self, transport: asyncio.WriteTransport, most_unread: int) -> None:
        """Take its end, and how much it may leave unread [bytes]."""
        self.transport = transport
        self._most_unread = most_unread
        self.party = Party(_pid(transport))
        self.refused: set[str] = set()
        """Reasons for which lines of it were no order, each of which is logged once."""
        self.orders = False
        """Whether it has ever sent an order, and does not only read."""

    def write(self, line: bytes) -> None:
        """Send ``line``, unless it left too much unread."""
        if self.transport.is_closing():
            return
        if self.transport.get_write_buffer_size() > self._most_unread:
            self.transport.abort()
            return
        self.transport.write(line)


def _pid(transport: asyncio.BaseTransport) -> int | None:
    """The process at the other end, as the system has it; None where that is no UNIX socket."""
    wire, peer = (
        transport.get_extra_info("socket"),
        getattr(socket, "SO_PEERCRED", None),
    )  # Linux has it (unix(7))
    if wire is None or peer is None:
        return None
    try:
        return int(struct.unpack("3i", wire.getsockopt(socket.SOL_SOCKET, peer, 12))[0])
    except OSError:
        return None
