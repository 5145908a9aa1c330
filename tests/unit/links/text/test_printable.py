"""Words of others reach the screen as letters: nothing steers the terminal or forges a line."""

import argparse
import os
import sys
import types
from typing import Any

import pytest

from groundstation.config import ConfigError
from groundstation.machine import NonBlockingWriter
from groundstation.runtime import entry
from links.mavlink.protocol import AutopilotTexts, MavlinkCodec
from links.text import printable

HOSTILE = {
    "window title": "\x1b]0;owned\x07",
    "clear": "\x1b[2J",
    "a line of ours": "x\r12.3 landed: all is well",
    "line feed": "x\n12.3 landed: all is well",
    "C1": "\x9b2J\x9d0;owned\x9c",
    "DEL and backspace": "x\x7f\x08\x08",
    "bidi": "\u202eevil\u2066\u200f",
    "separators": "a\u2028b\u2029c\x85d",
    "zero width": "la\u200bnd\ufeff",
}


def is_safe(text: str) -> bool:
    return all(letter.isprintable() for letter in text)


@pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE)
def test_what_is_no_visible_letter_becomes_a_dot(text: str) -> None:
    made = printable(text)
    assert is_safe(made)
    assert len(made) == len(text)
    assert "·" in made


def test_letters_of_every_script_stay() -> None:
    assert printable("ü 飛行 ρ² “ok” 🚁") == "ü 飛行 ρ² “ok” 🚁"
    assert printable("a\tb\nc\x1b", keep="\n\t") == "a\tb\nc·"


@pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE)
def test_an_autopilots_words_are_letters_from_the_wire_on(text: str) -> None:
    autopilot, station, words = MavlinkCodec(1, 1), MavlinkCodec(245, 190), AutopilotTexts()
    made = autopilot.dialect.MAVLink_statustext_message(3, text.encode())
    for message in station.feed(autopilot.pack(made)):
        words.take_message(message)
    assert words.newest
    assert is_safe(words.newest)
    assert is_safe(words.complaints())


@pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE)
def test_what_a_flight_says_is_one_line_of_letters(text: str) -> None:
    heard, said = os.pipe()
    try:
        NonBlockingWriter(said).say(f"3.2 arming refused: “{text}”")
        line = os.read(heard, 4096).decode()
    finally:
        os.close(heard)
        os.close(said)
    assert line.endswith("”\n")
    assert is_safe(line[:-1])


def _program(monkeypatch: pytest.MonkeyPatch, does: Any) -> int:
    """A program of one command, run as ours are."""
    monkeypatch.setitem(sys.modules, "hostile_commands", types.ModuleType("hostile_commands"))
    monkeypatch.setattr(sys.modules["hostile_commands"], "show", does, raising=False)
    monkeypatch.setattr(sys, "argv", ["program", "show"])

    def parser() -> argparse.ArgumentParser:
        made = argparse.ArgumentParser(prog="program")
        made.add_subparsers(dest="command").add_parser("show")
        return made

    return entry.run(parser, "hostile_commands")


@pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE)
def test_no_command_prints_anything_else_whatever_it_quotes(
    text: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def show(_: object) -> int:
        print(f"flights: {text}")
        raise ConfigError("LOG", f"no recording: {text}")

    before = sys.stdout
    assert _program(monkeypatch, show) == 2
    assert sys.stdout is before
    out, err = capsys.readouterr()
    assert is_safe(out.replace("\n", ""))
    assert is_safe(err.replace("\n", ""))
    assert out.startswith("flights: ")
    assert err.startswith("program: LOG: no recording: ")


def test_what_draws_with_escapes_of_its_own_still_can(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def show(_: object) -> int:
        entry.raw_stream(sys.stdout).write("\x1b[1mbold\x1b[0m\n")
        print("a\tb", file=sys.stdout)
        return 0

    assert _program(monkeypatch, show) == 0
    assert capsys.readouterr().out == "\x1b[1mbold\x1b[0m\na\tb\n"
    assert entry.raw_stream(sys.stdout) is sys.stdout
