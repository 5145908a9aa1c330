"""The measurements measure what they say, and leave nothing behind."""

import json

import pytest

from groundstation.core.geometry import FLOATS
from sim.__main__ import main
from sim.runs import percentile
from tests.proving.bench import batch as bench_batch
from tests.proving.bench import bench
from tests.proving.bench import command as bench_command
from tests.proving.bench import flight as bench_flight
from tests.proving.bench import links as bench_links
from tests.proving.bench import tick as bench_tick
from tests.proving.bench.batch import Bench
from tests.proving.bench.bench import in_turns
from tests.proving.bench.links import Answers, Waiting, figures_of, together


@pytest.mark.matrix  # of the tool that measures; others of its tests run the parts of it that judge
@pytest.mark.real_time
def test_every_measurement_gives_json_and_words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench_tick, "TICKS", 100)
    monkeypatch.setattr(bench_tick, "MONITOR_TICKS", 100)
    monkeypatch.setattr(bench_tick, "ROUNDS", 1)
    monkeypatch.setattr(bench_flight, "DURATION_S", 0.5)
    monkeypatch.setattr(bench_flight, "ROUNDS", 1)
    monkeypatch.setattr(bench_command, "DURATIONS_S", (0.5,))
    monkeypatch.setattr(bench_command, "ROUNDS", 1)
    monkeypatch.setattr(bench_links, "RATES_HZ", (100,))
    monkeypatch.setattr(bench_links, "SETTLE_S", 0.1)
    monkeypatch.setattr(bench_batch, "VEHICLES", 3)
    monkeypatch.setattr(bench_batch, "FLIGHT_S", 0.1)
    monkeypatch.setattr(bench_batch, "ROUNDS", 1)
    facts = json.loads(json.dumps(bench.measure_all(list(bench.WHAT), bench.Options(seconds=0.5))))
    assert list(facts) == ["machine", *bench.WHAT]
    assert all(row["ticks"] == 101 and row["median_us"] > 5.0 for row in facts["tick"]["rows"])
    assert all(row["times_real_time"] > 1.0 for row in facts["flight"]["rows"])
    (command,) = facts["command"]["rows"]
    assert command["flown_s"] == 0.5
    assert command["cpu_s"] > 0.05
    batch = facts["batch"]["rows"]
    assert len(batch) == 3
    assert all(row["ratio"] > 0.0 for row in batch)
    links = facts["links"]
    assert links["fifo"] in (True, False)
    assert links["latency_ratios"].keys() == links["echo"].keys() == {"100"}
    for figures in (links["pacer"], links["floor"], links["idle"]["pacer"], *links["pose_to_command"].values()):
        assert 0 < figures["p50_us"] <= figures["p99_us"] <= figures["p999_us"]
    words = bench.text(facts)
    assert all(f"\n{name}:" in words for name in bench.WHAT)


def test_a_peer_that_cannot_run_says_why_and_the_others_are_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent() -> Bench:
        raise ModuleNotFoundError("No module named 'jax'")

    def broken() -> Bench:
        raise ValueError("no such GPU")

    monkeypatch.setattr(bench_batch, "OURS", {"ours": lambda: bench_batch.law_and_plant(1, FLOATS, 2)})
    monkeypatch.setattr(bench_batch, "PEERS", {"absent": absent, "broken": broken})
    facts = bench_batch.measure(bench.Options(peers=True))
    notes = {row["name"]: row["note"] for row in facts["rows"]}
    assert "No module named 'jax'; install it with" in notes["absent"]
    assert notes["broken"] == "not measured: ValueError: no such GPU"
    assert facts["rows"][0]["ratio"] == pytest.approx(1.0)
    assert "no such GPU" in "\n".join(bench_batch.text(facts))


def test_a_whole_command_is_held_against_the_peers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench_command, "DURATIONS_S", (bench_command.PEER_S,))
    monkeypatch.setattr(bench_command, "ROUNDS", 1)
    monkeypatch.setattr(bench_command, "find_spec", lambda _: object())
    taken = iter([9.0, 9.0, 1.0, 4.0])  # the first round does not count
    monkeypatch.setattr(bench_command, "_note", lambda command, spent: spent.append(next(taken)))
    facts = bench_command.measure(bench.Options(peers=True))
    assert [row["share"] for row in facts["rows"]] == [0.25, 1.0]
    assert "0.250 of rotorpy's" in bench_command.text(facts)[0]


def test_a_whole_command_without_its_peer_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench_command, "DURATIONS_S", ())
    monkeypatch.setattr(bench_command, "find_spec", lambda _: None)
    assert "make bench" in bench_command.text(bench_command.measure(bench.Options(peers=True)))[-1]


def test_an_unknown_measurement_is_refused_with_the_ones_there_are(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["groundstation-sim", "bench", "pigeons"])
    assert main() == 2
    names = ["tick", "flight", "command", "batch", "links"]
    words = f"expected some of {names}, got 'pigeons'"
    assert words in capsys.readouterr().err


def test_runs_take_turns_and_the_first_round_does_not_count() -> None:
    order: list[str] = []
    found = in_turns({"a": lambda: order.append("a"), "b": lambda: order.append("b")}, 2)
    assert order == ["a", "b"] * 3
    assert set(found) == {"a", "b"}
    assert percentile([3.0, 1.0, 2.0], 0.99) == 3.0
    assert percentile([3.0, 1.0, 2.0], 0.0) == 1.0


def test_a_command_answers_the_pose_that_had_left_when_it_was_computed() -> None:
    waiting = Waiting()
    waiting.left(10.0001)
    waiting.command(10_000, 10.0009)
    assert waiting.latencies_s == [pytest.approx(0.0008)]
    assert waiting.overtaken == 0


def test_a_command_from_before_the_pose_is_no_answer_to_it() -> None:
    waiting = Waiting()
    waiting.left(10.0021)
    waiting.command(10_001, 10.0023)
    assert waiting.latencies_s == []
    waiting.command(10_004, 10.0045)
    assert waiting.latencies_s == [pytest.approx(0.0024)]


def test_a_pose_that_a_newer_one_overtakes_counts_until_their_command_comes() -> None:
    waiting = Waiting()
    waiting.left(10.0)
    waiting.left(10.004)
    waiting.command(10_004, 10.005)
    assert waiting.latencies_s == [pytest.approx(0.005), pytest.approx(0.001)]
    assert waiting.overtaken == 1


def test_what_had_no_answer_is_told_beside_the_percentiles() -> None:
    figures = figures_of(together([Answers([0.001, 0.003], 3, overtaken=1), Answers([0.002], 2)]))
    assert (figures["count"], figures["overtaken"], figures["unanswered"]) == (3, 1, 2)
    assert figures["p50_us"] == pytest.approx(2000.0)
    assert figures["p99_us"] == pytest.approx(3000.0)
