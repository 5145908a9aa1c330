"""``groundstation report``: the numbers of a recorded flight, and the page that shows them."""

import base64
import csv
import json
import re
import sys
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text

from groundstation.analysis.identify import find_outside
from groundstation.analysis.report import draw_columns, read_columns, report_command
from groundstation.analysis.report.figures import (
    FIGURES,
    OVERLAYS,
    draw_figure,
    draw_figures,
    find_figure,
    flight_letters,
    print_figures,
)
from groundstation.analysis.report.flight import floor_z_m, numbers
from groundstation.analysis.report.page import result_table
from groundstation.config import ConfigError
from groundstation.core.messages import SETTLED_M
from groundstation.recording import quick_headline
from sim.runs import RECORDING, fly_mission, from_floor
from sim.runs.simulation import RunFolder
from sim.scenarios import SCENARIOS, prepare
from tests.recordings import recorded

LINKS = {"src", "href", "srcset", "action", "data", "poster"}


class Page(HTMLParser):
    """What a browser would load, and what it would run."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.pictures: list[bytes] = []
        self.links: list[str] = []
        self.tags: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        for name, value in attrs:
            if name in LINKS and value is not None:
                self.links.append(value)
                if tag == "img":
                    self.pictures.append(base64.b64decode(value.removeprefix("data:image/png;base64,"), validate=True))


@cache
def facts() -> dict[str, Any]:
    return numbers(read_columns(recorded(duration_s=17.0)[0]))


def nothing_outside(_: Path) -> list[str]:
    """In the place of a fit that takes as long as all the rest."""
    return []


def reported(paths: list[Path], capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    assert report_command(paths, None, find_outside, as_json=True) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def test_the_errors_are_those_that_the_list_of_flights_shows() -> None:
    _, headline, _ = quick_headline(recorded(duration_s=17.0)[0])
    assert headline.rms_m is not None
    assert headline.max_m is not None
    assert facts()["error"]["rms_cm"] == pytest.approx(100.0 * headline.rms_m)
    assert facts()["error"]["max_cm"] == pytest.approx(100.0 * headline.max_m)
    assert facts()["flown_s"] == pytest.approx(headline.flown_s)
    assert facts()["commands"] == headline.commands


def test_settling_time_and_saturation_are_close_to_what_the_referee_saw_of_the_truth() -> None:
    verdict = recorded(duration_s=17.0)[1].verdict
    assert verdict.settle_s is not None
    assert SETTLED_M == 0.10
    assert facts()["error"]["settle_s"] == pytest.approx(verdict.settle_s, abs=0.1)
    assert facts()["actuation"]["saturated_fraction_steady"] == pytest.approx(verdict.saturated_fraction, abs=1e-3)
    assert facts()["certificate"]["fractions"].get("suspended", 0.0) == pytest.approx(verdict.certificate_suspended)


def test_the_way_to_the_trajectory_and_the_landing_do_not_count(tmp_path: Path) -> None:
    world, config = from_floor(*prepare(SCENARIOS["paper"], ["takeoff.height_m=0.5", "takeoff.hold_s=1.0"]), 3.0)
    run = RunFolder(tmp_path, config, world, scenario="paper", seed=0)
    flown = fly_mission(world, config, seed=0, give=run.give)
    run.close({"completed": flown.landed, "why": flown.why})
    mission = numbers(read_columns(tmp_path / RECORDING))
    begun = next(event["time_s"] for event in mission["events"] if event["kind"] == "tracking")
    assert begun < -1.0  # the way there
    assert 2.0 < mission["flown_s"] < 4.0
    assert mission["error"]["settle_s"] < 0.1
    assert mission["events"][-1]["kind"] == "landed"


def test_every_command_has_an_instant_at_which_its_bytes_left() -> None:
    assert facts()["latency_ms"]["compute"]["samples"] == facts()["commands"]
    transport, age = facts()["latency_ms"]["transport"], facts()["latency_ms"]["pose_age"]
    assert transport["p50"] == pytest.approx(20.0, abs=0.1)  # the scenario's
    assert transport["p50"] < age["p50"] < transport["p50"] + 22.5


def test_the_page_holds_every_figure_and_needs_nothing_from_elsewhere(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert report_command([recorded(duration_s=17.0)[0]], tmp_path, nothing_outside, as_json=False) == 0
    path = Path(capsys.readouterr().out.strip())
    text = path.read_text("utf-8")
    page = Page(text)
    assert page.pictures == [(tmp_path / f"{figure.name}.png").read_bytes() for figure in FIGURES]
    assert all(picture.startswith(b"\x89PNG") and len(picture) > 5000 for picture in page.pictures)
    assert [link for link in page.links if not link.startswith("data:")] == []
    assert page.tags & {"script", "iframe", "object", "embed"} == set()
    assert re.findall(r"@import|url\(", text) == []
    for words in ("4.61", "7.60", "5.00", "Against the estimate", f"{facts()['error']['rms_cm']:.2f}"):
        assert words in text


@pytest.mark.matrix  # each stands on a page of its own
def test_two_recordings_stand_side_by_side(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = recorded("paper", "controller.kind=pid")[0]
    assert report_command([recorded()[0], other], tmp_path, nothing_outside, as_json=True) == 0
    found = json.loads(capsys.readouterr().out)
    assert [flight["flight"]["controller"] for flight in found["flights"]] == ["adaptive", "pid"]
    text = Path(found["page"]).read_text("utf-8")
    assert "mqx, adaptive" in text
    assert "mqx, pid" in text
    assert len(Page(text).pictures) == len(FIGURES) + len(OVERLAYS)


def test_a_recording_that_was_cut_off_is_reported_as_far_as_it_goes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = recorded()[0].read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    (flight,) = reported([tmp_path / "cut.mcap"], capsys)["flights"]
    assert not flight["whole"]
    assert 0 < flight["commands"] < facts()["commands"]
    assert "cut off" in flight["ended"]["reason"]


def test_the_numbers_need_no_matplotlib_and_the_page_says_that_it_does(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert reported([recorded()[0]], capsys)["page"] is None
    with pytest.raises(ConfigError, match=r"pip install .*\[plot\]"):
        report_command([recorded()[0]], None, find_outside, as_json=False)


def test_what_is_no_recording_or_holds_no_command_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("no recording")
    with pytest.raises(ConfigError, match=r"LOG: .* is no MCAP file"):
        report_command([tmp_path / "notes.txt"], None, find_outside, as_json=True)
    with pytest.raises(ConfigError, match="LOG: cannot read"):
        report_command([tmp_path / "missing.mcap"], None, find_outside, as_json=True)
    whole = recorded()[0].read_bytes()
    (tmp_path / "early.mcap").write_bytes(whole[: len(facts()["config"]) + 9000])
    with pytest.raises(ConfigError, match="holds no command"):
        report_command([tmp_path / "early.mcap"], None, find_outside, as_json=True)
    with pytest.raises(ConfigError, match=r"--format: expected some of .*'tex'"):
        report_command([recorded()[0]], tmp_path, find_outside, as_json=False, formats=["docx"])


def test_the_error_against_the_truth_stands_beside_that_against_the_estimate() -> None:
    verdict = recorded(duration_s=17.0)[1].verdict
    assert verdict.estimate_rms_cm is not None
    assert facts()["error"]["rms_cm"] == pytest.approx(verdict.estimate_rms_cm)
    head, *rows = result_table(["mqx"], [facts()])
    table = {row[0]: row[1:] for row in rows}
    assert head == ["", "mqx", "the paper"]
    assert table["RMS error against the estimate, from 15 s on [cm]"][0] == f"{verdict.estimate_rms_cm:.2f}"
    assert "RMS error against the truth, from 15 s on [cm]" in table


def cut_off(canvas: Figure) -> list[str]:
    """What is written in a figure and reaches over its edge; numbers at an axis excepted."""
    canvas.draw_without_rendering()
    written: list[Text] = []
    for panel in canvas.axes:
        legend = panel.get_legend()
        written += [axis.label for axis in panel._axis_map.values()]
        written += [*panel.texts, panel.title, *(legend.get_texts() if legend else [])]
    edge = canvas.bbox.padded(1.0)
    return [
        text.get_text()
        for text in written
        if text.get_text() and not all(edge.contains(*corner) for corner in text.get_window_extent().get_points())
    ]


@pytest.mark.matrix  # how figures look; what stands in them, other tests of it hold
def test_what_an_event_says_is_broken_into_lines_and_cut_only_where_no_line_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda canvas, *_, **__: drawn.append(canvas))
    flown = read_columns(recorded(duration_s=30.0)[0])
    draw_columns(tmp_path, [find_figure("events")], flown, "pdf")
    told = [f"{time_s:.1f} s  {kind}: {text}" for time_s, kind, text in flown.events]
    assert [text.get_text().replace("\n", " ") for text in drawn[0].axes[0].texts] == told
    many = [(float(i), "holding", "the pilot has it, " * 5) for i in range(14)]
    draw_columns(tmp_path, [find_figure("events")], replace(flown, events=many), "pdf")
    (panel,) = drawn[1].axes
    assert all("\n" not in text.get_text() for text in panel.texts)
    assert panel.texts[0].get_text().endswith("…")
    assert not cut_off(drawn[1])


def test_a_second_flight_is_drawn_on_limits_that_hold_it_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Poses of `adverse` get older than those of `paper`: they were cut off at the first's limits."""
    drawn: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda canvas, *_, **__: drawn.append(canvas))
    flights = [read_columns(recorded(scenario)[0]) for scenario in ("paper", "adverse")]
    draw_figures(tmp_path, flights)
    oldest_ms = [1e3 * flown.scalars["pose_age_s"].max() for flown in flights]
    assert oldest_ms[1] > 1.3 * oldest_ms[0]
    ages = [panel for canvas in drawn for panel in canvas.axes if panel.get_ylabel().startswith("pose age")]
    assert [panel.get_ylim()[1] > oldest_ms[1] for panel in ages] == [True]


