"""``groundstation report``: the numbers of a recorded flight, and the page that shows them."""

import base64
import csv
import json
import re
import sys
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from groundstation.analysis.identify import find_outside
from groundstation.analysis.report import read_columns, report_command
from groundstation.analysis.report.figures import FIGURES
from groundstation.analysis.report.flight import numbers
from groundstation.analysis.report.page import result_table, write_page
from groundstation.config import ConfigError
from groundstation.core.messages import SETTLED_M, CommandSent, Notice, TickRecord
from groundstation.core.vehicle import Vehicle
from groundstation.flight.statistics import FlightStatistics
from groundstation.recording import LineRecord, Recording, quick_headline
from sim.runs import from_floor
from sim.scenarios import SCENARIOS, prepare
from tests.known import known
from tests.recordings import record_mission, recorded

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
                    data = value.removeprefix("data:image/png;base64,")
                    self.pictures.append(base64.b64decode(data, validate=True))


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
    assert facts()["error"]["rms_cm"] == pytest.approx(100.0 * known(headline.rms_m))
    assert facts()["error"]["max_cm"] == pytest.approx(100.0 * known(headline.max_m))
    assert facts()["flown_s"] == pytest.approx(headline.flown_s)
    assert facts()["commands"] == headline.commands


def test_the_error_that_a_flight_keeps_in_memory_is_that_of_its_recording() -> None:
    path, _, records = recorded(duration_s=17.0)
    _, headline, _ = quick_headline(path)
    kept = FlightStatistics(Vehicle(), 0.0)
    for record in records:
        match record:
            case LineRecord(time_s, state, text):
                kept.take(Notice(time_s, state, text))
            case TickRecord(tick):
                kept.take(CommandSent(tick))
    told = kept.describe_tracking_error()
    assert told.text.endswith(f"of {headline.flown_s:.1f} s on the trajectory; not recorded")
    assert told.numbers["rms_cm"] == pytest.approx(100.0 * known(headline.rms_m))
    assert told.numbers["max_cm"] == pytest.approx(100.0 * known(headline.max_m))


def test_settling_time_and_saturation_are_close_to_what_the_referee_saw_of_the_truth() -> None:
    verdict = recorded(duration_s=17.0)[1].verdict
    assert SETTLED_M == 0.10
    assert facts()["error"]["settle_s"] == pytest.approx(known(verdict.settle_s), abs=0.1)
    saturated = facts()["actuation"]["saturated_fraction_steady"]
    assert saturated == pytest.approx(verdict.saturated_fraction, abs=1e-3)
    suspended = facts()["certificate"]["fractions"].get("suspended", 0.0)
    assert suspended == pytest.approx(verdict.certificate_suspended)


def test_the_way_to_the_trajectory_and_the_landing_do_not_count(tmp_path: Path) -> None:
    told = ["takeoff.height_m=0.5", "takeoff.hold_s=1.0"]
    world, config = from_floor(*prepare(SCENARIOS["paper"], told), 3.0)
    _, path = record_mission(tmp_path, world, config)
    mission = numbers(read_columns(path))
    begun = next(event["time_s"] for event in mission["events"] if event["kind"] == "tracking")
    assert begun < -1.0  # the way there
    assert 2.0 < mission["flown_s"] < 4.0
    assert mission["error"]["settle_s"] < 0.1
    assert mission["events"][-1]["kind"] == "landed"
    lines = [entry.value() for entry in Recording(path).entries(("/mission",))]
    assert lines, "it has a mission"
    clocks = [event["clock_s"] for event in mission["events"] if event["kind"] != "request"]
    # As the flight has said them.
    assert clocks == pytest.approx([line["time_s"] for line in lines])


def test_every_command_has_an_instant_at_which_its_bytes_left() -> None:
    assert facts()["latency_ms"]["compute"]["samples"] == facts()["commands"]
    transport, age = facts()["latency_ms"]["transport"], facts()["latency_ms"]["pose_age"]
    assert transport["p50"] == pytest.approx(20.0, abs=0.1)  # the scenario's
    assert transport["p50"] < age["p50"] < transport["p50"] + 22.5


