"""Network addresses as the operator writes them: ``host:port``, with IPv6 hosts in brackets.

Sans-IO.
"""

import ipaddress
import re
from typing import Any

from links.text import link_notice

_ADDRESS = re.compile(r"(?:\[(?P<ipv6>[^\]\s]+)\]|(?P<host>[^\s:/@\[\]]+)):(?P<port>[0-9]{1,5})")


def parse_address(text: str, key: str = "") -> tuple[str, int]:
    """Return host and port of ``127.0.0.1:51001``, ``localhost:51001`` or ``[::1]:51001``.

    The host is not looked up. IPv6 hosts come back without their brackets.

    Raises:
        ValueError: the text is no such address. The message says how to write one; it begins with
            the configuration's ``key``, if there is one.
    """
    found = _ADDRESS.fullmatch(text)
    if (
        found is None
        or not 1 <= int(found["port"]) <= 65535
        or not (_is_name(found["host"]) if found["host"] else _is_ipv6(found["ipv6"]))
    ):
        says = link_notice("address.none", found=text)
        raise ValueError(f"{key}: {says}" if key else says)
    return found["host"] or found["ipv6"], int(found["port"])


def format_address(address: tuple[Any, ...]) -> str:
    """Return the socket ``address`` (host, port, ...) as :func:`parse_address` reads it."""
    host, port = address[:2]
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def is_loopback(host: str) -> bool:
    """Return whether ``host`` can only be this machine: ``localhost`` or a loopback IP address.

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


def remote_setting(key: str, address: str) -> str | None:
    """Return ``key = address`` where the address may be another machine's; None on loopback."""
    return None if is_loopback(parse_address(address)[0]) else f"{key} = {address}"


def _is_name(host: str) -> bool:
    """Return whether ``host`` can be looked up: its labels have 1 to 63 characters (RFC 1035)."""
    try:
        host.encode("idna")
    except UnicodeError:
        return False
    return True


def _is_ipv6(host: str) -> bool:
    try:
        ipaddress.IPv6Address(host)
    except ValueError:
        return False
    return True
