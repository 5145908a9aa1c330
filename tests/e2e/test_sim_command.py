"""``groundstation-sim`` as a script calls it: what it prints, what it writes, how it ends."""

import contextlib
import csv
import json
import os
import re
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from groundstation.__main__ import main as export
from groundstation.pose import TlogReader
from sim.__main__ import main
from sim.scenarios import SCENARIOS
from tests.e2e.stations import beside, program, run_command, run_here

ROOT = Path(__file__).parents[2]


def sim(*arguments: str) -> "subprocess.CompletedProcess[str]":
    return run_here(main, *arguments)


KEYS = (
    "scenario seed controller duration_s rms_cm max_cm settle_s wind_true wind_estimate "
    "thrust_min_n thrust_max_n saturated_fraction lyapunov_increase_max certificate_violated "
    "certificate_suspended certificate_warnings log_sha256 wall_s"
)
"""What --json promises of a flight."""


def test_json_is_one_object_with_every_promised_key() -> None:
    done = sim("fly", "paper", "--seed", "4", "--duration", "20", "--json")
    assert done.returncode == 0, done.stderr
    facts = json.loads(done.stdout)
    assert set(facts) >= set(KEYS.split())
    assert (facts["scenario"], facts["seed"], facts["controller"]) == ("paper", 4, "adaptive")
    assert facts["duration_s"] == pytest.approx(20.0)
    assert len(facts["log_sha256"]) == 64


def test_a_crash_exits_1_and_says_why() -> None:
    done = sim("fly", "--duration", "5", "--json", "--set", "sim.thrust_gain=0.3")
    assert done.returncode == 1
    facts = json.loads(done.stdout)
    assert facts["completed"] is False
    assert "floor" in facts["why"]
    assert facts["rms_cm"] is None


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("fly hurricane", "expected one of"),
        ("fly --set sim.mass=3", "sim.mass: unknown key; did you mean mass_kg?"),
        ("fly --set nonsense", "--set"),
        ("dev faults --fault yawflip", "is called 'yawflip'; did you mean yaw flip?"),
        ("fly --config=", "argument --config: expected a path, got ''"),
        ("dev check-vectors absent.json", "cannot read absent.json: No such file"),
        ("fly --out /dev/null/nowhere", "cannot write"),
        ("dev firmware --write absent.md", "cannot read absent.md: No such file"),
        ("serve --carried --duration 1", "--carried: expected --config FILE.toml beside it"),
    ],
)
def test_bad_usage_exits_2_with_a_clear_last_line(words: str, expected: str) -> None:
    done = sim(*words.split())
    assert done.returncode == 2
    assert expected in done.stderr.strip().splitlines()[-1]
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("start", [main, export], ids=["groundstation-sim", "groundstation"])
def test_without_a_command_the_list_of_them_is_shown(start: Callable[[], int]) -> None:
    done = run_here(start)
    assert (done.returncode, done.stdout) == (2, "")
    assert "config" in done.stderr or "scenarios" in done.stderr


def test_a_flight_too_short_for_its_error_says_so() -> None:
    said = sim("fly", "--duration", "3").stdout
    assert "errors take a flight of 16 s: this one was shorter" in said
    assert "– (after the first 5 s)" in said


def test_a_flight_of_which_half_a_second_could_be_judged_has_no_error_figures(
    tmp_path: Path,
) -> None:
    flown = json.loads(sim("fly", "--duration", "15.5", "--json", "--out", str(tmp_path)).stdout)
    assert [flown[key] for key in ("rms_cm", "estimate_rms_cm", "effort_rad_s")] == [None] * 3
    told = run_here(export, "report", str(tmp_path / "flight.mcap"), "--json").stdout
    (shown,) = json.loads(told)["flights"]
    assert [shown[key]["rms_cm"] for key in ("error", "true_error")] == [None] * 2


def test_scenarios_lists_every_scenario_with_every_value() -> None:
    rows = json.loads(sim("scenarios", "--json").stdout)
    assert set(rows) == set(SCENARIOS)
    assert rows["storm"]["sim"]["wind_mean"] == [2.0, -1.6, 1.0]
    assert [line.split()[0] for line in sim("scenarios").stdout.splitlines()] == list(SCENARIOS)
    assert "sim.wind_mean = [2.0, -1.6, 1.0]" in sim("scenarios", "storm").stdout
    assert "expected one of" in sim("scenarios", "strom").stderr
    assert list(json.loads(sim("scenarios", "storm", "--json").stdout)) == ["storm"]


