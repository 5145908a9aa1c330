import pytest

from links.io import explain_error, is_loopback, parse_address


@pytest.mark.parametrize(
    ("text", "host", "port"),
    [
        ("127.0.0.1:51001", "127.0.0.1", 51001),
        ("localhost:1", "localhost", 1),
        ("drone-7.lab:65535", "drone-7.lab", 65535),
        ("[::1]:14550", "::1", 14550),
        ("[fe80::1%eth0]:14550", "fe80::1%eth0", 14550),
    ],
)
def test_host_and_port_are_told_apart(text: str, host: str, port: int) -> None:
    assert parse_address(text) == (host, port)


@pytest.mark.parametrize(
    "text",
    [
        *("", "127.0.0.1", ":14550", "[]:14550", "[::1]"),
        *map("127.0.0.1:{}".format, ("", "0", "65536", "-5", "+5", " 5", "1_0", "٣", "9" * 5000)),
        *("::1:14550", "[::1:14550", "[127.0.0.1]:14550"),
        *("a..b:14550", ".lab:14550", "a" * 64 + ".lab:14550", "\xe4" * 64 + ":14550"),
        *("a b:14550", "udp://127.0.0.1:14550", "me@host:14550", "127.0.0.1:14550\n"),
    ],
)
def test_what_is_no_address_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(ValueError, match=r"^server: .* is not an address: write host:port such as"):
        parse_address(text, "server")


HERE = ("127.0.0.1", "127.8.9.10", "::1", "localhost", "LOCALHOST", "::ffff:127.0.0.1")
ELSEWHERE = (
    *("0.0.0.0", "::", "192.168.1.2", "128.0.0.1", "::2", "127.1", ""),
    *("localhost.evil.org", "127.0.0.1.evil.org"),
)


@pytest.mark.parametrize(
    ("host", "here"), [*((host, True) for host in HERE), *((host, False) for host in ELSEWHERE)]
)
def test_loopback_alone_is_this_machine(host: str, here: bool) -> None:
    assert is_loopback(host) is here


ONE = "Connect call failed ('127.0.0.1', 9)"
ALL = f"Multiple exceptions: [Errno 111] Connect call failed ('::1', 9, 0, 0), [Errno 111] {ONE}"


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (ConnectionRefusedError(111, ONE), "Connection refused"),
        (OSError(ALL), "Connection refused"),
        (FileNotFoundError(2, "No such file or directory"), "No such file or directory"),
        (OSError("the port has ended"), "the port has ended"),
    ],
)
def test_why_nothing_connects_is_said_in_the_system_s_words(error: OSError, says: str) -> None:
    assert explain_error(error) == says
