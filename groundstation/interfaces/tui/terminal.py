"""Terminal input: no paste or line noise orders anything, or takes the kill key away.

Terminals mark what is pasted; a paste without these marks (a serial line, an old terminal, line
noise) looks like keys. It is told from them by how many different ones come at once, and dropped: a
key waits until nothing follows it.
"""

import codecs
import io
import os
import selectors
from collections.abc import Iterator, Mapping

from textual._xterm_parser import BRACKETED_PASTE_END, BRACKETED_PASTE_START, XTermParser
from textual.drivers.linux_driver import LinuxDriver
from textual.events import Key, Paste
from textual.message import Message

from groundstation.core.messages import Sentence, notice
from groundstation.interfaces.tui.model import STOP_KEYS
from links.text import printable

MOST_KEYS = 10
"""A paste has more keys at once than this; a slow connection may hold back the word "rehearsal",
and Enter."""
QUIET_S = 0.02
"""Keys between which it is never quiet for so long come at once [s]."""
WAIT_S = 0.1
"""No key waits longer [s]."""
AFTER_S = 0.3
"""Keys are dropped for this long after a paste, too: the rest of it may come late [s]."""
PASTE_S = 1.0
"""Text after a paste's mark counts as the paste for at most this long [s], with or without the mark
of its end."""


class KeyGate:
    """Passes on what is pressed, in its order, and drops the keys of a paste.

    A key that repeats counts once, for a person may hold it down; those that stop a vehicle do not
    count, for a person may hammer on them while the connection stands still.
    """

    def __init__(self) -> None:
        """Nothing was pressed yet."""
        self.dropped = 0
        """Keys since this was last set to 0."""
        self._held: list[Message] = []
        self._held_s = 0.0
        self._count, self._before = 0, ""
        self._drops_until_s = 0.0

    def take(self, message: Message, now_s: float) -> None:
        """One more key, or whatever else a terminal tells."""
        if not self._held:
            self._held_s = now_s
        self._held.append(message)
        if isinstance(message, Key):
            self._count += message.key != self._before and message.key not in STOP_KEYS
            self._before = message.key
            if self._count > MOST_KEYS:
                self._drops_until_s = now_s + AFTER_S

    def release(self, now_s: float, *, quiet: bool) -> list[Message]:
        """Return the messages to pass on now; ``quiet``: nothing came for QUIET_S."""
        if quiet:
            self._count, self._before = 0, ""
        elif now_s - self._held_s < WAIT_S and any(isinstance(one, Key) for one in self._held):
            return []
        held, self._held = self._held, []
        if now_s >= self._drops_until_s:
            return held
        others = [one for one in held if not isinstance(one, Key)]
        self.dropped += len(held) - len(others)
        return others

    def is_dropping(self, now_s: float) -> bool:
        """Whether a paste is under way, or was just now."""
        return now_s < self._drops_until_s


class InputParser:
    """Textual's own, which survives garbage, and which no paste without an end keeps."""

    def __init__(self, debug: bool) -> None:
        """``debug``: Textual shall write what it reads into a file."""
        self._debug = debug
        self._parser = XTermParser(debug)
        self._decoder = codecs.getincrementaldecoder("utf-8")(errors="replace")
        self._tail = ""
        self._paste_s: float | None = None
        self.cut = 0
        """Pastes that had to be ended since this was last set to 0."""

    def read(self, data: bytes, now_s: float) -> Iterator[Message]:
        """Yield the messages in ``data`` and earlier bytes; called often, also without data."""
        text = self._decoder.decode(data)
        if text:
            seen = self._tail + text
            self._tail = seen[1 - len(BRACKETED_PASTE_START) :]
            yield from self._feed(text)
            if self._paste_s is None and seen.rfind(BRACKETED_PASTE_START) > seen.rfind(
                BRACKETED_PASTE_END
            ):
                self._paste_s = now_s
        yield from self._parser.tick()
        if self._paste_s is not None and now_s - self._paste_s >= PASTE_S:
            for message in self._feed(BRACKETED_PASTE_END):
                self.cut += isinstance(message, Paste)
                yield message
            self._paste_s = None

    def _feed(self, text: str) -> Iterator[Message]:
        try:
            for message in self._parser.feed(text):
                if isinstance(message, Paste):  # the parser knows best when a paste has ended
                    self._paste_s = None
                yield message
        except (ValueError, OverflowError):  # for example a key of a number that no character has
            self._parser, self._paste_s = XTermParser(self._debug), None


class TolerantDriver(LinuxDriver):
    """Textual's own, which reads the keys that a person pressed while the terminal is there."""

    def run_input_thread(self) -> None:
        """Wait for input until told to end, and pass it on."""
        parser, gate = InputParser(self._debug), KeyGate()
        since_s = 0.0
        with selectors.SelectSelector() as selector:
            selector.register(self.fileno, selectors.EVENT_READ)
            while not self.exit_event.is_set():
                came = selector.select(QUIET_S)
                data = os.read(self.fileno, io.DEFAULT_BUFFER_SIZE) if came else b""
                if came and not data:
                    return  # the terminal is gone
                now_s = self._loop.time()
                for message in parser.read(data, now_s):
                    gate.take(message, now_s)
                for message in gate.release(now_s, quiet=not came):
                    self.process_message(message)
                if not gate.dropped:
                    since_s = now_s
                elif not gate.is_dropping(now_s) or now_s - since_s >= PASTE_S:
                    self._warn(notice("screen.paste", count=gate.dropped))
                    gate.dropped = 0
                if parser.cut:
                    self._warn(notice("screen.paste_open"))
                    parser.cut = 0

    def _warn(self, says: Sentence) -> None:
        self._app.notify(says.text, severity="error", markup=False)


MULTIPLEXERS = {"STY": "GNU screen", "TMUX": "tmux", "ZELLIJ": "Zellij"}
"""Environment variable that a terminal multiplexer sets → its name."""
MULTIPLEXED_TERMS = ("screen", "tmux")
"""Beginnings of TERM in a multiplexer; ssh hands TERM on, but not the variables above."""


def find_multiplexer(environment: Mapping[str, str]) -> str:
    """Return the program that may take keys before they come here; empty where none is known."""
    for variable, name in MULTIPLEXERS.items():
        if environment.get(variable):
            return f"{name} (${variable})"
    term = environment.get("TERM", "")
    return f"a multiplexer (TERM={printable(term)})" if term.startswith(MULTIPLEXED_TERMS) else ""
