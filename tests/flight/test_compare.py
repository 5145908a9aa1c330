"""``groundstation-sim compare``: its JSON, its table in a document, and who flies best."""

import argparse
import json
import math
from pathlib import Path
from typing import Any

import msgspec
import pytest

from groundstation.config import ConfigError
from sim.__main__ import main, parser
from sim.cli import commands
from sim.runs import FlightVerdict
from sim.scenarios import SCENARIOS, prepare
from sim.studies import (
    CONTROLLERS,
    Case,
    ComparedFlight,
    cases,
    markdown_table,
    rows,
    text_table,
    write_between_markers,
)
from tests.e2e.stations import run_here
from tests.flight.flights import flown

SCENARIO = "storm"
DURATION_S = 17.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("compared")
    page = "# Page\n\n<!-- figures:begin -->\nold\n<!-- figures:end -->\n\nlast\n"
    (path / "PAGE.md").write_text(page, "utf-8")
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
    told = f"--scenarios {SCENARIO} --seeds 1 --workers 1 --duration {DURATION_S}"
    words = (*told.split(), *asked)
    done = run_here(main, "compare", *words, "--json", "--write", folder / "PAGE.md")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert list(result) == ["rows"]
    found: list[dict[str, Any]] = result["rows"]
    return found


def test_each_controller_has_a_row_with_every_figure(
    compared: list[dict[str, Any]], controllers: tuple[str, ...]
) -> None:
    assert [row["controller"] for row in compared] == list(controllers)
    for row in compared:
        figures = "scenario controller rms_cm max_cm settle_s effort_rad_s survived"
        assert row.keys() >= set(figures.split())
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


def test_the_table_stands_between_the_markers_with_the_command_that_makes_it(
    compared: list[dict[str, Any]], controllers: tuple[str, ...], folder: Path
) -> None:
    text = (folder / "PAGE.md").read_text("utf-8")
    head = "| RMS error, cm | " + " | ".join(controllers) + " |"
    assert text.startswith(f"# Page\n\n<!-- figures:begin -->\n{head}")
    assert text.endswith("<!-- figures:end -->\n\nlast\n")
    assert "old" not in text
    assert f"| `{SCENARIO}` | {compared[0]['rms_cm']:.2f} |" in text
    assert f"made by `groundstation-sim compare --scenarios {SCENARIO} --seeds 1 " in text
    assert f"--write {folder / 'PAGE.md'}`" in text


# ---- the parts, on made-up flights


def verdict(
    rms_cm: float | None, peak_cm: float | None = None, back_s: float | None = None
) -> FlightVerdict:
    """That of a flight, but for these figures."""
    max_cm = None if rms_cm is None else 2 * rms_cm
    errors = {"rms_cm": rms_cm, "max_cm": max_cm, "gust_peak_cm": peak_cm, "gust_back_s": back_s}
    return msgspec.structs.replace(flown("paper", duration_s=20.0).verdict, **errors)


def made_up(
    controller: str, rms: list[float | None], scenario: str = "paper"
) -> list[ComparedFlight]:
    case = Case(scenario, controller, ())
    verdicts = enumerate(map(verdict, rms))
    return [ComparedFlight(case, seed, one.rms_cm is not None, one) for seed, one in verdicts]


def test_one_crash_leaves_no_figure_that_could_be_boasted_of() -> None:
    (row,) = rows(made_up("pid", [3.0, None, 2.0]))
    assert (row.rms_cm, row.rms_cm_min, row.max_cm, row.settle_s, row.effort_rad_s) == (None,) * 5
    assert (row.survived, row.crashed) == (False, 1)
    assert "1 of 3 crashed" in markdown_table([row])
    assert "2 of 3" in text_table([row])


def pushed(variant: int, *peaks: float | None) -> list[ComparedFlight]:
    case = Case("step_8", "pid", (), variant)
    back_s = 1.5 if variant else None
    verdicts = enumerate(verdict(9.0, peak, back_s) for peak in peaks)
    return [ComparedFlight(case, s, one.gust_peak_cm is not None, one) for s, one in verdicts]


def test_a_large_push_counts_by_the_median_of_its_worst_direction() -> None:
    (row,) = rows([*pushed(1, 80.0, 90.0, 10.0), *pushed(2, 85.0, 70.0, 60.0)])
    assert (row.peak_cm, row.back_s, row.flights) == (80.0, 1.5, 6)
    assert "| `step_8`, peak after it | 80.0 (1.50 s) |" in markdown_table([row])
    (never,) = rows([*pushed(0, 40.0), *pushed(1, 80.0)])
    assert (never.peak_cm, never.back_s) == (80.0, None)
    (lost,) = rows([*pushed(1, None), *pushed(2, 60.0)])
    assert lost.peak_cm is None


def test_large_pushes_come_from_every_side_and_are_flown_only_when_asked_for() -> None:
    (*_, last) = cases(["push_10"], ["pid"])
    world, config = prepare(SCENARIOS["push_10"], list(last.overrides))
    assert math.hypot(*world.wind_step) == pytest.approx(10.0)
    assert (world.wind_push_s, config.controller.kind, last.variant) == (1.0, "pid", 15)


def asked(**changes: Any) -> argparse.Namespace:
    words = "compare --seeds 1 --workers 1 --json"
    args = parser().parse_args([*words.split(), "--duration", "20"])
    vars(args).update(changes)
    return args


@pytest.mark.parametrize(("changes", "line"), [
    ({"scenarios": ["papr"]}, r"^scenarios: expected some of \['adverse', .*\], got 'papr'"),
    ({"controllers": ["pidd"]}, r"--controllers: expected one of \['adaptive', .*\], got 'pidd'"),
    ({"controllers": ["nosuchlab:make"]}, r"--controllers: can't import nosuchlab"),
    ({"duration": 15.0}, r"^duration: expected seconds, more than 16 "),
    ({"write": Path("no/such.md")}, r"--write: cannot read no/such\.md"),
    ({"overrides": ["sim.masss=1"]}, r"sim\.masss: unknown key"),
])  # fmt: skip
def test_what_cannot_be_flown_or_written_is_said_before_anything_flies(
    changes: dict[str, Any], line: str
) -> None:
    with pytest.raises(ConfigError, match=line):
        commands.compare(asked(**changes))


@pytest.mark.parametrize(
    "text", ["no markers", "<!-- figures:end --> <!-- figures:begin -->", "<!-- figures:begin -->"]
)
def test_a_document_without_its_markers_is_left_as_it_is(text: str, tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(text, "utf-8")
    with pytest.raises(
        ConfigError, match=r"--write: .*page\.md needs a line <!-- figures:begin -->"
    ):
        write_between_markers(page, rows(made_up("pid", [1.0])), "groundstation-sim compare")
    assert page.read_text("utf-8") == text
