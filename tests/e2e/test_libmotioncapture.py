"""Poses by libmotioncapture: its mock back end in a child process, restarted when it ends."""

import asyncio
import os
import signal
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from groundstation.config import ConfigError, from_dict
from groundstation.core.messages import Others, Pose, SourceError
from groundstation.interfaces.service import require_flyable
from groundstation.pose.sources import LibmotioncaptureConfig, libmotioncapture
from groundstation.settings import Config
from tests.loops import until

pytest.importorskip(
    "motioncapture",
    reason="left out: libmotioncapture is not tried, no wheel of motioncapture for this machine",
)

BODIES = "quad(1,2,3,1,0,0,0);wand(0,-1,0.5,1,0,0,0)"
MOCK = LibmotioncaptureConfig(
    backend="mock",
    options={"frequency": "100", "rigid_bodies": BODIES},
    world="nwu",
    body="flu",
    latency_s=0.01,
)


def run(
    work: Callable[[Any, list[Pose]], Awaitable[None]], config: LibmotioncaptureConfig = MOCK
) -> Any:
    """The source, after it was started, has done ``work`` with the poses, and was closed."""
    source, poses = config.build(Others(("wand",))), list[Pose]()

    async def main() -> None:
        await source.start(poses.append)
        try:
            await work(source, poses)
        finally:
            await source.close()

    asyncio.run(main())
    return source


def counts(source: Any, lost: int) -> bool:
    """Whether so many children are counted as lost."""
    return bool(source.status.dropped.get("child_lost", 0) == lost)


def test_its_poses_come_in_our_axes_stamped_as_the_library_gave_them_less_the_told_latency() -> (
    None
):
    async def work(source: Any, poses: list[Pose]) -> None:
        await until(lambda: len(poses) > 50)
        for pose in poses:
            assert pose.position_ned == pytest.approx((1.0, -2.0, -3.0), abs=1e-6)
            assert 0.01 - 1e-9 <= pose.arrival_s - pose.time_s < 0.5
        assert [pose.id for pose in poses] == list(range(len(poses)))
        children.append(source._child.pid)

    children: list[int] = []
    source = run(work)
    assert not Path(f"/proc/{children[0]}").exists(), "no child is left behind"
    assert source.status.dropped == {}
    assert source.status.accepted > 50


def test_a_child_that_dies_and_one_that_hangs_are_started_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(libmotioncapture, "REOPEN_S", 0.05)
    monkeypatch.setattr(libmotioncapture, "NEWS_S", 1.0)

    async def work(source: Any, poses: list[Pose]) -> None:
        for lost, hit in enumerate((signal.SIGKILL, signal.SIGSTOP), 1):
            await until(lambda: len(poses) > 5)
            os.kill(source._child.pid, hit)
            await until(partial(counts, source, lost))
            poses.clear()
        await until(lambda: len(poses) > 5)

    assert set(run(work).status.dropped) == {"child_lost"}


def test_a_server_that_does_not_answer_is_a_sentence_though_the_library_waits_for_ever(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(libmotioncapture, "ANSWER_S", 1.0)

    async def work(source: Any, poses: list[Pose]) -> None:
        raise AssertionError("nobody serves there")

    with pytest.raises(SourceError, match=r"the optitrack server at 127\.0\.0\.1 does not answer"):
        run(work, LibmotioncaptureConfig(backend="optitrack"))


def test_bodies_that_are_made_up_never_fly_a_vehicle() -> None:
    pose = {"kind": "libmotioncapture", "backend": "mock"}
    with pytest.raises(ConfigError, match=r"pose\.backend: .*never fly"):
        require_flyable(from_dict({"pose": pose}, Config))


NOISY = """
import os, time
from types import SimpleNamespace as Record


class Noisy:
    def waitForNextFrame(self):
        os.write(1, b"a frame\\n")  # as std::cout of a back end does
        time.sleep(0.01)

    @property
    def rigidBodies(self):
        turn = Record(w=1.0, x=0.0, y=0.0, z=0.0)
        return {"quad": Record(position=(1.0, time.monotonic() % 1.0, 3.0), rotation=turn)}


def connect(backend, options):
    os.write(1, b"Using unicast from server 127.0.0.1:1511\\n")
    if options["hostname"] == "127.0.0.9":
        time.sleep(60.0)
    return Noisy()
"""


@pytest.fixture
def noisy_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "motioncapture.py").write_text(NOISY, "utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))


@pytest.mark.usefixtures("noisy_library")
def test_what_the_library_prints_is_no_frame_and_no_connection(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def work(source: Any, poses: list[Pose]) -> None:
        await until(lambda: len(poses) > 20)

    assert run(work, LibmotioncaptureConfig(backend="optitrack")).status.dropped == {}
    monkeypatch.setattr(libmotioncapture, "ANSWER_S", 3.0)
    with pytest.raises(SourceError, match=r"the optitrack server at 127\.0\.0\.9 does not answer"):
        run(work, LibmotioncaptureConfig(backend="optitrack", hostname="127.0.0.9"))
