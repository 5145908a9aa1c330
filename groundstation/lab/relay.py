"""Pose relay: one stream of datagrams in, a copy for each core out by loopback, bytes unchanged,
drops counted.
"""

import asyncio
import ipaddress
import os
import signal
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

from groundstation.core.messages import notice
from groundstation.pose.sources import cannot_listen, join
from links.io import Datagrams, format_address, is_loopback, parse_address

SENDERS = 4
"""Number of senders that are told apart: each has a port of its own on the way out, so that a core
sees where two send poses of one body; further ones share the first port."""


class Relay(asyncio.DatagramProtocol):
    """Runs on the real and on the virtual loop alike.

    A copy that can't leave at once is dropped: the next pose is worth more than an old one. Where
    this dies, no pose comes any more, and every core's guards do what they do without poses.
    """

    def __init__(
        self, listen: str, targets: Sequence[str], *, group: str = "", interface: str = ""
    ) -> None:
        """Hand what comes to ``listen`` (host:port) on to each of ``targets``.

        Nothing is opened yet.

        ``group`` is a multicast address to join, on the ``interface`` with this address of ours.

        Raises:
            ValueError: an address is none, a target is not on this machine, or the relay would hear
                its own copies there.
        """
        self._listen = listen
        self._group, self._interface = group, interface
        if group and not ipaddress.ip_address(group).is_multicast:
            raise ValueError(notice("keys.multicast", key="--group", found=group))
        self._local = parse_address(listen)
        self._targets = [parse_address(target) for target in targets]
        host, port = self._local
        for name, (to, at) in zip(targets, self._targets, strict=True):
            if not is_loopback(to):  # the sockets on the way out are bound to the loopback address
                raise ValueError(notice("fleet.relay_away", target=name))
            if not group and at == port and host in (to, "0.0.0.0"):  # noqa: S104
                raise ValueError(notice("fleet.relay_loop", target=name))
        self._in: asyncio.DatagramTransport | None = None
        self._outs: list[Datagrams] = []
        self._ports: dict[tuple[Any, ...], int] = {}
        """Index of the port on the way out, by address of the sender."""
        self.received = 0
        """Datagrams that came in."""
        self.dropped: Counter[str] = Counter()
        """Copies that did not leave, by reason: congested, undeliverable."""

    async def open(self) -> None:
        """Begin.

        Raises:
            SourceError: the address can't be listened on; the message says which and why.
        """
        loop = asyncio.get_running_loop()
        host, port = self._local
        local = (self._group, port) if self._group else (host, port)
        try:
            for _ in range(SENDERS):
                out, _ = await loop.create_datagram_endpoint(
                    asyncio.DatagramProtocol, local_addr=("127.0.0.1", 0)
                )
                self._outs.append(Datagrams(out))
            self._in, _ = await loop.create_datagram_endpoint(
                lambda: self, local_addr=local, reuse_port=True if self._group else None
            )
            if self._group:
                join(self._in, self._group, self._interface or host)
        except OSError as error:
            self.close()
            raise cannot_listen("poses to hand on", f"{local[0]}:{local[1]}", error) from error

    def close(self) -> None:
        """End."""
        if self._in is not None:
            self._in.close()
        for out in self._outs:
            out.abort()
        self._in, self._outs = None, []

    def datagram_received(self, data: bytes, addr: tuple[Any, ...]) -> None:
        """Hand one datagram on (called by the event loop)."""
        if not self._outs:
            return
        self.received += 1
        if addr not in self._ports and len(self._ports) < SENDERS:
            self._ports[addr] = len(self._ports)
        out = self._outs[self._ports.get(addr, 0)]
        for target in self._targets:
            if reason := out.send(data, target):
                self.dropped[reason] += 1

    def title(self) -> str:
        """Return the title for the operator."""
        where = f"{self._group}, port {self._local[1]}" if self._group else self._listen
        return f"relaying {where} to {', '.join(f'{host}:{port}' for host, port in self._targets)}"

    def summary(self) -> str:
        """Return the summary for the operator."""
        drops = ", ".join(f"{count} {reason}" for reason, count in sorted(self.dropped.items()))
        senders = ", ".join(format_address(sender) for sender in self._ports) or "nobody"
        return (
            f"relay: {self.received} datagrams handed on to {len(self._targets)} cores, from "
            f"{senders}; dropped: {drops or 'none'}"
        )


async def run_relay(relay: Relay, say: Callable[[str], None], *, until_eof: bool) -> None:
    """Hand on until SIGINT or SIGTERM, or where ``until_eof`` until standard input ends.

    Then say what was done.

    Raises:
        SourceError: see :meth:`Relay.open`.
    """
    loop, told = asyncio.get_running_loop(), asyncio.Event()
    await relay.open()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, told.set)
    if until_eof:
        try:
            loop.add_reader(0, lambda: None if os.read(0, 4096) else told.set())
        except PermissionError:  # a file or /dev/null, which nobody has to wait for
            told.set()
    say(relay.title())
    try:
        await told.wait()
    finally:
        if until_eof:
            loop.remove_reader(0)
        relay.close()
        say(relay.summary())
