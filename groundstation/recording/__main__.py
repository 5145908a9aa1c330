"""Recorder process: records from standard input to the file, notices to standard output.

It is deaf to signals that a terminal sends, and ends when its input ends: told to, or because the
flight died. It shares the processor with the flight that has started it: it gets its share, and
never first.
"""

import contextlib
import os
import select
import signal
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import msgspec

from groundstation.core.messages import LEAST_JUDGED_S, STEADY_S, Sentence, notice
from groundstation.machine import NICE, free_name, make_folder, tidy
from groundstation.recording.headline import FlightHeadline
from groundstation.recording.process import FORGET, PIPE_BYTES, RecorderSetup
from groundstation.recording.records import Record
from groundstation.recording.writer import FLUSH_S, FlightLog


def stand_back() -> None:
    """Let the flight go first, as far as the system has means for it."""
    os.nice(NICE)
    # Woken up by the flight's writing, it must not take the processor from it.
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))


SYNC_S = 1.0
"""Written data must reach the disk itself within this time, or the operator is told [s]."""


def main() -> None:
    """Record until the input ends, or nothing more can be recorded, of which the flight is told."""
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM, signal.SIGQUIT, signal.SIGTSTP):
        signal.signal(number, signal.SIG_IGN)
    stand_back()
    log: FlightLog | None = None
    forget = False
    synced_s = time.monotonic()
    beside, syncing = ThreadPoolExecutor(1), Future[None]()
    syncing.set_result(None)
    decoder = msgspec.msgpack.Decoder(Record)
    try:
        for message in _messages():
            if not message:
                if log is not None:
                    log.flush()
            elif message == FORGET:
                forget = True
            elif log is None:
                log = _open_log(msgspec.msgpack.decode(message, type=RecorderSetup))
            else:
                log.write(decoder.decode(message))
            if log is not None and syncing.done() and time.monotonic() - synced_s > SYNC_S:
                # A busy disk takes seconds: what comes meanwhile is written on.
                syncing = beside.submit(log.sync)
                synced_s = time.monotonic()
    except OSError as error:
        where = "" if error.filename is None else f"{error.filename}: "
        _tell(notice("recording.not", why=f"{where}{error.strerror or error}"))
    finally:
        beside.shutdown()
        if log is not None:
            log.flush()
            log.sync()
            is_removed, has_ended = log.is_removed, log.has_ended
            log.close()
            if forget:
                _forget(log.path)
            elif not is_removed:  # else the flight tells its figures, as not recorded
                _tell_figures(
                    log.path, log.headline, "recorded in part" if has_ended else "recorded"
                )


def _forget(path: Path) -> None:
    """Remove a recording of nothing."""
    for file in (path, path.with_suffix(".tlog")):
        with contextlib.suppress(OSError):
            file.unlink(missing_ok=True)
    _tell(notice("recording.forgotten", name=path.name))


def _tell_figures(path: Path, headline: FlightHeadline, recorded: str) -> None:
    """Tell the figures of a flight that is over, and where and how far it is ``recorded``.

    Why a part is missing has been told.
    """
    if headline.rms_m is None or headline.max_m is None:
        told = notice(
            "recording.short",
            flown_s=headline.flown_s,
            least_s=LEAST_JUDGED_S,
            recorded=recorded,
            path=path,
        )
    else:
        told = notice(
            "recording.figures",
            flown_s=headline.flown_s,
            from_s=STEADY_S,
            rms_cm=100.0 * headline.rms_m,
            max_cm=100.0 * headline.max_m,
            recorded=recorded,
            path=path,
        )
    _tell(told)


def _messages() -> Iterator[bytes]:
    """Each message as it comes; an empty one wherever nothing has come for a while."""
    pending = bytearray()
    while True:
        if not select.select([0], [], [], FLUSH_S)[0]:
            yield b""
            continue
        data = os.read(0, PIPE_BYTES)
        if not data:
            return
        pending += data
        start = 0
        while len(pending) - start >= 4:
            end = start + 4 + int.from_bytes(pending[start : start + 4], "little")
            if end > len(pending):
                break
            yield bytes(pending[start + 4 : end])
            start = end
        del pending[:start]


def _open_log(setup: RecorderSetup) -> FlightLog:
    """The log, in its folder, where what is no longer kept makes room first."""
    config, folder = setup.recording, make_folder(setup.recording)
    now = time.time()
    for path in tidy(config, now):
        _tell(notice("recording.tidied", name=path.name))
    local = time.localtime(now)
    path = free_name(folder, time.strftime("%Y%m%d-%H%M%S", local), setup.about.vehicle)
    about = msgspec.structs.replace(
        setup.about, started=time.strftime("%Y-%m-%dT%H:%M:%S%z", local)
    )
    # The event loop's clock is CLOCK_MONOTONIC, the same in every process of this machine.
    log = FlightLog(path, about, epoch_ns=time.time_ns() - time.monotonic_ns(), tell=_tell)
    _tell(notice("recording.begins", path=path))
    return log


def _tell(sentence: Sentence) -> None:
    """Tell the operator, through the flight, if it still listens."""
    with contextlib.suppress(OSError):
        os.write(1, msgspec.json.encode(sentence) + b"\n")


if __name__ == "__main__":
    main()
