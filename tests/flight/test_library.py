"""``import groundstation`` in a script or a notebook, by the documents' own examples."""

import asyncio
import math
import re
import struct
import traceback
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import groundstation as gs
from groundstation.analysis import export_command
from groundstation.analysis.identify import find_outside, identify_command
from groundstation.analysis.report import report_command
from groundstation.analysis.report.flight import numbers
from groundstation.config import ConfigError, UserCodeFault
from sim.runs import fly
from sim.scenarios import SCENARIOS, prepare
from tests.known import known
from tests.recordings import recorded

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/reference/python.md").read_text("utf-8")
SHORT_S = 1.5


class Hover:
    """As much thrust as it weighs, level."""

    def decide(
        self, estimate: gs.Estimate, reference: gs.Reference, interval_s: float
    ) -> gs.ActuatorCommand:
        """Hold still."""
        return gs.ActuatorCommand(0.08 * 9.81, (0.0, 0.0, 0.0))


class Still:
    """A trajectory that stands, and tells of itself what it was given."""

    def __init__(self, **told: object) -> None:
        """``told`` are its attributes."""
        self.__dict__.update(told)

    def at(self, time_s: float) -> gs.Reference:
        """Where to be."""
        return gs.Reference((0.0, 0.0, -1.0))


def hover(estimate: gs.Estimate, reference: gs.Reference, interval_s: float) -> gs.ActuatorCommand:
    """The same as a function."""
    return gs.ActuatorCommand(0.08 * 9.81, (0.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def run() -> gs.Run:
    """One flight of ours, long enough to have a steady part."""
    return gs.simulate("paper", duration=17, seed=3)


@pytest.fixture(scope="module")
def short() -> gs.Run:
    """Another, of which every channel is written."""
    return gs.simulate("paper", duration=SHORT_S, seed=3)


def test_a_simulated_run_is_the_flight_that_the_program_flies(short: gs.Run) -> None:
    flown = fly(*prepare(SCENARIOS["paper"], []), seed=3, duration_s=SHORT_S)
    assert short.facts["log_sha256"] == flown.log_sha256
    assert short.completed


def test_time_tracks_and_error_are_arrays_of_one_row_a_command(run: gs.Run) -> None:
    assert run.truth is not None and run.truth.attitude is not None
    n = len(run.time)
    assert run.time[-1] == pytest.approx(17.0, abs=0.1)
    assert run.truth.position.shape == (n, 3)
    assert run.estimate.position.shape == (n, 3)
    assert run.reference.position.shape == (n, 3)
    assert run.truth.attitude.shape == (n, 4)
    assert run.error is run.truth.error
    assert np.linalg.norm(run.truth.attitude, axis=1) == pytest.approx(np.ones(n))
    # The camera's noise and latency are all that stands between the two.
    assert np.abs(run.truth.position - run.estimate.position)[run.time > 5.0].max() < 0.01


def test_the_truth_is_measured_against_the_reference_of_its_own_instant(run: gs.Run) -> None:
    trajectory = prepare(SCENARIOS["paper"], [])[1].trajectory.build()
    i = len(run.time) // 2
    place, at_s = tuple(known(run.truth).position[i]), float(run.time[i])
    expected = math.dist(place, trajectory.position_at(at_s))
    assert run.error[i] == pytest.approx(expected, abs=1e-6)


def test_a_recording_tells_the_error_against_the_truth_that_its_flight_told(run: gs.Run) -> None:
    log = gs.load(run.path)
    assert log.error_against == "truth"
    assert log.rms_cm == pytest.approx(run.rms_cm, rel=1e-12)
    assert log.max_cm == pytest.approx(run.max_cm, rel=1e-12)
    told = numbers(log.columns)
    assert told["true_error"]["rms_cm"] == pytest.approx(run.rms_cm, rel=1e-12)
    assert told["error"]["against"] == "estimate"


def test_a_channel_gives_columns_vectors_and_a_table(short: gs.Run) -> None:
    errors = short["errors"]
    assert errors["z1_m"].shape == (len(errors["error_m"]), 3)
    table = errors.to_pandas()
    assert list(table.columns[:2]) == ["error_m", "z1_m.x"]
    with pytest.raises(KeyError, match="has no column 'z9'"):
        errors["z9"]
    with pytest.raises(KeyError, match="expected one of"):
        short["nothing"]


def test_a_flight_is_exported_as_a_folder_of_tables(short: gs.Run, tmp_path: Path) -> None:
    assert export_command(short.path, "csv", [], tmp_path / "tables") == 0
    lines = (tmp_path / "tables" / "errors.csv").read_text("utf-8").splitlines()
    assert len(lines) == 1 + len(short["errors"]["error_m"])
    assert not (tmp_path / "tables" / "request.csv").exists()  # nobody made one


@pytest.mark.tried(1)  # formats
@pytest.mark.parametrize("form", ["npz", "mat"])
def test_a_flight_is_exported_in_the_formats_that_others_read(
    short: gs.Run, form: str, tmp_path: Path
) -> None:
    errors, saved = short["errors"]["error_m"], tmp_path / f"flight.{form}"
    assert export_command(short.path, form, [], saved) == 0
    if form == "npz":
        kept = np.load(saved)  # which refuses what would have to be unpickled
        assert {kept[name].dtype.kind for name in kept.files} == {"f", "U"}
        found = kept["errors.error_m"]
    else:
        from scipy.io import loadmat

        found = loadmat(saved, simplify_cells=True)["errors"]["error_m"]
    assert np.array_equal(found, errors)


def test_export_writes_the_channels_that_are_named(
    short: gs.Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert export_command(short.path, "npz", ["errors"], tmp_path / "flight.npz") == 0
    assert "rows of 1 channels" in capsys.readouterr().out
    with np.load(tmp_path / "flight.npz") as kept:
        assert {name.partition(".")[0] for name in kept} == {"errors"}


@cache
def hovered() -> str:
    """The digest of a flight of ``Hover``."""
    return str(gs.simulate(controller=Hover, duration=SHORT_S, record=False).facts["log_sha256"])


MADE = {
    "a class": Hover,
    "a function": hover,
    "an object": Hover(),
    "a factory": lambda vehicle, options: Hover(),
    "a name": f"{__name__}:Hover",
}


@pytest.mark.parametrize("controller", MADE.values(), ids=MADE)
def test_a_class_a_function_an_object_a_factory_and_a_name_fly_the_same(controller: object) -> None:
    async def cell() -> str:
        flown = gs.simulate(controller=controller, duration=SHORT_S, record=False)
        return str(flown.facts["log_sha256"])

    assert asyncio.run(cell()) == hovered()


def fails(estimate: gs.Estimate, reference: gs.Reference, interval_s: float) -> gs.ActuatorCommand:
    """Fails in flight."""
    return divides(interval_s)


def divides(by: float) -> gs.ActuatorCommand:
    """Fails where ``by`` is 0."""
    return gs.ActuatorCommand(1.0 / by, (0.0, 0.0, 0.0))


@pytest.mark.parametrize("loop", [False, True], ids=["alone", "in a running loop"])
def test_an_error_in_a_controller_is_one_sentence_and_the_users_own_frames(loop: bool) -> None:
    async def cell() -> None:
        gs.simulate(controller=fails, duration=SHORT_S)

    with pytest.raises(UserCodeFault) as caught:
        asyncio.run(cell()) if loop else gs.simulate(controller=fails, duration=SHORT_S)
    failed = f"controller {__name__}:fails failed: ZeroDivisionError: float division by zero"
    assert str(caught.value) == failed
    cause = known(caught.value.__cause__)
    frames = traceback.extract_tb(cause.__traceback__)
    assert [frame.name for frame in frames] == ["fails", "divides"]
    shown = "".join(traceback.format_exception(caught.value))
    assert "virtual_time" not in shown and "tasks.py" not in shown


def test_the_trajectory_of_the_how_to_flies_from_a_configuration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = (ROOT / "docs/how-to/trajectories.md").read_text("utf-8")
    (code,) = re.findall(r"^```python\n(.*?)^```$", page, re.M | re.S)
    (tmp_path / "mine.py").write_text(code, "utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    told = ["trajectory.kind=mine:Breathing", "trajectory.swing_m=0.3"]
    flown = gs.simulate("paper", overrides=told, duration=5)
    assert np.ptp(flown.reference.position[:, 2]) == pytest.approx(0.6, abs=0.01)


def test_controllers_are_compared_as_they_are_given() -> None:
    from matplotlib.figure import Figure

    found = gs.compare(["pid", Hover], scenarios=["paper"], seeds=1, duration=16.5)
    flights = [(row.scenario, row.controller) for row in found.rows]
    assert flights == [("paper", "pid"), ("paper", "Hover")]
    assert found.to_pandas().loc[("paper", "pid"), "survived"]
    figure = found.plot()
    assert isinstance(figure, Figure)
    width, height = figure.get_size_inches()
    picture = figure._repr_png_()  # type: ignore[attr-defined]  # what a notebook shows
    assert struct.unpack(">II", picture[16:24]) == (round(140 * width), round(140 * height))
    assert "Hover" in str(found)


def test_a_cut_recording_tells_its_error_against_the_truth_too(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    data = recorded()[0].read_bytes()
    # Cut off before the end, where the truth's figure stands.
    path.write_bytes(data[: len(data) // 8])
    assert gs.load(path).error_against == "truth"


def a_trajectory(**told: object) -> dict[str, Any]:
    return {"trajectory": Still(**told)}


STILL = "trajectory.kind: tests.flight.test_library:Still has "


@pytest.mark.parametrize(("told", "says"), [
    ({"scenario": "calm"}, "scenario: expected one of"),
    ({"scenario": ["paper"]}, "scenario: expected one of"),
    ({"source": "gps"}, "source: expected one of ['vicon', 'natnet'"),
    ({"link": "wifi"}, "link: expected one of ['mavlink', 'dsm'"),
    ({"autopilot": "ours"}, "autopilot: expected one of ['px4', 'ardupilot'"),
    *(({"duration": wrong}, "duration: expected seconds, more than 0")
        for wrong in (-1, math.nan, "a minute")),
    ({"seed": 0.5}, "seed: expected a whole number"),
    ({"overrides": 5}, "overrides: expected key=value"),
    ({"out": "run", "record": False}, "out: nothing is kept there of a flight that is not rec"),
    ({"controller": [1]}, "controller.kind: builtins:list is not callable: expected factory(veh"),
    (a_trajectory(duration_s="long"), STILL + "duration_s = 'l"),
    (a_trajectory(duration_s=math.nan), STILL + "duration_s"),
    (a_trajectory(period_s=-1), STILL + "period_s = -1: exp"),
    (a_trajectory(joints_s=5), STILL + "joints_s = 5: expec"),
    (a_trajectory(joints_s=[0.0, None]), STILL + "joints_s"),
    (a_trajectory(joints_s=[2.0, 1.0]), STILL + "joints_s"),
])  # fmt: skip
def test_a_wrong_argument_is_refused(told: dict[str, Any], says: str) -> None:
    with pytest.raises(ConfigError, match=f"^{re.escape(says)}"):
        gs.simulate(**{"duration": 2.0, **told})


@pytest.mark.parametrize(("told", "says"), [
    ({"duration": math.nan}, "duration: expected seconds, more than 16 "),
    ({"duration": "60"}, "duration: expected seconds, more than 16 "),
    ({"seeds": 0}, "seeds: expected a whole number, 1 or more"),
    ({"seeds": [0, 1]}, "seeds: expected a whole number, 1 or more"),
    ({"workers": 0}, "workers: expected a whole number, 1 or more"),
    ({"scenarios": []}, f"scenarios: expected some of {sorted(SCENARIOS)}, got []"),
    ({"scenarios": 5}, "scenarios: expected some of"),
    ({"controllers": []}, "controllers: expected some of"),
    ({"controllers": None}, "controllers: expected some of"),
])  # fmt: skip
def test_a_wrong_comparison_is_refused_before_it_flies(told: dict[str, Any], says: str) -> None:
    usual: dict[str, Any] = {"controllers": "adaptive", "scenarios": "paper", "duration": 17.0}
    with pytest.raises(ConfigError, match=f"^{re.escape(says)}"):
        gs.compare(**usual | told)


def test_what_is_no_recording_is_refused_in_one_way_by_all_that_read_one(tmp_path: Path) -> None:
    commands: tuple[Callable[[Any], object], ...] = (
        lambda path: identify_command(path, None, None, as_json=True),
        lambda path: report_command([path], None, find_outside, as_json=True),
    )
    for path in (tmp_path / "nobody.mcap", ROOT / "README.md", "\0.mcap"):
        for read in (gs.load, gs.error_budget, *(commands if isinstance(path, Path) else ())):
            with pytest.raises(ConfigError, match="LOG"):
                read(path)


# ---- the documents


def test_the_examples_of_the_page_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"^```python\n(.*?)^```$", PAGE, re.M | re.S)
    assert len(blocks) == 2
    for block in blocks:
        exec(compile(block, "python.md", "exec"), {"__name__": "__main__"})
    assert gs.load("pd/flight.mcap").rms_cm is not None
