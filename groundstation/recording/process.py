"""The recorder in a process of its own, as the flight sees it: records go into a pipe, and nothing
ever waits.
"""

import asyncio
import fcntl
import os
import subprocess
from contextlib import suppress

import msgspec

from groundstation.core.messages import Say, Sentence, notice
from groundstation.machine import IdleSlots, RecordingConfig
from groundstation.recording.records import About, LossRecord, Record
from links.io import describe_exit, start_child

PIPE_BYTES = 1 << 20
"""Size of the pipe, where the system allows it: several seconds of flight."""
BACKLOG_BYTES = 8 << 20
"""At most this much waits beyond the pipe; what comes then is left out, and counted."""
GATHER_S = 0.03
"""Records wait for one another for so long [s], so that the recorder wakes up less often than the
flight does; then for a quiet moment, which comes with the next command."""
FORGET = b"forget"
"""A message: the recording is not worth keeping."""
ERROR_NOTICES = ("recording.figures", "recording.short")
"""Notices with which the recorder tells the error of a flight that is over."""
END_S = 5.0
"""Timeout for the recorder to write its end [s]."""


class RecorderSetup(msgspec.Struct, frozen=True):
    """The first message."""

    recording: RecordingConfig
    about: About


class RecorderProcess:
    """Begins to record as it is made; belongs to one event loop."""

    def __init__(
        self, config: RecordingConfig, about: About, say: Say, quiet: IdleSlots | None = None
    ) -> None:
        """Start the process; ``say`` takes what it tells the operator.

        Records are handed over when it is ``quiet``.
        """
        self._say = say
        self._quiet = quiet or IdleSlots()
        self._loop = asyncio.get_running_loop()
        self._encoder = msgspec.msgpack.Encoder()
        self._backlog = bytearray()
        self._lost = 0
        self._given: list[Record] = []
        self._timer: asyncio.TimerHandle | None = None
        self._moment: asyncio.Future[None] | None = None
        self._told = False
        self.has_told_error = False
        """Whether the recorder has told the operator the flight's error, or that it was too short
        for one."""
        self._gone = self._loop.create_future()
        self._words = b""
        self._process = start_child(
            "groundstation.recording", stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        assert self._process.stdin is not None and self._process.stdout is not None, (
            "both are pipes"
        )
        self._in, self._out = self._process.stdin.fileno(), self._process.stdout.fileno()
        os.set_blocking(self._in, False)
        os.set_blocking(self._out, False)
        with suppress(OSError):  # not allowed so much: the backlog has room
            fcntl.fcntl(self._in, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
        self._loop.add_reader(self._out, self._listen)
        self._add(RecorderSetup(config, about))
        self._hand_over()

    @property
    def pid(self) -> int:
        """The number of the recorder's process."""
        return self._process.pid

    @property
    def waiting(self) -> int:
        """Bytes that the pipe has not taken yet."""
        return len(self._backlog)

    def give(self, record: Record) -> None:
        """Take one record. Never waits, never raises; whatever it costs comes later."""
        self._given.append(record)
        if self._timer is None and self._moment is None:
            self._timer = self._loop.call_later(GATHER_S, self._await_quiet)

    def _await_quiet(self) -> None:
        """Enough for once: hand it over as soon as that delays no command."""
        self._timer = None
        self._moment = self._quiet.moment()
        self._moment.add_done_callback(self._hand_over_now)

    def _hand_over_now(self, moment: "asyncio.Future[None]") -> None:
        if not moment.cancelled():
            self._hand_over()

    def _call_off(self) -> None:
        """Wait for nothing any more."""
        if self._timer is not None:
            self._timer.cancel()
        if self._moment is not None:
            self._moment.cancel()
        self._timer = self._moment = None

    def _pack(self) -> None:
        """Make bytes of what was given."""
        given, self._given = self._given, []
        for record in given:
            if len(self._backlog) > BACKLOG_BYTES:
                self._lost += 1
                continue
            self._admit()
            try:
                self._add(record)
            except (TypeError, ValueError, OverflowError, msgspec.MsgspecError) as error:
                self._lost += 1  # a controller of the user's own may put anything into a tick
                if not self._told:
                    self._told = True
                    self._say(notice("recording.unrecordable", why=error))

    def _admit(self) -> None:
        """Say how many records are missing here."""
        if self._lost:
            self._add(LossRecord(self._loop.time(), self._lost))
            self._lost = 0

    async def close(self, *, keep: bool = True) -> None:
        """Hand over what is left and wait until all is written, but not for ever.

        Or have it all removed.
        """
        with suppress(TimeoutError):
            async with asyncio.timeout(END_S):
                self._hand_over()
                while self._backlog and not self._gone.done():
                    await asyncio.sleep(0.01)
                    self._hand_over()
                self._admit()
                if not keep:
                    self._backlog += len(FORGET).to_bytes(4, "little") + FORGET
                self._hand_over()
                self._end_of_pipe()
                await asyncio.shield(self._gone)
        self._end_of_pipe()
        self._call_off()
        if not self._gone.done():
            self._close_out()
            self._say(notice("recording.still_writing"))

    def _add(self, message: RecorderSetup | Record) -> None:
        data = self._encoder.encode(message)
        self._backlog += len(data).to_bytes(4, "little")
        self._backlog += data

    def _hand_over(self) -> None:
        """All that was given, as far as the pipe takes it."""
        self._call_off()
        self._pack()
        if self._gone.done():
            self._backlog.clear()
            return
        try:
            while self._backlog:
                del self._backlog[: os.write(self._in, self._backlog)]
        except BlockingIOError:
            self._timer = self._loop.call_later(GATHER_S, self._await_quiet)
        except OSError:  # what it said on its way out comes by the other pipe
            self._backlog.clear()

    def _end_of_pipe(self) -> None:
        if self._process.stdin is not None and not self._process.stdin.closed:
            with suppress(OSError):
                self._process.stdin.close()

    def _close_out(self) -> None:
        self._loop.remove_reader(self._out)
        if self._process.stdout is not None:
            self._process.stdout.close()

    def _listen(self) -> None:
        """Whatever it tells, and its end."""
        try:
            data = os.read(self._out, 65536)
        except BlockingIOError:
            return
        *lines, self._words = (self._words + data).split(b"\n")
        for line in lines:
            sentence = msgspec.json.decode(line, type=Sentence)
            self.has_told_error = self.has_told_error or sentence.id in ERROR_NOTICES
            self._say(sentence)
        if not data:
            code = self._process.wait()  # its end of the pipe closes with its last breath
            self._close_out()
            if code:
                self._say(notice("recording.died", how=describe_exit(code)))
            self._gone.set_result(None)