def test_the_page_holds_every_figure_and_needs_nothing_from_elsewhere(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flight = recorded(duration_s=17.0)[0]
    assert report_command([flight], tmp_path, nothing_outside, as_json=False) == 0
    path = Path(capsys.readouterr().out.strip())
    text = path.read_text("utf-8")
    page = Page(text)
    assert page.pictures == [(tmp_path / f"{figure.name}.png").read_bytes() for figure in FIGURES]
    assert all(picture.startswith(b"\x89PNG") and len(picture) > 5000 for picture in page.pictures)
    assert [link for link in page.links if not link.startswith("data:")] == []
    assert page.tags & {"script", "iframe", "object", "embed"} == set()
    assert re.findall(r"@import|url\(", text) == []
    rms_cm = f"{facts()['error']['rms_cm']:.2f}"
    for words in ("4.61", "7.60", "5.00", "Against the estimate", rms_cm):
        assert words in text


def test_a_recording_that_was_cut_off_is_reported_as_far_as_it_goes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = recorded()[0].read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    (flight,) = reported([tmp_path / "cut.mcap"], capsys)["flights"]
    assert not flight["whole"]
    assert 0 < flight["commands"] < facts()["commands"]
    assert "cut off" in flight["ended"]["reason"]


@pytest.mark.parametrize(
    ("lacks", "says"),
    [
        ({}, []),
        ({"whole": False}, ["was cut off"]),
        ({"whole": False, "damaged_at": 4711}, ["is damaged at byte 4711"]),
        ({"lost_records": 3}, ["3 records are missing"]),
    ],
)
def test_the_page_warns_of_what_the_recording_lacks(
    lacks: dict[str, Any], says: list[str], tmp_path: Path
) -> None:
    page = write_page(tmp_path, (), [facts() | {"told_outside": []} | lacks])
    text = page.read_text("utf-8")
    warnings = ("was cut off", "is damaged at byte 4711", "3 records are missing")
    assert [warning for warning in warnings if warning in text] == says


def test_the_numbers_need_no_matplotlib_and_the_page_says_that_it_does(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert reported([recorded()[0]], capsys)["page"] is None
    with pytest.raises(ConfigError, match=r"pip install .*\[plot\]"):
        report_command([recorded()[0]], None, find_outside, as_json=False)


def test_what_holds_no_command_and_a_form_that_there_is_not_are_refused(tmp_path: Path) -> None:
    whole = recorded()[0].read_bytes()
    (tmp_path / "early.mcap").write_bytes(whole[: len(facts()["config"]) + 9000])
    with pytest.raises(ConfigError, match="holds no command"):
        report_command([tmp_path / "early.mcap"], None, find_outside, as_json=True)
    with pytest.raises(ConfigError, match=r"--format: expected some of .*'csv'"):
        report_command([recorded()[0]], tmp_path, find_outside, as_json=False, formats=["docx"])


def test_the_error_against_the_truth_stands_beside_that_against_the_estimate() -> None:
    verdict = recorded(duration_s=17.0)[1].verdict
    assert facts()["error"]["rms_cm"] == pytest.approx(known(verdict.estimate_rms_cm))
    head, *rows = result_table(["mqx"], [facts()])
    table = {row[0]: row[1:] for row in rows}
    assert head == ["", "mqx", "the paper"]
    (against_estimate, _) = table["RMS error against the estimate, from 15 s on [cm]"]
    assert against_estimate == f"{known(verdict.estimate_rms_cm):.2f}"
    assert "RMS error against the truth, from 15 s on [cm]" in table


def test_the_table_is_written_for_spreadsheets(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flights = [recorded()[0]] * 3
    code = report_command(flights, tmp_path, nothing_outside, as_json=False, formats=["csv"])
    assert code == 0
    assert capsys.readouterr().out.split() == [str(tmp_path / "results.csv")]
    rows = list(csv.reader((tmp_path / "results.csv").read_text("utf-8").splitlines()))
    assert {len(row) for row in rows} == {5}
    assert rows[0] == ["", "A", "B", "C", "the paper"]
    assert rows[1] == ["flight", *["adaptive, paper, seed 0"] * 3, ""]
