"""Lines that nobody has to wait for."""

import os
import pty
import time
from pathlib import Path

from groundstation.machine import NonBlockingWriter
from groundstation.machine.outlets import LINE_MAX_BYTES


def test_lines_come_out_as_they_were_said() -> None:
    reading, writing = os.pipe()
    outlet = NonBlockingWriter(writing)
    outlet.say("one")
    outlet.say("zwei ü")
    assert os.read(reading, 4096).decode() == "one\nzwei ü\n"
    assert outlet.lost == 0


def test_a_full_pipe_loses_lines_and_tells_how_many_once_it_is_read() -> None:
    reading, writing = os.pipe()
    outlet = NonBlockingWriter(writing)
    for number in range(100):
        outlet.say(f"{number} " + "x" * 2000)
    assert outlet.lost > 50
    held = os.read(reading, 1 << 20).decode().splitlines()
    assert [line.split()[0] for line in held] == [str(number) for number in range(len(held))]
    outlet.say("after")
    assert os.read(reading, 1 << 20).decode() == f"{100 - len(held)} lines were lost: nobody read them\nafter\n"


def test_a_terminal_that_is_held_by_control_s_is_not_waited_for() -> None:
    ours, theirs = pty.openpty()
    outlet = NonBlockingWriter(theirs)
    outlet.say("before")
    os.write(ours, b"\x13")  # Ctrl-S
    begun = time.monotonic()
    for number in range(2000):
        outlet.say(f"{number} while it stands still")
    assert time.monotonic() - begun < 5.0
    assert outlet.lost > 0
    os.write(ours, b"\x11")  # Ctrl-Q
    os.set_blocking(ours, False)
    shown, until = "", time.monotonic() + 60.0
    while "after" not in shown and time.monotonic() < until:
        try:
            shown += os.read(ours, 1 << 16).decode().replace("\r\n", "\n")
        except BlockingIOError:
            outlet.say("after")
    assert shown.startswith("before\n")
    assert "lines were lost" in shown
    for line in shown.splitlines():
        assert line in ("before", "after", "^S", "^Q") or line.endswith(("stands still", "nobody read them"))
    assert os.get_blocking(theirs)  # whoever shares it waits as before


def test_a_reader_that_has_gone_and_a_descriptor_that_is_closed_are_borne(tmp_path: Path) -> None:
    reading, writing = os.pipe()
    outlet = NonBlockingWriter(writing)
    os.close(reading)
    outlet.say("nobody")
    os.close(writing)
    outlet.say("nothing")
    NonBlockingWriter(writing).say("nothing at all")
    with (tmp_path / "file").open("w") as file:
        kept = NonBlockingWriter(file.fileno())
        kept.say("x" * 2 * LINE_MAX_BYTES)
        kept.say("y")
    first, second = (tmp_path / "file").read_text().splitlines()
    assert (len(first), second) == (LINE_MAX_BYTES - 1, "y")
