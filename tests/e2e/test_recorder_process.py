"""The recorder in its own process: killed, stopped, out of room, never in the flight's way."""

import asyncio
import json
import os
import random
import re
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import msgspec
import pytest

from groundstation.__main__ import main
from groundstation.core.messages import Pose, Sentence, Tick, TickRecord
from groundstation.core.pilot import Pilot
from groundstation.flight import about, recorder
from groundstation.machine import NICE, IdleSlots, RecordingConfig
from groundstation.pose import TlogReader
from groundstation.recording import (
    LineRecord,
    ReceivedRecord,
    RecorderProcess,
    Recording,
    SentRecord,
)
from groundstation.recording.process import BACKLOG_BYTES
from groundstation.settings import Config
from tests.e2e.stations import beside, children_of, line_of, run_command, run_here, served


def a_tick() -> Tick:
    """One command of a pilot on its first pose."""
    config = Config()
    pilot = Pilot(config.vehicle, config.controller, config.flight.coast_s, config.flight.floor_z_m)
    pilot.estimate_state(Pose(0, 0.0, 0.02, (0.0, 0.0, -1.0), (1.0, 0.0, 0.0, 0.0)))
    pilot.follow(config.trajectory.build(), 0.0)
    return pilot.compute_command(0.03)


def the_recording(folder: Path) -> Path:
    (path,) = folder.glob("*.mcap")
    return path


def times(path: Path, topic: str = "/command") -> list[float]:
    return [entry.value()["time_s"] for entry in Recording(path).entries((topic,))]


BESIDE = f"""
import os, select, time
os.nice({NICE})
os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
longest, last = 0.0, time.monotonic()
while not select.select([0], [], [], 0.01)[0]:
    now = time.monotonic()
    longest, last = max(longest, now - last), now
print(longest)
"""
"""A program that stands back as a recorder does and wakes up every 10 ms; at the end of its input
it tells the longest time that it was kept waiting for [s]."""


async def killed_at(moments: list[float], folder: Path) -> list[tuple[float, list[float]]]:
    """Record at 100 Hz to as many recorders at once, and kill each so long after it has begun [s].

    Returns when each was killed, and the times of the commands that were handed to it before.
    """
    loop, tick = asyncio.get_running_loop(), a_tick()

    async def one(after_s: float, own: Path) -> tuple[float, list[float]]:
        process = RecorderProcess(
            RecordingConfig(folder=str(own)), about(Config()), lambda *_: None
        )
        while not any(path.stat().st_size for path in own.glob("*.mcap")):  # noqa: ASYNC240  # a glance
            await asyncio.sleep(0.01)
        handed: list[float] = []
        begun = loop.time()
        while loop.time() < begun + after_s:
            handed.append(loop.time())
            process.give(ReceivedRecord(handed[-1], 0, 0, ("127.0.0.1", 1), b"x" * 90))
            process.give(TickRecord(tick._replace(time_s=handed[-1])))
            await asyncio.sleep(0.01)
        os.kill(process.pid, signal.SIGKILL)
        killed = loop.time()
        await process.close()
        return killed, handed

    return list(
        await asyncio.gather(*(one(after, folder / str(i)) for i, after in enumerate(moments)))
    )


