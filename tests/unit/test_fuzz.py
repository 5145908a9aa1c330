"""The fuzzer itself: what it finds, and that our decoders give it nothing to find."""

import json
import sys
from collections import Counter

import pytest

import links.make
from sim.__main__ import main
from tests.proving.fuzz import FLIGHTS, LINKS, SOURCES, Subject, fuzz

ALL = SOURCES | LINKS


@pytest.mark.parametrize("name", ALL)
def test_no_bytes_make_a_decoder_raise(name: str) -> None:
    report = fuzz(name, ALL[name], 2000)
    assert (report.tried, report.exceptions, report.mismatches) == (2000, 0, 0)
    assert report.events > 0, "nothing good got through: the fuzzer tries too little"
    assert len(report.drops) >= 2
    assert report.memory_growth_mb < 20.0


def test_every_source_that_is_timed_is_fuzzed() -> None:
    assert FLIGHTS.keys() <= SOURCES.keys()


def test_every_link_is_fuzzed() -> None:
    assert LINKS.keys() == links.make.LINKS.keys() | {"betaflight"}  # a board's own port, for the doctor


def broken() -> Subject:
    """A decoder that raises on long datagrams, and says something else in pieces."""

    def feed(datagram: bytes, now_s: float) -> int:
        if len(datagram) > 1000:
            raise IndexError("too long")
        return 1

    return SOURCES["json"]()._replace(feed=feed, drops=Counter, decode_stream=len)


def test_what_raises_or_differs_is_found_and_told(capsys: pytest.CaptureFixture[str]) -> None:
    report = fuzz("broken", broken, 1000)
    assert report.exceptions > 10
    assert report.mismatches > 10
    assert capsys.readouterr().err.count("IndexError: too long") == 3


def test_the_same_seed_tries_the_same_bytes() -> None:
    assert fuzz("vicon", SOURCES["vicon"], 500, seed=3).drops == fuzz("vicon", SOURCES["vicon"], 500, seed=3).drops
    assert fuzz("vicon", SOURCES["vicon"], 500, seed=3).drops != fuzz("vicon", SOURCES["vicon"], 500, seed=4).drops


def said(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str]:
    monkeypatch.setattr(sys, "argv", ["groundstation-sim", "fuzz", *words])
    code = main()
    return code, capsys.readouterr().out


def test_the_command_prints_one_object(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    code, out = said(monkeypatch, capsys, "--source", "natnet", "--count", "200", "--json")
    found = json.loads(out)
    assert code == 0
    assert found.keys() >= {"tried", "events", "drops", "exceptions", "memory_growth_mb", "decoders"}
    assert (found["tried"], found["exceptions"]) == (400, 0)
    assert [decoder["name"] for decoder in found["decoders"]] == ["natnet", "natnet 3.0"]


def test_the_command_takes_a_link_alone(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    _, out = said(monkeypatch, capsys, "--link", "mavlink", "--count", "100", "--json")
    assert [decoder["name"] for decoder in json.loads(out)["decoders"]] == ["mavlink"]


def test_an_unknown_name_is_refused_with_those_there_are(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["groundstation-sim", "fuzz", "--source", "pigeon"])
    assert main() == 2
    assert "--source: expected one of ['csv', 'json'" in capsys.readouterr().err
