"""A serial port, opened raw and without waiting: 8 data bits, no parity, 1 stop bit, no flow control.

Written on termios rather than pyserial: bytes come by the event loop's own reader, no thread and no dependency.
Every failure is an OSError whose words fit a person.
"""

import contextlib
import fcntl
import os
import struct
import termios
from pathlib import Path

STANDARD = (9600, 19200, 38400, 57600, 115200, 230400, 460800, 500000, 921600, 1000000, 1500000, 2000000)
"""Baud rates that every Linux knows by name."""


def open_port(path: str, baud: int) -> int:
    """The descriptor of the port at ``path``, at ``baud`` bit/s; nobody else may open it meanwhile.

    Raises:
        OSError: it can't be opened, is no serial port, is in use, or does not do ``baud``.
    """
    speed = getattr(termios, f"B{baud}", None)
    if speed is None:
        raise OSError(f"a port can't do {baud} baud: expected one of {STANDARD}")
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        if not os.isatty(fd):
            raise OSError(f"{path} is no serial port")
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        fcntl.ioctl(fd, termios.TIOCEXCL)
        cc = termios.tcgetattr(fd)[6]
        cc[termios.VMIN], cc[termios.VTIME] = 0, 0
        cflag = termios.CS8 | termios.CREAD | termios.CLOCAL
        termios.tcsetattr(fd, termios.TCSANOW, [0, 0, cflag, 0, speed, speed, cc])
        termios.tcflush(fd, termios.TCIOFLUSH)  # what was sent to, or by, whoever had it before
    except BlockingIOError:
        os.close(fd)
        raise OSError(f"another program has {path} open") from None
    except termios.error as error:
        os.close(fd)
        raise OSError(f"{path} takes no settings ({error.args[-1]})") from None
    except OSError:
        os.close(fd)
        raise
    return fd


def is_pseudo_terminal(path: str) -> bool:
    """True where a program of this machine must be at the other end of ``path``, and no module can be."""
    return str(Path(path).resolve()).startswith("/dev/pts/")


def waiting(fd: int) -> int:
    """Bytes that were written and have not left yet; 0 where the port can't tell."""
    try:
        count: int = struct.unpack("i", fcntl.ioctl(fd, termios.TIOCOUTQ, b"\0\0\0\0"))[0]
    except OSError:
        return 0
    return count


def close_port(fd: int) -> None:
    """Close it; what waits in it never leaves."""
    with contextlib.suppress(termios.error, OSError):  # unplugged: there is nothing left in it
        termios.tcflush(fd, termios.TCIOFLUSH)
    os.close(fd)
