"""``import groundstation``: what a script or a notebook does with it, by the documents' own examples."""

import asyncio
import json
import math
import re
import traceback
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import groundstation as gs
from groundstation.analysis import export_command
from groundstation.analysis.report.flight import numbers
from groundstation.config import ConfigError, UserCodeFault
from sim.__main__ import parser
from sim.runs import fly
from sim.scenarios import SCENARIOS, prepare
from sim.scenarios.scenarios import ENDS
from tests.recordings import recorded

ROOT = Path(__file__).parents[2]
NOTEBOOK = json.loads((ROOT / "examples/notebook.ipynb").read_text("utf-8"))
PAGE = (ROOT / "docs/reference/python.md").read_text("utf-8")
HOW_TO = (ROOT / "docs/how-to/own-controller.md").read_text("utf-8")
SHORT_S = 1.5


class Hover:
    """As much thrust as it weighs, level."""

    def decide(self, estimate: gs.Estimate, reference: gs.Reference, interval_s: float) -> gs.ActuatorCommand:
        """Hold still."""
        return gs.ActuatorCommand(0.08 * 9.81, (0.0, 0.0, 0.0))


class Tuned(Hover):
    """Takes its options by whatever name they have."""

    def __init__(self, vehicle: gs.Vehicle, **options: float) -> None:
        """``gain`` is expected."""
        assert options == {"gain": 2.0}


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


def test_a_simulated_run_is_the_flight_that_the_program_flies(run: gs.Run) -> None:
    world, config = prepare(SCENARIOS["paper"], [])
    flown = fly(world, config, seed=3, duration_s=17.0)
    assert run.facts["log_sha256"] == flown.log_sha256
    assert run.rms_cm == flown.verdict.rms_cm
    assert run.completed


def test_time_tracks_and_error_are_arrays_of_one_row_a_command(run: gs.Run) -> None:
    assert run.truth is not None and run.truth.attitude is not None
    n = len(run.time)
    assert run.time[-1] == pytest.approx(17.0, abs=0.1)
    assert run.truth.position.shape == run.estimate.position.shape == run.reference.position.shape == (n, 3)
    assert run.truth.attitude.shape == (n, 4)
    assert run.error is run.truth.error
    assert np.linalg.norm(run.truth.attitude, axis=1) == pytest.approx(np.ones(n))
    # The camera's noise and latency are all that stands between the two.
    assert np.abs(run.truth.position - run.estimate.position)[run.time > 5.0].max() < 0.01


def test_the_truth_is_measured_against_the_reference_of_its_own_instant(run: gs.Run) -> None:
    assert run.truth is not None
    trajectory = prepare(SCENARIOS["paper"], [])[1].trajectory.build()
    i = len(run.time) // 2
    expected = math.dist(tuple(run.truth.position[i]), trajectory.position_at(float(run.time[i])))
    assert run.error[i] == pytest.approx(expected, abs=1e-6)


def test_a_recording_tells_the_error_against_the_truth_that_its_flight_told(run: gs.Run, tmp_path: Path) -> None:
    log = gs.load(run.save(tmp_path / "kept.mcap"))
    assert log.error_against == "truth"
    assert log.rms_cm == pytest.approx(run.rms_cm, rel=1e-12)
    assert log.max_cm == pytest.approx(run.max_cm, rel=1e-12)
    told = numbers(log.columns)
    assert told["true_error"]["rms_cm"] == pytest.approx(run.rms_cm, rel=1e-12)
    assert told["error"]["against"] == "estimate"


def test_a_channel_gives_columns_vectors_and_a_table(run: gs.Run) -> None:
    errors = run["errors"]
    assert errors["z1_m"].shape == (len(errors["error_m"]), 3)
    table = errors.to_pandas()
    assert list(table.columns[:2]) == ["error_m", "z1_m.x"]
    with pytest.raises(KeyError, match="has no column 'z9'"):
        errors["z9"]
    with pytest.raises(KeyError, match="expected one of"):
        run["nothing"]


def test_the_table_of_a_flight_has_a_row_a_command(run: gs.Run) -> None:
    table = run.to_pandas()
    assert len(table) == len(run.time)
    assert table["truth.position.down"].iloc[-1] == run.truth.position[-1, 2]  # type: ignore[union-attr]