def test_a_runs_folder_holds_config_recording_traffic_and_result(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    done = sim("fly", "--duration", "4", "--out", str(folder))
    assert done.returncode == 0, done.stderr
    assert "RMS error" in done.stdout
    assert str(folder) in done.stdout

    def rows(channel: str) -> list[dict[str, str]]:
        table = run_here(export, "export", folder / "flight.mcap", "--channel", channel).stdout
        return list(csv.DictReader(table.splitlines()))

    errors, lyapunov = rows("errors"), rows("lyapunov")
    assert len(errors) == len(lyapunov) == pytest.approx(4.0 / 0.0225, abs=2)
    assert all(float(value) == float(value) for value in errors[-1].values())
    assert lyapunov[-1]["state"] in ("holds", "suspended", "none")
    records = TlogReader((folder / "flight.tlog").read_bytes())
    names = [record.message.get_type() for record in records]
    assert names.count("SET_ATTITUDE_TARGET") >= len(errors)
    assert "COMMAND_ACK" in names
    assert json.loads((folder / "summary.json").read_text())["sim"]["mass_kg"] == 0.08
    assert "[controller]" in (folder / "config.toml").read_text()


@pytest.mark.tried(1)  # instants
@pytest.mark.skipif(
    not Path("/proc/self/task").exists(), reason="no /proc, which tells when a process has started"
)
@pytest.mark.parametrize("children", [1, 2, 3])
def test_ctrl_c_while_worker_processes_start_is_told_in_one_line(children: int) -> None:
    words = ["compare", "--scenarios", "paper", "--controllers", "pid,indi", "--workers", "2"]
    with beside(program("sim", *words), start_new_session=True, stderr=subprocess.PIPE) as process:
        children_of = Path(f"/proc/{process.pid}/task/{process.pid}/children")
        # The first is not a worker: it tracks what they share.
        while len(children_of.read_text().split()) < children:
            assert process.poll() is None
        os.killpg(process.pid, signal.SIGINT)
        _, told = process.communicate(timeout=60)
    assert (process.returncode, told) == (130, "groundstation-sim: interrupted\n")


ELSEWHERE = """
import os, select, signal, sys, time
sys.platform = "darwin"
for module, names in ((os, "memfd_create pidfd_open sched_setscheduler sched_getaffinity eventfd"),
                      (select, "epoll"), (signal, "pidfd_send_signal"), (time, "CLOCK_BOOTTIME")):
    for name in names.split():
        vars(module).pop(name, None)
"""
"""A Python without what only Linux has."""


@pytest.mark.tried(3)  # commands
@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        ("sim fly --duration 5", 0, "wall time"),
        ("sim fly --link dsm --duration 5", 0, "wall time"),
        ("sim serve", 2, "serve: needs Linux"),
        ("groundstation trajectory examples/loopback.toml", 0, "PASS"),
        ("groundstation radio idle examples/rf-dsm.toml", 1, "only Linux can pace an RF module"),
        ("groundstation stop-all", 0, "nothing flies here"),
    ],
)
def test_without_linux_what_computes_works_and_the_rest_says_why(
    words: str, code: int, says: str, tmp_path: Path
) -> None:
    (tmp_path / "sitecustomize.py").write_text(ELSEWHERE)
    elsewhere = os.environ | {"PYTHONPATH": str(tmp_path), "XDG_RUNTIME_DIR": str(tmp_path)}
    done = run_command(program(*words.split()), env=elsewhere, cwd=ROOT, stderr=subprocess.STDOUT)
    assert done.returncode == code, done.stdout
    assert says in done.stdout
    assert "Traceback" not in done.stdout


def test_what_takes_long_shows_on_a_terminal_how_far_it_is() -> None:
    words = "compare --scenarios ideal --controllers adaptive --seeds 1 --duration 17"
    reader, writer = os.openpty()
    shown = b""
    with beside(
        program("sim", *words.split()), stdout=subprocess.DEVNULL, stderr=writer
    ) as process:
        os.close(writer)
        with contextlib.suppress(OSError):  # nobody has its other end open any more
            while part := os.read(reader, 65536):
                shown += part
        assert process.wait(60) == 0
    os.close(reader)
    assert re.search(rb"flights.*\d+/\d+", shown), shown