@pytest.mark.tried(1)  # ten of the fifty moments
@pytest.mark.parametrize("batches", [2, 10])
def test_a_kill_at_any_moment_leaves_a_recording_of_all_but_the_last_quarter_of_a_second(
    tmp_path: Path, batches: int
) -> None:
    luck = random.Random(7)
    for batch in range(batches):
        folder = tmp_path / str(batch)
        lost_s, late_s = [], []
        beside = subprocess.Popen(
            [sys.executable, "-c", BESIDE], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        results = asyncio.run(killed_at([luck.uniform(0.0, 2.0) for _ in range(5)], folder))
        waited_s = float(beside.communicate()[0])
        for number, (killed, handed) in enumerate(results):
            path = the_recording(folder / str(number))
            assert len(Recording(path).about["config"]) > 1000
            found = times(path)
            assert found == handed[: len(found)]
            lost_s.append(killed - (found[-1] if found else handed[0]))
            late_s += [b - a for a, b in zip(handed, handed[1:], strict=False)]
        # A busy machine keeps them and this program waiting: a recorder for its input, its encoding
        # and its writing.
        assert max(lost_s) < 0.25 + 3.0 * max(waited_s, *late_s), (lost_s, waited_s, max(late_s))


async def recording_in(folder: Path) -> None:
    while not list(folder.glob("*.mcap")):  # noqa: ASYNC240  # a look at a local folder blocks nobody
        await asyncio.sleep(0.01)


async def talk(folder: Path, script: object, *, limit: int = 0) -> list[str]:
    said: list[str] = []
    process = RecorderProcess(
        RecordingConfig(folder=str(folder)),
        about(Config()),
        lambda sentence, *_: said.append(str(sentence)),
    )
    if limit:
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    assert callable(script)
    await script(process, said)
    await process.close()
    return said


def test_a_full_disk_is_told_of_once_and_leaves_a_recording_that_opens(tmp_path: Path) -> None:
    tick = a_tick()

    async def script(process: RecorderProcess, _: list[str]) -> None:
        process.give(LineRecord(0.0, "tracking", "on the trajectory"))
        for number in range(1700):
            process.give(
                TickRecord(tick._replace(time_s=0.01 * number, flight_time_s=0.01 * number))
            )
            process.give(SentRecord(0.01 * number, 0, None, os.urandom(200)))
        await asyncio.sleep(0.5)

    said = asyncio.run(talk(tmp_path, script, limit=100_000))
    warnings = [line for line in said if line.startswith("WARNING")]
    assert [line.partition(": ")[2].rpartition(": ")[0] for line in warnings] == [
        f"recording has ended, the flight goes on: {path}" for path in [the_recording(tmp_path)]
    ]
    assert re.fullmatch(
        r"error .* cm at most, from \d+ s on of 17.0 s on the trajectory; recorded in part in .*",
        said[-1],
    )
    found = times(the_recording(tmp_path))
    assert found == [0.01 * number for number in range(len(found))]
    assert 100 < len(found) < 1700


def test_a_recorder_that_hangs_never_holds_up_the_loop_and_what_is_left_out_is_counted(
    tmp_path: Path,
) -> None:
    slowest = 0.0

    async def script(process: RecorderProcess, _: list[str]) -> None:
        nonlocal slowest
        await recording_in(tmp_path)
        os.kill(process.pid, signal.SIGSTOP)
        block = b"z" * 100_000
        for number in range(BACKLOG_BYTES // len(block) + 40):
            begun = time.perf_counter()
            process.give(SentRecord(0.001 * number, 0, None, block))
            slowest = max(slowest, time.perf_counter() - begun)
            if number % 20 == 0:
                await asyncio.sleep(0.06)
        os.kill(process.pid, signal.SIGCONT)
        while not await _drained(process):
            pass
        process.give(LineRecord(1.0, "tracking", "again"))

    async def _drained(process: RecorderProcess) -> bool:
        await asyncio.sleep(0.06)
        process.give(LineRecord(0.9, "tracking", "is there room?"))
        return process.waiting == 0

    asyncio.run(talk(tmp_path, script))
    assert slowest < 5.0, "what stands still would have been waited for without end"
    lost = [
        entry.value()["count"] for entry in Recording(the_recording(tmp_path)).entries(("/lost",))
    ]
    assert sum(lost) > 10
    assert Recording(the_recording(tmp_path)).headline().lost == sum(lost)


def test_a_recording_that_somebody_removes_is_told_of_and_not_said_to_be_there(
    tmp_path: Path,
) -> None:
    async def script(process: RecorderProcess, said: list[str]) -> None:
        await recording_in(tmp_path)
        the_recording(tmp_path).unlink()
        while not any("recording has ended" in line for line in said):
            process.give(LineRecord(1.0, "tracking", "on the trajectory"))
            await asyncio.sleep(0.05)

    said = asyncio.run(talk(tmp_path, script))
    assert said[-1].endswith(".mcap: the file was removed")
    assert not any("recorded in" in line for line in said)


def test_the_recorder_is_deaf_to_what_a_terminal_sends(tmp_path: Path) -> None:
    async def script(process: RecorderProcess, _: list[str]) -> None:
        await recording_in(tmp_path)
        assert os.getpgid(process.pid) != os.getpgid(0)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT):
            os.kill(process.pid, number)
        await asyncio.sleep(0.1)
        process.give(LineRecord(1.0, "tracking", "still here"))

    asyncio.run(talk(tmp_path, script))
    assert times(the_recording(tmp_path), "/mission") == [1.0]
    says = Recording(the_recording(tmp_path)).headline().reason
    assert says == "still here, when the ground station died"


def test_a_real_flight_is_recorded_whole_listed_and_flown_again_to_the_last_bit() -> None:
    with served() as room:
        run = run_command(room.station("fly", "--arm", "mqx", "--set", "flight.duration_s=2.5"))
        out = run.stdout
        assert run.returncode == 0, out
        path = the_recording(room.recordings)
        assert f"recording to {path}" in out
        assert re.search(r"\(2\.5\d s were flown\); recorded in " + re.escape(str(path)), out), out
        recording = Recording(path)
        topics = [entry.topic for entry in recording.entries()]
        assert recording.whole
        assert topics.count("/command") > 100
        assert topics.count("/raw/received") > topics.count("/measured") > 150
        assert topics.count("/request") == 0  # it lands by itself, as its time is over
        assert recording.headline().state == "landed"
        again = run_here(main, "replay", path, "--json")
        assert again.returncode == 0, again.stdout + again.stderr
        facts = json.loads(again.stdout)
        assert (facts["identical"], facts["first_difference"]) == (True, None)
        assert facts["commands"] == topics.count("/command")
        names = [
            record.message.get_type()
            for record in TlogReader(path.with_suffix(".tlog").read_bytes())
        ]
        assert names.count("SET_ATTITUDE_TARGET") >= topics.count("/command")
        listed = run_here(main, "logs", room.recordings, "--json")
        (flight,) = json.loads(listed.stdout)["flights"]
        assert (flight["file"], flight["whole"], flight["state"]) == (path.name, True, "landed")


def test_a_flight_lands_although_its_recorder_was_killed() -> None:
    with served() as room:
        words = room.station("fly", "--arm", "mqx", "--set", "flight.duration_s=1.0")
        with beside(words, stdin=subprocess.DEVNULL) as run:
            while "tracking" not in (line := line_of(run)):
                assert line, "the flight ended before its figure"
            (recorder,) = (
                child
                for child in children_of(run.pid)
                if b"groundstation.recording"
                in Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0")
            )
            os.kill(recorder, signal.SIGKILL)
            out, _ = run.communicate(timeout=60)
        assert run.returncode == 0, out
        assert "WARNING: the recorder has died (SIGKILL); the flight goes on" in out
        assert "landed and disarmed" in out
        assert re.search(r"\(1\.0\d s were flown\); not recorded$", out.rstrip()), out
        assert len(list(Recording(the_recording(room.recordings)).entries())) > 10


@pytest.mark.parametrize("enabled", [True, False])
def test_a_flight_without_a_recording_ends_with_its_error_all_the_same(
    tmp_path: Path, *, enabled: bool
) -> None:
    folder = tmp_path / "file"
    folder.write_text("in the place of a folder")
    config = msgspec.structs.replace(
        Config(), recording=RecordingConfig(folder=str(folder / "runs"), enabled=enabled)
    )
    own = Sentence("error", "the error by the flight itself")
    said: list[str] = []

    async def flown() -> None:
        async with recorder(
            config,
            lambda told: said.append(str(told)),
            IdleSlots(),
            describe_tracking_error=lambda: own,
        ) as give:
            if give is not None:
                give(LineRecord(0.0, "tracking", "on the trajectory"))

    asyncio.run(flown())
    assert said[-1] == own.text
    assert (
        any(line.startswith("WARNING: not recording, the flight goes on: ") for line in said)
        == enabled
    )
