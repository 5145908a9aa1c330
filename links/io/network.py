"""Network addresses as the operator writes them: ``host:port``, with IPv6 hosts in brackets. Sans-IO."""

import ipaddress
from typing import Any

from links.text import link_notice


def parse_address(text: str, key: str = "") -> tuple[str, int]:
    """The host and the port of ``127.0.0.1:51001``, ``localhost:51001`` or ``[::1]:51001``.

    The host is not looked up. IPv6 hosts come back without their brackets.

    Raises:
        ValueError: the text is no such address; the message says what is wrong and how to write it, after the ``key``
            of a configuration that it is of.
    """
    if key:
        try:
            return parse_address(text)
        except ValueError as error:
            raise ValueError(f"{key}: {error}") from None
    host, colon, port = text.rpartition(":")
    bracketed = host.startswith("[") and host.endswith("]")
    if bracketed:
        host = host[1:-1]
    if not colon:
        raise _explain_refusal(text, "address.no_port")
    if not host:
        raise _explain_refusal(text, "address.no_host")
    if not bracketed and (":" in host or "[" in text or "]" in text):
        raise _explain_refusal(text, "address.no_brackets")
    if bracketed and not _is_ipv6(host):
        raise _explain_refusal(text, "address.brackets")
    if any(c.isspace() or c in "/@" for c in host):
        raise _explain_refusal(text, "address.character")
    # isascii: isdigit alone also accepts the digits of other scripts.
    if not (port.isascii() and port.isdigit() and len(port) <= 5 and 1 <= int(port) <= 65535):
        raise _explain_refusal(text, "address.port")
    return host, int(port)


def format_address(address: tuple[Any, ...]) -> str:
    """The socket ``address``, host and port first, as :func:`parse_address` reads it."""
    host, port = address[:2]
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


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


def _explain_refusal(text: str, id: str) -> ValueError:
    return ValueError(link_notice("address.none", found=text, why=link_notice(id)))
