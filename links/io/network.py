"""Network addresses as the operator writes them, ``host:port`` with IPv6 hosts in brackets, and datagrams.

Those leave now or never.
"""

import ipaddress

TYPE_CHECKING = False  # asyncio would have to be imported, also for --help
if TYPE_CHECKING:
    import asyncio
    from typing import Any


def parse_address(text: str) -> tuple[str, int]:
    """The host and the port of ``127.0.0.1:51001``, ``localhost:51001`` or ``[::1]:51001``.

    The host is not looked up. IPv6 hosts come back without their brackets.

    Raises:
        ValueError: the text is no such address; the message says what is wrong and how to write it.
    """
    host, colon, port = text.rpartition(":")
    bracketed = host.startswith("[") and host.endswith("]")
    if bracketed:
        host = host[1:-1]
    if not colon:
        raise _explain_refusal(text, "it has no port")
    if not host:
        raise _explain_refusal(text, "it has no host")
    if not bracketed and (":" in host or "[" in text or "]" in text):
        raise _explain_refusal(text, "an IPv6 host needs brackets")
    if bracketed and not _is_ipv6(host):
        raise _explain_refusal(text, "only an IPv6 host takes brackets")
    if any(c.isspace() or c in "/@" for c in host):
        raise _explain_refusal(text, "the host holds a character that no host name has")
    # isascii: isdigit alone also accepts the digits of other scripts.
    if not (port.isascii() and port.isdigit() and len(port) <= 5 and 1 <= int(port) <= 65535):
        raise _explain_refusal(text, "the port must be a whole number from 1 to 65535")
    return host, int(port)


def is_loopback(host: str) -> bool:
    """True where ``host`` can only mean this machine: ``localhost`` or a loopback IP address.

    Any other name counts as another machine, whatever it would resolve to.
    """
    if host.lower() == "localhost":
        return True
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return False
    mapped = address.ipv4_mapped if isinstance(address, ipaddress.IPv6Address) else None
    return (mapped or address).is_loopback


def beyond(key: str, address: str) -> str | None:
    """``key = address`` where that may lead off this machine; None on loopback."""
    return None if is_loopback(parse_address(address)[0]) else f"{key} = {address}"


def _is_ipv6(host: str) -> bool:
    try:
        ipaddress.IPv6Address(host)
    except ValueError:
        return False
    return True


def _explain_refusal(text: str, reason: str) -> ValueError:
    return ValueError(f"{text!r} is not an address: {reason}; write host:port such as 127.0.0.1:14550 or [::1]:14550")


class Datagrams:
    """The sending side of a datagram endpoint.

    asyncio keeps a datagram that the kernel has no room for (EAGAIN) and sends it later, when it may have passed its
    deadline. So what is sent here goes through a second handle on the same socket, and is dropped instead.
    """

    def __init__(self, transport: "asyncio.DatagramTransport") -> None:
        """Send on ``transport``, which may be connected or not."""
        self._transport = transport
        shared = transport.get_extra_info("socket")
        self._socket: Any = shared.dup() if shared is not None else None
        self._connected = transport.get_extra_info("peername") is not None

    def send(self, data: bytes, peer: "Any") -> str:
        """Send ``data`` to ``peer`` (None on a connected endpoint); returns why it did not leave, or nothing."""
        if peer is None and not self._connected:
            return "no_peer"
        if self._socket is None:
            self._transport.sendto(data, peer)
            return ""
        try:
            if self._connected:
                self._socket.send(data)
            else:
                self._socket.sendto(data, peer)
        except (BlockingIOError, InterruptedError):
            return "congested"
        except OSError:
            return "undeliverable"
        return ""

    def abort(self) -> None:
        """Close both handles; nothing leaves any more."""
        if self._socket is not None:
            self._socket.close()
        self._transport.abort()
