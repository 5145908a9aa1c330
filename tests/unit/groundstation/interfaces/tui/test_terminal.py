"""What of a terminal's input is a key that somebody pressed."""

from random import Random

import pytest
from textual.events import AppFocus, Key, Paste

from groundstation.interfaces.tui.terminal import (
    AFTER_S,
    MOST_KEYS,
    PASTE_S,
    WAIT_S,
    InputParser,
    KeyGate,
    find_multiplexer,
)

LETTERS = "abcdefghijklmnop"


def pressed(gate: KeyGate, keys: list[str] | str, now_s: float) -> None:
    for key in keys:
        gate.take(Key(key, None), now_s)


def passed(gate: KeyGate, now_s: float, *, quiet: bool = True) -> list[str]:
    return [one.key for one in gate.release(now_s, quiet=quiet) if isinstance(one, Key)]


@pytest.mark.parametrize("keys", [
    ["ctrl+k", "ctrl+k"],
    list(LETTERS[:MOST_KEYS]),
    [*LETTERS[: MOST_KEYS - 1], "ctrl+k", "ctrl+k", "ctrl+l"],
    ["x"] * 100 + ["ctrl+k", "ctrl+k"],
    [*"rehearsal", "enter"],
    ["ctrl+l", "ctrl+x", "ctrl+a", "ctrl+k", "ctrl+k"] * 10,
])  # fmt: skip
def test_what_a_person_presses_passes_in_its_order_once_it_is_quiet(keys: list[str]) -> None:
    gate = KeyGate()
    pressed(gate, keys, 5.0)
    assert passed(gate, 5.0, quiet=False) == []
    assert passed(gate, 5.02) == keys
    assert gate.dropped == 0 and gate.release(5.04, quiet=True) == []


def test_of_a_paste_no_key_passes_also_where_it_comes_in_pieces() -> None:
    gate = KeyGate()
    for piece in range(10):
        pressed(gate, [*LETTERS[:5], "ctrl+k", "ctrl+k"], 5.0 + 0.001 * piece)
        assert passed(gate, 5.0 + 0.001 * piece, quiet=False) == []
    assert passed(gate, 5.03) == []
    pressed(gate, ["ctrl+l"], 5.1)
    assert passed(gate, 5.12) == []
    assert gate.dropped == 71
    pressed(gate, ["ctrl+k", "ctrl+k"], 5.01 + AFTER_S)
    assert passed(gate, 5.03 + AFTER_S) == ["ctrl+k", "ctrl+k"]


def test_who_goes_on_pressing_after_a_paste_is_heard() -> None:
    """Presses must not make the time longer for which keys are dropped."""
    gate = KeyGate()
    pressed(gate, LETTERS, 5.0)
    heard = passed(gate, 5.02)
    for press in range(1, 10):
        pressed(gate, ["ctrl+k"], 5.0 + 0.1 * press)
        heard += passed(gate, 5.02 + 0.1 * press)
    assert heard == ["ctrl+k"] * 7


def test_a_key_does_not_wait_for_ever_for_what_goes_on_and_the_rest_is_never_dropped() -> None:
    gate = KeyGate()
    gate.take(AppFocus(), 5.0)
    assert len(gate.release(5.0, quiet=False)) == 1
    pressed(gate, "x", 5.0)
    pressed(gate, "x", 5.05)
    assert passed(gate, 5.05, quiet=False) == []
    assert passed(gate, 5.01 + WAIT_S, quiet=False) == ["x", "x"]
    pressed(gate, LETTERS, 6.0)
    gate.take(Paste("text"), 6.0)
    assert [type(one) for one in gate.release(6.02, quiet=True)] == [Paste]


@pytest.mark.parametrize(
    ("environment", "taker"),
    [
        ({}, ""),
        ({"TERM": "xterm-256color"}, ""),
        ({"TERM": "tmux-256color"}, "a multiplexer (TERM=tmux-256color)"),
        ({"TERM": "screen", "STY": "7.lab", "TMUX": "/tmp/tmux"}, "GNU screen ($STY)"),
    ],
)
def test_a_multiplexer_is_known_by_what_it_sets(environment: dict[str, str], taker: str) -> None:
    assert find_multiplexer(environment) == taker


def read(parser: InputParser, data: bytes, now_s: float) -> list[str]:
    return [
        one.key if isinstance(one, Key) else type(one).__name__ for one in parser.read(data, now_s)
    ]


@pytest.mark.parametrize("data", [Random(7).randbytes(3000), b"h\x0c" * 2000])
def test_of_bytes_that_nobody_types_no_key_passes(data: bytes) -> None:
    parser, gate = InputParser(debug=False), KeyGate()
    for message in parser.read(data, 5.0):
        gate.take(message, 5.0)
    assert passed(gate, 5.02) == []
    assert gate.dropped > 1000


@pytest.mark.parametrize(
    "pieces", [[b"\x1b[200~abc"], [b"\x1b[2", b"00~abc"], [b"\x1b[200~a\x1b[201~b\x1b[200~c"]]
)
def test_a_paste_without_an_end_is_ended(pieces: list[bytes]) -> None:
    parser = InputParser(debug=False)
    for piece in pieces:
        read(parser, piece, 5.0)
    assert read(parser, b"\x0b", 5.5) == []
    assert read(parser, b"", 5.0 + PASTE_S) == ["Paste"]
    assert parser.cut == 1
    assert read(parser, b"\x0b\x0b", 6.5) == ["ctrl+k", "ctrl+k"]


def test_a_paste_with_its_end_is_one_and_nothing_is_ended_later() -> None:
    parser = InputParser(debug=False)
    assert read(parser, b"\x1b[200~abc\x1b[2", 5.0) == []
    assert read(parser, b"01~", 5.01) == ["Paste"]
    assert read(parser, b"", 7.0) == []
    assert parser.cut == 0


def test_what_the_parser_fails_at_does_not_end_it() -> None:
    parser = InputParser(debug=False)
    assert read(parser, b"\xe9x\x1b[99999999999u", 5.0) == ["replacement_character", "x"]
    assert read(parser, b"\x0b", 5.1) == ["ctrl+k"]
