"""``groundstation-sim compare``: its JSON, its table in a document, its picture, and who flies best."""

import argparse
import contextlib
import io
import json
import math
import sys
from pathlib import Path
from typing import Any

import pytest

from groundstation.config import ConfigError
from sim.__main__ import main, parser
from sim.cli import commands
from sim.scenarios import SCENARIOS, prepare
from sim.studies import (
    CONTROLLERS,
    GUST,
    WITHOUT_ADAPTATION,
    Case,
    ComparedFlight,
    cases,
    fly_case,
    markdown_table,
    plot,
    rows,
    text_table,
    write_between_markers,
)
from tests.flight.flights import flown as one_flight

SCENARIO = "storm"
DURATION_S = 17.0
PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("compared")
    (path / "pictures").mkdir()
    (path / "PAGE.md").write_text("# Page\n\n<!-- figures:begin -->\nold\n<!-- figures:end -->\n\nlast\n", "utf-8")
    return path


@pytest.fixture(
    scope="module",
    params=[("adaptive", "pid"), pytest.param(tuple(CONTROLLERS), marks=pytest.mark.matrix)],
    ids=["two", "all"],
)
def controllers(request: pytest.FixtureRequest) -> tuple[str, ...]:
    """Those that are compared."""
    found: tuple[str, ...] = request.param
    return found


@pytest.fixture(scope="module")
def compared(folder: Path, controllers: tuple[str, ...]) -> list[dict[str, Any]]:
    """One comparison by the command itself: its rows."""
    asked = () if controllers == tuple(CONTROLLERS) else ("--controllers", ",".join(controllers))
    words = (
        *("groundstation-sim", "compare", "--scenarios", SCENARIO, "--seeds", "1", *asked, "--workers", "1"),
        *("--duration", str(DURATION_S), "--json"),
        *("--plot", str(folder / "pictures" / "x.png"), "--write", str(folder / "PAGE.md")),
    )
    with pytest.MonkeyPatch.context() as patched, contextlib.redirect_stdout(io.StringIO()) as printed:
        patched.setattr("sys.argv", words)
        assert main() == 0
    result = json.loads(printed.getvalue())
    assert list(result) == ["rows"]
    found: list[dict[str, Any]] = result["rows"]
    return found


def test_each_controller_has_a_row_with_every_figure(
    compared: list[dict[str, Any]], controllers: tuple[str, ...]
) -> None:
    assert [row["controller"] for row in compared] == list(controllers)
    for row in compared:
        assert row.keys() >= {"scenario", "controller", "rms_cm", "max_cm", "settle_s", "effort_rad_s", "survived"}
        assert row["scenario"] == SCENARIO
        assert (row["rms_cm"] is None) == (row["survived"] is False)
        if row["survived"]:
            assert 0.0 < row["rms_cm_min"] == row["rms_cm"] == row["rms_cm_max"] < row["max_cm"]
            assert row["effort_rad_s"] > 0.0


def test_ours_beats_every_baseline(compared: list[dict[str, Any]]) -> None:
    ours, *others = compared
    assert ours["survived"]
    for row in others:
        assert row["rms_cm"] is None or row["rms_cm"] > 1.1 * ours["rms_cm"], row


def test_a_row_says_what_the_same_flight_says(compared: list[dict[str, Any]]) -> None:
    verdict = one_flight(SCENARIO, "controller.kind=pid", duration_s=DURATION_S).verdict
    row = next(row for row in compared if row["controller"] == "pid")
    assert (row["rms_cm"], row["max_cm"], row["settle_s"]) == (verdict.rms_cm, verdict.max_cm, verdict.settle_s)


def test_the_table_stands_between_the_markers_with_the_command_that_makes_it(
    compared: list[dict[str, Any]], controllers: tuple[str, ...], folder: Path
) -> None:
    text = (folder / "PAGE.md").read_text("utf-8")
    assert text.startswith("# Page\n\n<!-- figures:begin -->\n| RMS error, cm | " + " | ".join(controllers) + " |")
    assert text.endswith("<!-- figures:end -->\n\nlast\n")
    assert "old" not in text
    assert f"| `{SCENARIO}` | {compared[0]['rms_cm']:.2f} |" in text
    some = "" if controllers == tuple(CONTROLLERS) else f" --controllers {','.join(controllers)}"
    flown_by = f"groundstation-sim compare --scenarios {SCENARIO}{some} --seeds 1 --duration 17"
    assert f"made by `{flown_by} --plot pictures/x.png --write PAGE.md`" in text


def test_the_picture_is_drawn(compared: list[dict[str, Any]], folder: Path) -> None:
    assert compared
    assert (folder / "pictures" / "x.png").read_bytes().startswith(PNG)


# ---- the parts, on made-up flights


def made_up(controller: str, rms: list[float | None], scenario: str = "paper") -> list[ComparedFlight]:
    case = Case(scenario, controller, ())
    return [
        ComparedFlight(
            case, seed, value is not None, value, None if value is None else 2 * value, 3.0, 0.5, None, None, None
        )
        for seed, value in enumerate(rms)
    ]


def test_figures_are_medians_with_their_spread() -> None:
    (row,) = rows(made_up("pid", [3.0, 1.0, 2.0]))
    assert (row.rms_cm, row.rms_cm_min, row.rms_cm_max, row.max_cm) == (2.0, 1.0, 3.0, 4.0)
    assert (row.survived, row.crashed, row.flights) == (True, 0, 3)