def test_a_flight_is_saved_as_a_folder_of_tables_and_onto_itself(run: gs.Run, tmp_path: Path) -> None:
    folder = run.save(tmp_path / "flight.csv")
    lines = (folder / "errors.csv").read_text("utf-8").splitlines()
    assert len(lines) == 1 + len(run["errors"]["error_m"])
    assert not (folder / "request.csv").exists()  # nobody made one
    before = run.path.read_bytes()
    assert run.save(run.path) == run.path
    assert run.path.read_bytes() == before


@pytest.mark.tried(1)  # formats
@pytest.mark.parametrize("form", ["npz", "mat", "parquet"])
def test_a_flight_is_saved_in_the_formats_that_others_read(run: gs.Run, form: str, tmp_path: Path) -> None:
    errors = run["errors"]["error_m"]
    saved = run.save(tmp_path / f"flight.{form}")
    if form == "npz":
        kept = np.load(saved)  # which refuses what would have to be unpickled
        assert {kept[name].dtype.kind for name in kept.files} == {"f", "U"}
        found = kept["errors.error_m"]
    elif form == "mat":
        from scipy.io import loadmat

        found = loadmat(saved, simplify_cells=True)["errors"]["error_m"]
    else:
        from pyarrow.parquet import read_table

        found = read_table(saved / "errors.parquet")["error_m"].to_numpy()
    assert np.array_equal(found, errors)


def test_a_flight_is_saved_for_rerun(run: gs.Run, tmp_path: Path) -> None:
    if find_spec("rerun") is None:
        pytest.skip("NOT TRIED: rerun-sdk is not installed, so nobody has read an .rrd of ours (uv sync --extra view)")
    assert run.save(tmp_path / "flight.rrd").read_bytes()[:4] == b"RRF2"


