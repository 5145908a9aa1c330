"""Campaigns on a Dask cluster: the same rows as here, and never those of another program."""

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from sim.__main__ import main
from sim.scenarios import SCENARIOS, prepare
from sim.studies.campaign import Campaign, CampaignRow, Cluster, Local, run
from tests.known import known

pytestmark = pytest.mark.real_time

SEEDS = range(3)


def _campaign() -> Campaign:
    world, config = prepare(SCENARIOS["adverse"], [])
    return Campaign(scenario="adverse", world=world, config=config, duration_s=16.1, overrides=[])


@pytest.fixture(scope="module")
def rows() -> list[CampaignRow]:
    return run(_campaign(), SEEDS, Local(1))[0]


@contextmanager
def _process(*words: str, ready: str) -> Iterator[tuple[re.Match[str], "subprocess.Popen[str]"]]:
    """A process that is up once a line of its log matches ``ready``."""
    environment = {"DASK_DISTRIBUTED__WORKER__DAEMON": "False", "PYTHONUNBUFFERED": "1"}
    command, null = [sys.executable, *words], subprocess.DEVNULL
    process = subprocess.Popen(
        command, stderr=subprocess.PIPE, stdout=null, text=True, env=os.environ | environment
    )
    try:
        lines = []
        for line in known(process.stderr):
            lines.append(line)
            if (match := re.search(ready, line)) is not None:
                yield match, process
                return
        pytest.fail("".join(lines))
    finally:
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=120)


@contextmanager
def _scheduler() -> Iterator[str]:
    words = ("-m", "distributed.cli.dask_scheduler", "--no-dashboard")
    where = ("--host", "127.0.0.1", "--port", "0")
    with _process(*words, *where, ready=r"Scheduler at:\s+(tcp://\S+)") as (match, _):
        yield match[1]


@contextmanager
def _worker(address: str, directory: Path, *options: str) -> Iterator["subprocess.Popen[str]"]:
    program = f"-m distributed.cli.dask_worker {address}"
    words = f"{program} --nthreads 1 --no-nanny --no-dashboard".split()
    where = ("--local-directory", str(directory))
    with _process(*words, *where, *options, ready=r"Registered to:\s+tcp") as (_, process):
        yield process


@pytest.mark.matrix  # flight/test_campaign.py flies the same rows in processes of this machine
def test_a_scheduler_and_two_workers_fly_the_same_rows_and_the_loss_of_one_worker_costs_none(
    rows: list[CampaignRow],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with _scheduler() as address, _worker(address, tmp_path / "a"):
        with _worker(address, tmp_path / "b") as second, Cluster(address) as crew:
            assert crew.workers == 2

            def kill_one(done: int) -> None:
                if done == 0:
                    second.kill()

            assert run(
                _campaign(), SEEDS, crew, batch=1, out=tmp_path / "out", on_progress=kill_one
            ) == (rows, 3)
        words = (
            f"groundstation-sim campaign --flights 3 --duration 16.1 --json --cluster {address} "
            f"--out {tmp_path}/out"
        )
        monkeypatch.setattr("sys.argv", words.split())
        assert main() == 0
        facts = json.loads(capsys.readouterr().out)
        assert (facts["flights"], facts["flown_now"], facts["workers"]) == (3, 0, 1)
