"""Joining a multicast group: the one place that names options of sockets. It opens none (see datagram endpoints)."""

import asyncio
import socket


def join(transport: asyncio.DatagramTransport, group: str, interface: str) -> None:
    """Have the socket of ``transport`` receive what is sent to ``group``, by way of ``interface`` (IPv4 addresses).

    Raises:
        OSError: this machine has no such interface, or ``group`` is no multicast address.
    """
    membership = socket.inet_aton(group) + socket.inet_aton(interface)
    transport.get_extra_info("socket").setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)


def send_by(transport: asyncio.DatagramTransport, interface: str) -> None:
    """Have what is sent to groups from the socket of ``transport`` leave by way of ``interface`` (IPv4 address).

    Raises:
        OSError: this machine has no such interface.
    """
    options = transport.get_extra_info("socket")
    options.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(interface))