def test_the_truth_is_the_uppermost_line_where_it_is_known() -> None:
    flown = read_columns(recorded()[0])
    for name in ("position", "path"):
        lines = draw_figure(find_figure(name), [flown]).axes[0].lines
        assert [line.get_label() for line in lines] == ["reference", "estimate", "truth"]
        # They lie upon each other: only what is broader than the line above it, and not as bright, is seen.
        for below, above in pairwise(lines):
            assert below.get_linewidth() > 1.5 * above.get_linewidth()
            assert abs(brightness(below) - brightness(above)) > 0.2


def test_heights_of_the_path_count_from_the_floor() -> None:
    path, *_ = recorded()
    flown = read_columns(path)
    floor = floor_z_m(flown)
    assert floor == 1.0, "its floor lies a metre below the origin"
    panel = draw_figure(find_figure("path"), [flown]).axes[0]
    estimate: Any = panel.lines[1]
    heights = np.asarray(estimate.get_data_3d()[2])
    assert heights == pytest.approx(floor - flown.vectors["position_ned"][:, 2])
    low, high = panel.get_zlim()  # type: ignore[attr-defined]
    assert low < heights.min()
    assert heights.max() < high


def brightness(line: Line2D) -> float:
    """How bright a line is printed in grey, 0 to 1 (ITU-R BT.709, of linear light)."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(line.get_color())]
    return float(np.dot((0.2126, 0.7152, 0.0722), linear) ** (1 / 2.2))


def test_flights_of_one_name_are_told_apart_in_the_legend_by_the_letters_of_the_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda canvas, *_, **__: drawn.append(canvas))
    ours, other = (read_columns(recorded("paper", *words)[0]) for words in ((), ("controller.kind=pid",)))
    print_figures(tmp_path, [ours, other], "pdf")
    print_figures(tmp_path, [ours, ours], "pdf")
    legends = [canvas.axes[0].get_legend() for canvas in drawn]
    names = [[text.get_text() for text in legend.get_texts()][:2] for legend in legends if legend is not None]
    assert names == [["adaptive, paper", "pid, paper"]] * 2 + [["A: adaptive, paper", "B: adaptive, paper"]] * 2


@pytest.mark.parametrize(("controller", "says"), [("__main__:PD", "PD, paper"), ("_mine:PD", " _mine:PD, paper")])
def test_a_controller_of_a_script_or_a_notebook_stands_in_the_legend(
    controller: str, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda canvas, *_, **__: drawn.append(canvas))
    ours, other = read_columns(recorded("paper")[0]), read_columns(recorded("paper")[0])
    other.recording.about["controller"] = controller
    print_figures(tmp_path, [ours, other], "pdf")
    legends = [canvas.axes[0].get_legend() for canvas in drawn]
    names = [[text.get_text() for text in legend.get_texts()][:2] for legend in legends if legend is not None]
    assert names == [["adaptive, paper", says]] * 2


def test_the_papers_figures_stand_beside_no_other_flight() -> None:
    papers, other = facts(), {**facts(), "paper": None}
    assert result_table(["A", "B"], [papers, papers])[0] == ["", "A", "B", "the paper"]
    assert result_table(["A", "B"], [papers, other])[0] == ["", "A", "B"]


def test_the_table_is_written_for_spreadsheets_and_for_latex(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert report_command([recorded()[0]] * 3, tmp_path, nothing_outside, as_json=False, formats=["csv", "tex"]) == 0
    assert capsys.readouterr().out.split() == [str(tmp_path / "results.csv"), str(tmp_path / "results.tex")]
    rows = list(csv.reader((tmp_path / "results.csv").read_text("utf-8").splitlines()))
    assert {len(row) for row in rows} == {5}
    assert rows[:2] == [["", "A", "B", "C", "the paper"], ["flight", *["adaptive, paper, seed 0"] * 3, ""]]
    text = (tmp_path / "results.tex").read_text("utf-8")
    widths = [float(share) for share in re.findall(r"p\{\\dimexpr([.0-9]+)\\linewidth-2\\tabcolsep\}", text)]
    assert len(widths) == 5 and 0.98 < sum(widths) < 1.0  # so that it fits the page
    assert text.count(r"\\" + "\n") == len(rows)
    assert r"certificate holds [\%]" in text
    assert not re.search(r"(?<!\\)[%&#_](?! )", text.replace(" & ", ""))
    assert "$-$0." in text  # a minus, not a hyphen
    assert text.isascii()  # so that no engine or encoding of LaTeX misses a letter


def test_flights_beyond_the_alphabet_have_letters_too() -> None:
    assert flight_letters(28)[24:] == ["Y", "Z", "AA", "BB"]


def test_a_controller_without_a_v_has_no_certificate_in_the_table(tmp_path: Path) -> None:
    paths = [recorded()[0], recorded("paper", "controller.kind=pid")[0]]
    assert report_command(paths, tmp_path, nothing_outside, as_json=False, formats=["csv"]) == 0
    rows = {row[0]: row[1:3] for row in csv.reader((tmp_path / "results.csv").read_text("utf-8").splitlines())}
    assert rows["certificate violated [%]"] == ["0.00", "–"]
    assert rows["certificate holds [%]"][1] == "–"