def test_export_writes_what_save_does(run: gs.Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert export_command(run.path, "npz", ["errors"], tmp_path / "flight.npz") == 0
    assert "rows of 1 channels" in capsys.readouterr().out
    with np.load(tmp_path / "flight.npz") as kept:
        assert {name.partition(".")[0] for name in kept} == {"errors"}


def test_every_table_that_is_written_for_a_spreadsheet_can_be_read(run: gs.Run, tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    assert export_command(run.path, "csv", [], tmp_path / "tables") == 0
    tables = {path.stem: pandas.read_csv(path) for path in (tmp_path / "tables").iterdir()}
    assert len(tables["errors"]) == len(run["errors"]["error_m"])
    assert "request" not in tables  # nobody made one


def test_a_figure_shows_itself_in_a_notebook(run: gs.Run) -> None:
    figure: Any = run.plot("error")
    assert figure._repr_png_().startswith(b"\x89PNG")
    with pytest.raises(ConfigError, match=r"expected one of .*'position'"):
        run.plot("nothing")


MADE = {
    "a class": Hover,
    "a function": hover,
    "an object": Hover(),
    "a factory": lambda vehicle, options: Hover(),
    "a name": f"{__name__}:Hover",
}


@pytest.mark.parametrize("controller", MADE.values(), ids=MADE)
def test_a_class_a_function_an_object_a_factory_and_a_name_fly_the_same(controller: object) -> None:
    flown = gs.simulate(controller=controller, duration=SHORT_S, record=False)
    assert (
        flown.facts["log_sha256"] == gs.simulate(controller=Hover, duration=SHORT_S, record=False).facts["log_sha256"]
    )


def test_a_flight_is_flown_inside_a_running_event_loop() -> None:
    async def cell() -> str:
        return str(gs.simulate(duration=SHORT_S, record=False).facts["log_sha256"])

    assert asyncio.run(cell()) == gs.simulate(duration=SHORT_S, record=False).facts["log_sha256"]


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
    assert str(caught.value) == f"controller {__name__}:fails failed: ZeroDivisionError: float division by zero"
    cause = caught.value.__cause__
    assert cause is not None
    assert [frame.name for frame in traceback.extract_tb(cause.__traceback__)] == ["fails", "divides"]
    shown = "".join(traceback.format_exception(caught.value))
    assert "virtual_time" not in shown and "tasks.py" not in shown


@pytest.mark.parametrize("error", [SystemExit(3), asyncio.CancelledError(), GeneratorExit()], ids=repr)
def test_what_would_end_the_program_is_told_as_any_other_error_of_the_users_code(error: BaseException) -> None:
    def leaves(estimate: gs.Estimate, reference: gs.Reference, interval_s: float) -> gs.ActuatorCommand:
        raise error

    def departs(time_s: float) -> gs.Reference:
        raise error

    said = re.escape(f"failed: {type(error).__name__}: {error}")
    with pytest.raises(UserCodeFault, match=f"leaves {said}$") as caught:
        gs.simulate(controller=leaves, duration=SHORT_S)
    assert "tasks.py" not in "".join(traceback.format_exception(caught.value))
    with pytest.raises(ConfigError, match=f"departs {said}$"):
        gs.simulate(trajectory=departs, duration=SHORT_S)


async def waits(estimate: gs.Estimate, reference: gs.Reference, interval_s: float) -> gs.ActuatorCommand:
    """No controller: nobody awaits what it returns."""
    return gs.ActuatorCommand(0.7, (0.0, 0.0, 0.0))


async def idles(time_s: float) -> gs.Reference:
    """No trajectory either."""
    return gs.Reference((0.0, 0.0, -1.0))


def test_a_coroutine_is_no_decision_and_no_reference_and_the_sentence_says_what_to_write() -> None:
    with pytest.raises(UserCodeFault, match=r"returned a coroutine, not a Decision .write `def`, not `async def`.$"):
        gs.simulate(controller=waits, duration=SHORT_S, record=False)
    with pytest.raises(ConfigError, match=r"returned a coroutine, not a Reference .write `def`, not `async def`.$"):
        gs.simulate(trajectory=idles, duration=SHORT_S, record=False)


@pytest.mark.parametrize("loop", [False, True], ids=["alone", "in a running loop"])
def test_a_flight_that_is_interrupted_shows_no_frames_of_the_event_loop(loop: bool) -> None:
    def is_stopped(estimate: gs.Estimate, reference: gs.Reference, interval_s: float) -> gs.ActuatorCommand:
        raise KeyboardInterrupt

    async def cell() -> None:
        gs.simulate(controller=is_stopped, duration=SHORT_S, record=False)

    with pytest.raises(KeyboardInterrupt) as caught:
        asyncio.run(cell()) if loop else gs.simulate(controller=is_stopped, duration=SHORT_S, record=False)
    shown = "".join(traceback.format_exception(caught.value))
    assert "virtual_time" not in shown and "During handling" not in shown


def test_a_module_that_ends_the_program_is_a_refused_configuration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "leaving.py").write_text("import sys\n\nsys.exit(2)\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ConfigError, match=r"controller.kind: can't import leaving: SystemExit: 2$"):
        gs.simulate(controller="leaving:make", duration=SHORT_S)


class Unmakeable:
    """Fails when it is made."""

    def __init__(self) -> None:
        """Fail."""
        divides(0.0)


def test_a_controller_that_cannot_be_made_is_told_in_the_same_way() -> None:
    with pytest.raises(ConfigError, match=r"controller.kind: \S+:Unmakeable failed: ZeroDivisionError") as caught:
        gs.simulate(controller=Unmakeable, duration=SHORT_S)
    cause = caught.value.__cause__
    assert cause is not None
    assert [frame.name for frame in traceback.extract_tb(cause.__traceback__)] == ["__init__", "divides"]
    assert "asyncio" not in "".join(traceback.format_exception(caught.value))


def test_a_module_that_cannot_be_imported_shows_its_own_frames_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "half_done.py").write_text("import nothing_of_this_name\n")
    monkeypatch.syspath_prepend(tmp_path)
    for name, frames in (("half_done", ["<module>"]), ("not_there_at_all", [])):
        with pytest.raises(ConfigError, match=f"controller.kind: can't import {name}: ModuleNotFoundError") as caught:
            gs.simulate(controller=f"{name}:make", duration=SHORT_S)
        cause = caught.value.__cause__
        assert cause is not None
        assert [frame.name for frame in traceback.extract_tb(cause.__traceback__)] == frames


def test_one_name_needs_no_brackets() -> None:
    flown = gs.simulate(overrides="controller.k2=1.0", duration=SHORT_S, record=False)
    again = gs.simulate(overrides=["controller.k2=1.0"], duration=SHORT_S, record=False)
    assert flown.facts["log_sha256"] == again.facts["log_sha256"]
    with pytest.raises(ConfigError, match="got 'papr'"):
        gs.compare("pid", scenarios="papr")


def test_an_error_in_a_trajectory_names_the_trajectory() -> None:
    def early(time_s: float) -> gs.Reference:
        return gs.Reference((0.0, 0.0, -1.0 if time_s < 1.0 else math.nan))

    with pytest.raises(UserCodeFault, match=r"trajectory \S+early asked for .*nan"):
        gs.simulate(trajectory=early, duration=SHORT_S)
    with pytest.raises(ConfigError, match=r"trajectory.kind: trajectory \S+ returned a int, not a Reference"):
        gs.simulate(trajectory=lambda time_s: 3, duration=SHORT_S)


def test_the_trajectory_of_the_how_to_flies_from_a_configuration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (code,) = re.findall(
        r"^```python\n(.*?)^```$", (ROOT / "docs/how-to/trajectories.md").read_text("utf-8"), re.M | re.S
    )
    (tmp_path / "mine.py").write_text(code, "utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    flown = gs.simulate("paper", overrides=["trajectory.kind=mine:Breathing", "trajectory.swing_m=0.3"], duration=5)
    assert np.ptp(flown.reference.position[:, 2]) == pytest.approx(0.6, abs=0.01)


def test_a_factory_that_is_taken_for_a_curve_is_told_what_to_call_its_argument() -> None:
    def make(told: object) -> Still:
        return Still()

    with pytest.raises(ConfigError, match=r"returned a Still, not a Reference \(a factory's argument .* options\)$"):
        gs.simulate(trajectory=make, duration=SHORT_S)


def test_controllers_are_compared_as_they_are_given() -> None:
    from matplotlib.figure import Figure

    found = gs.compare(["pid", Hover], scenarios=["paper"], seeds=1, duration=16.5)
    assert [(row.scenario, row.controller) for row in found.rows] == [("paper", "pid"), ("paper", "Hover")]
    assert found.to_pandas().loc[("paper", "pid"), "survived"]
    assert isinstance(found.plot(), Figure)
    assert "Hover" in str(found)


def test_a_recording_without_truth_says_that_its_error_is_against_the_estimate(tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    data = recorded()[0].read_bytes()
    path.write_bytes(data[: len(data) // 8])  # cut off before the end, where the truth's figure stands
    assert gs.load(path).error_against == "truth"
    with pytest.raises(ConfigError, match="LOG"):
        gs.load(ROOT / "README.md")


@pytest.mark.parametrize(("told", "says"), [
    ({"scenario": "calm"}, "scenario: expected one of"),
    ({"source": "gps"}, "source: expected one of ['vicon', 'natnet'"),
    ({"link": "wifi"}, "link: expected one of ['mavlink', 'dsm'"),
    ({"autopilot": "ours"}, "autopilot: expected one of ['px4', 'ardupilot'"),
    ({"duration": -1}, "duration: expected seconds, more than 0"),
    ({"duration": math.nan}, "duration: expected seconds, more than 0"),
    ({"duration": "a minute"}, "duration: expected seconds, more than 0"),
    ({"seed": 0.5}, "seed: expected a whole number"),
    ({"scenario": ["paper"]}, "scenario: expected one of"),
    ({"overrides": 5}, "overrides: expected key=value"),
    ({"out": "run", "record": False}, "out: nothing is kept there of a flight that is not recorded"),
    ({"controller": [1]}, "controller.kind: builtins:list is not callable: expected factory(vehicle, options)"),
    ({"trajectory": Still(duration_s="long")}, "trajectory.kind: tests.flight.test_library:Still has duration_s = 'l"),
    ({"trajectory": Still(duration_s=math.nan)}, "trajectory.kind: tests.flight.test_library:Still has duration_s"),
    ({"trajectory": Still(period_s=-1)}, "trajectory.kind: tests.flight.test_library:Still has period_s = -1: exp"),
    ({"trajectory": Still(joints_s=5)}, "trajectory.kind: tests.flight.test_library:Still has joints_s = 5: expec"),
    ({"trajectory": Still(joints_s=[0.0, None])}, "trajectory.kind: tests.flight.test_library:Still has joints_s"),
    ({"trajectory": Still(joints_s=[2.0, 1.0])}, "trajectory.kind: tests.flight.test_library:Still has joints_s"),
])  # fmt: skip
def test_an_argument_that_means_nothing_is_refused_with_what_is_accepted(told: dict[str, Any], says: str) -> None:
    with pytest.raises(ConfigError) as refused:
        gs.simulate(**{"duration": 2.0, **told})
    assert str(refused.value).startswith(says)


@pytest.mark.parametrize(("told", "says"), [
    ({"duration": math.nan}, "duration: expected more than 16 s"),
    ({"duration": "60"}, "duration: expected more than 16 s"),
    ({"seeds": 0}, "seeds: expected a whole number, 1 or more"),
    ({"seeds": [0, 1]}, "seeds: expected a whole number, 1 or more"),
    ({"workers": 0}, "workers: expected a whole number, 1 or more"),
    ({"scenarios": []}, f"scenarios: expected some of {sorted(SCENARIOS)}, got []"),
    ({"scenarios": 5}, "scenarios: expected some of"),
    ({"controllers": []}, "controllers: expected some of"),
    ({"controllers": None}, "controllers: expected some of"),
])  # fmt: skip
def test_a_comparison_that_means_nothing_is_refused_before_it_flies(told: dict[str, Any], says: str) -> None:
    with pytest.raises(ConfigError) as refused:
        gs.compare(**{"controllers": "adaptive", "scenarios": "paper", "duration": 17.0, **told})
    assert str(refused.value).startswith(says)


@pytest.mark.parametrize("answer", [
    gs.ActuatorCommand("0.7", (0.0, 0.0, 0.0)),  # type: ignore[arg-type]
    gs.ActuatorCommand(10**400, (0.0, 0.0, 0.0)),
    gs.ActuatorCommand(0.7, "000"),  # type: ignore[arg-type]
    gs.ActuatorCommand(0.7, (0.0, 0.0)),  # type: ignore[arg-type]
])  # fmt: skip
def test_a_text_or_a_number_beyond_all_floats_is_no_thrust(answer: gs.ActuatorCommand) -> None:
    with pytest.raises(UserCodeFault, match="returned no thrust and three rates"):
        gs.simulate(controller=lambda estimate, reference, interval_s: answer, duration=1.0, record=False)


def test_a_text_is_no_coordinate() -> None:
    with pytest.raises(ConfigError, match="expected vectors of three numbers"):
        gs.simulate(trajectory=lambda time_s: gs.Reference(("0", "0", "-1")), duration=1.0)  # type: ignore[arg-type]


def test_a_class_may_take_its_options_by_any_name() -> None:
    assert gs.simulate(controller=Tuned, overrides="controller.gain=2.0", duration=1.0, record=False).facts


def test_a_flight_that_was_not_recorded_says_how_it_would_have_been() -> None:
    run = gs.simulate(duration=1.0, record=False)
    for ask in (lambda: run.time, run.plot, lambda: run.save("never.mcap")):
        with pytest.raises(AttributeError, match=r"not recorded.*record=True"):
            ask()


def test_what_is_no_recording_is_refused_in_one_way_by_all_that_read_one(tmp_path: Path) -> None:
    for path in (tmp_path / "nobody.mcap", ROOT / "README.md", "\0.mcap"):
        with pytest.raises(ConfigError, match="LOG"):
            gs.load(path)
        with pytest.raises(ConfigError, match="LOG"):
            gs.error_budget(path)


@pytest.mark.parametrize("told", [5, None, ""], ids=repr)
def test_what_is_no_path_is_no_recording(told: Any) -> None:
    with pytest.raises(ConfigError, match=re.escape(f"expected the path of a recording, NAME.mcap, got {told!r}")):
        gs.load(told)


def test_a_folder_in_the_place_of_a_recording_is_told_what_to_name(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"is a folder; expected a recording, such as \S+/flight.mcap$"):
        gs.load(tmp_path)


def test_a_damaged_recording_says_so_where_it_shows_itself(run: gs.Run, tmp_path: Path) -> None:
    data = bytearray(run.path.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 100] = bytes(100)
    (tmp_path / "damaged.mcap").write_bytes(data)
    assert re.search(
        r"the recording is damaged at byte \d+: the rest is not read>$", repr(gs.load(tmp_path / "damaged.mcap"))
    )
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) // 3])
    assert repr(gs.load(tmp_path / "cut.mcap")).endswith("the recording was cut off>")
    with pytest.raises(KeyError, match="expected one of"):
        run[5]  # type: ignore[index]


def test_the_program_and_the_library_offer_the_same_ends() -> None:
    for word, known in ENDS.items():
        for name in known:
            args = parser().parse_args(["fly", f"--{word}", name])
            assert getattr(args, word) == name
    with pytest.raises(SystemExit):
        parser().parse_args(["fly", "--source", "gps"])


def test_numbers_may_be_numpys() -> None:
    told: dict[str, Any] = {"duration": np.float64(2.0), "seed": np.int64(0)}
    again = gs.simulate("paper", **told)
    assert again.facts == gs.simulate("paper", duration=2, seed=0).facts | {"wall_s": again.facts["wall_s"]}


def test_a_run_and_a_loaded_flight_show_themselves_in_a_line(run: gs.Run) -> None:
    assert re.fullmatch(
        r"<FlightData of \S+\.mcap, adaptive: RMS error [\d.]+ cm against truth>", repr(gs.load(run.path))
    )
    assert re.fullmatch(r"<Run of paper, \S+, seed \d+: (RMS error [\d.]+ cm|no steady part) in [\d.]+ s>", repr(run))
    assert re.fullmatch(r"<Channel /\S+, \d+ rows: time_s, .*error_m.*>", repr(gs.load(run.path)["errors"]))


def test_a_comparison_that_ends_before_the_gust_does_not_mark_it() -> None:
    def told(duration_s: float) -> list[str]:
        flown = gs.compare("pid", scenarios="gust_front", duration=duration_s)
        return [text.get_text() for panel in flown.plot().axes for text in panel.texts]

    assert not any("the wind steps" in text for text in told(17.0))
    assert any("the wind steps" in text for text in told(31.0))


# ---- the documents


def cells() -> Iterator[str]:
    for cell in NOTEBOOK["cells"]:
        if cell["cell_type"] == "code":
            yield "".join(cell["source"])


@pytest.mark.matrix  # the next test runs the page's examples, and another flies in a running loop
def test_the_example_notebook_runs_from_its_first_cell_to_its_last_in_a_running_loop() -> None:
    async def run_all() -> dict[str, Any]:
        names: dict[str, Any] = {"__name__": "__main__"}
        for cell in cells():
            exec(compile(cell, "notebook", "exec"), names)
        return names

    names = asyncio.run(run_all())
    assert names["run"].completed
    assert [row.controller for row in names["comparison"].rows] == ["adaptive", "pid", "PD"]


def test_the_examples_of_the_page_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"^```python\n(.*?)^```$", PAGE, re.M | re.S)
    assert len(blocks) == 2
    for block in blocks:
        exec(compile(block, "python.md", "exec"), {"__name__": "__main__"})
    assert gs.load("pd.mcap").rms_cm is not None


def test_all_that_is_handed_on_is_offered_at_the_tab_key_and_stands_on_the_page() -> None:
    names = set(gs._MODULES)
    assert {"simulate", "compare", "load", "ask_station"} <= names <= set(dir(gs))
    assert [name for name in names if f"`{name}`" not in PAGE] == []


def test_the_how_to_names_every_field_that_a_controller_is_given() -> None:
    for name, kind in (("estimate", gs.Estimate), ("estimate.motion", gs.Motion), ("reference", gs.Reference)):
        for field in kind.__annotations__:
            assert f"| `{name}.{field}` |" in HOW_TO or (name, field) == ("estimate", "motion")