def test_one_crash_leaves_no_figure_that_could_be_boasted_of() -> None:
    (row,) = rows(made_up("pid", [3.0, None, 2.0]))
    assert (row.rms_cm, row.rms_cm_min, row.max_cm, row.settle_s, row.effort_rad_s) == (None,) * 5
    assert (row.survived, row.crashed) == (False, 1)
    assert "1 of 3 crashed" in markdown_table([row])
    assert "2 of 3" in text_table([row])


def pushed(variant: int, *peaks: float | None) -> list[ComparedFlight]:
    case = Case("step_8", "pid", (), "pid", variant)
    return [
        ComparedFlight(case, seed, peak is not None, 9.0, 9.0, 3.0, 0.5, peak, 1.5 if variant else None, None)
        for seed, peak in enumerate(peaks)
    ]


def test_a_large_push_counts_by_the_median_of_its_worst_direction() -> None:
    (row,) = rows([*pushed(1, 80.0, 90.0, 10.0), *pushed(2, 85.0, 70.0, 60.0)])
    assert (row.peak_cm, row.back_s, row.flights) == (80.0, 1.5, 6)
    assert "| `step_8`, peak after it | 80.0 (1.50 s) |" in markdown_table([row])
    (never,) = rows([*pushed(0, 40.0), *pushed(1, 80.0)])
    assert (never.peak_cm, never.back_s) == (80.0, None)
    (lost,) = rows([*pushed(1, None), *pushed(2, 60.0)])
    assert lost.peak_cm is None


def test_large_pushes_come_from_every_side_and_are_flown_only_when_asked_for() -> None:
    sizes = {name: len(SCENARIOS[name].variants) for name in ("step_3", "step_5", "step_8", "push_6", "push_10")}
    assert sizes == {"step_3": 8, "step_5": 10, "step_8": 8, "push_6": 16, "push_10": 16}
    (*_, last) = cases(["push_10"], ["pid"])
    world, config = prepare(SCENARIOS["push_10"], list(last.overrides))
    assert math.hypot(*world.wind_step) == pytest.approx(10.0)
    assert (world.wind_push_s, config.controller.kind, last.variant) == (1.0, "pid", 15)


def test_the_gust_front_is_flown_without_adaptation_too() -> None:
    work = cases(["paper", GUST], ["pid", "adaptive", "indi"])
    names = [case.controller for case in work if case.scenario == GUST]
    assert names == ["pid", "adaptive", WITHOUT_ADAPTATION, "indi"]
    assert WITHOUT_ADAPTATION not in [case.controller for case in work if case.scenario == "paper"]
    _, off = prepare(SCENARIOS[GUST], list(work[5].overrides))
    assert (off.controller.kind, off.controller.kb, off.controller.composite) == ("adaptive", 0.0, "off")


def test_a_trace_holds_the_true_error_from_the_start_on(tmp_path: Path) -> None:
    one = fly_case(Case(GUST, "adaptive", ("sim.wind_step_time_s=3.0",)), 0, 17.0, traced=True)
    trace = one.trace
    assert trace is not None
    assert len(trace) == pytest.approx(17.0 / 0.05, abs=1)
    assert trace[0] == pytest.approx(181.0, abs=3.0)
    # The 15th second on is what the figures are taken from; a point of the trace is the largest error of its 50 ms.
    assert max(trace[300:]) == pytest.approx(one.max_cm, rel=1e-3)
    plot(tmp_path / "gust.svg", rows([one]), [one])
    assert "the wind steps" in (tmp_path / "gust.svg").read_text("utf-8")


def asked(**changes: Any) -> argparse.Namespace:
    args = parser().parse_args(["compare", "--seeds", "1", "--duration", "20", "--workers", "1", "--json"])
    vars(args).update(changes)
    return args


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"scenarios": ["papr"]}, r"^scenarios: expected some of \['adverse', .*\], got 'papr'"),
        ({"controllers": ["pidd"]}, r"--controllers: expected one of \['adaptive', .*\], got 'pidd'"),
        ({"controllers": ["nosuchlab:make"]}, r"--controllers: can't import nosuchlab"),
        ({"duration": 15.0}, r"^duration: expected more than 16 s"),
        ({"write": Path("no/such.md")}, r"--write: cannot read no/such\.md"),
        ({"plot": Path("no/such.png")}, r"--plot: cannot write no/such\.png: there is no such folder"),
        ({"plot": Path("such.txt")}, r"--plot: cannot write such\.txt: expected a name that ends in one of"),
        ({"plot": Path()}, r"--plot: cannot write \.: it is a folder"),
        ({"overrides": ["sim.masss=1"]}, r"sim\.masss: unknown key"),
    ],
    ids=[
        "scenario",
        "controller",
        "factory",
        "duration",
        "document",
        "no_folder",
        "no_picture",
        "a_folder",
        "override",
    ],
)
def test_what_cannot_be_flown_or_written_is_said_before_anything_flies(changes: dict[str, Any], line: str) -> None:
    with pytest.raises(ConfigError, match=line):
        commands.compare(asked(**changes))


def test_without_matplotlib_a_picture_is_refused_before_anything_flies(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ConfigError, match=r"--plot: needs matplotlib.*pip install .*\[plot\]"):
        commands.compare(asked(plot=Path("x.png")))


@pytest.mark.parametrize(
    "text", ["no markers", "<!-- figures:end --> <!-- figures:begin -->", "<!-- figures:begin -->"]
)
def test_a_document_without_its_markers_is_left_as_it_is(text: str, tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(text, "utf-8")
    with pytest.raises(ConfigError, match=r"--write: .*page\.md needs a line <!-- figures:begin -->"):
        write_between_markers(page, rows(made_up("pid", [1.0])), "groundstation-sim compare")
    assert page.read_text("utf-8") == text
