"""Code of the user's own that is slow or never returns, in flights in real time: it is named, and the program lives."""

import os
import subprocess
import time
from pathlib import Path

import pytest

from tests.e2e.stations import served

CODE = """
import time

from groundstation import ActuatorCommand, Reference


class Own:
    def __init__(self, vehicle, options=None):
        self.vehicle, self.begun_s = vehicle, None

    def decide(self, estimate, reference, interval_s):
        self.begun_s = estimate.time_s if self.begun_s is None else self.begun_s
        self.dawdle(estimate.time_s - self.begun_s)
        return ActuatorCommand(self.vehicle.mass_kg * 9.83, (0.0, 0.0, 0.0))


class Slow(Own):
    def dawdle(self, flown_s):
        if flown_s > 1.0:
            time.sleep(0.2)


class Busy(Own):
    def dawdle(self, flown_s):
        while flown_s > 1.0:
            pass


class Deaf(Own):
    def dawdle(self, flown_s):
        while flown_s > 1.0:
            try:
                time.sleep(100.0)
            except Exception:
                pass


class DeafToAll(Own):
    def dawdle(self, flown_s):
        while flown_s > 1.0:
            try:
                time.sleep(100.0)
            except:
                pass


class NeverMade(Own):
    def __init__(self, vehicle, options=None):
        while True:
            pass


def stuck(time_s):
    while time_s > 3.0:
        pass
    return Reference((0.0, 0.0, -1.0))
"""


def fly(folder: Path, *sets: str) -> "subprocess.CompletedProcess[str]":
    (folder / "mine.py").write_text(CODE)
    words = [word for one in ("flight.coast_s=0.9", "guards.level_s=0.1", *sets) for word in ("--set", one)]
    with served() as room:
        return subprocess.run(
            room.station("fly", "--arm", "mqx", *words),
            capture_output=True,
            check=False,
            text=True,
            timeout=90,
            stdin=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": str(folder)},
        )


@pytest.mark.parametrize("name", ["Busy", "Deaf", "DeafToAll"])
def test_a_controller_that_never_returns_is_interrupted_and_told(name: str, tmp_path: Path) -> None:
    begun_s = time.monotonic()
    run = fly(tmp_path, f"controller.kind=mine:{name}")
    assert time.monotonic() - begun_s < 80.0
    assert run.returncode == 1, run.stdout + run.stderr
    assert f"controller mine:{name} failed: StepTimeout: it did not return within 500 ms" in run.stdout
    assert "the bring-down is over: nothing leaves any more" in run.stdout
    assert "in dawdle" in run.stderr, "the user's own lines"


def test_a_controller_that_is_never_made_is_told(tmp_path: Path) -> None:
    run = fly(tmp_path, "controller.kind=mine:NeverMade")
    assert run.returncode == 2, run.stdout + run.stderr
    assert "controller.kind: mine:NeverMade failed: StepTimeout: it did not return within 20 s" in run.stderr


def test_a_controller_that_is_slow_is_named_with_its_time(tmp_path: Path) -> None:
    run = fly(tmp_path, "controller.kind=mine:Slow", "flight.duration_s=4.0")
    told = [line for line in run.stdout.splitlines() if "controller mine:Slow took 2" in line]
    assert told, run.stdout + run.stderr
    assert "ms, limit 100 ms: make its step faster" in told[0]
    assert len([line for line in told if "warning" in line]) <= 3, "not each of its steps"


def test_a_trajectory_that_never_returns_is_told_before_the_flight(tmp_path: Path) -> None:
    run = fly(tmp_path, "trajectory.kind=mine:stuck")
    assert run.returncode == 1, run.stdout + run.stderr
    assert "trajectory mine:stuck failed: StepTimeout: it did not return within 500 ms" in run.stderr
