"""Viewers: the messages for Foxglove, and a recording that is still being written."""

import json
from pathlib import Path
from typing import Any

import pytest

from groundstation.analysis import viewers
from groundstation.analysis.viewers import SAMPLE_S, FoxgloveScene
from groundstation.recording import About, FlightLog, Recording
from tests.recordings import recorded


def test_foxglove_gets_all_messages_and_trails_of_positions(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(viewers, "TRAIL_S", 3.0)
    scene, drawn = FoxgloveScene(), dict[str, list[Any]]()
    places = dict[str, list[list[float]]]()
    for entry in Recording(recorded()[0]).entries():
        (topic, data), *more = scene.messages(entry)
        assert (topic, data) == (entry.topic, entry.data)
        if topic in ("/estimate", "/reference", "/truth"):
            places.setdefault(topic, []).append(list(entry.value()["position_ned"].values()))
        for name, text in more:
            drawn.setdefault(name, []).append(json.loads(text))
    assert set(drawn) == {"/tf", *scene.topics}
    world = {(one["parent_frame_id"], one["child_frame_id"]) for one in drawn["/tf"]}
    assert world == {("world", "world_ned")}
    assert len(drawn["/tf"]) == sum(len(drawn[name]) for name in scene.topics)
    for name in scene.topics:
        trails = [[list(pose["position"].values()) for pose in one["poses"]] for one in drawn[name]]
        known = places[name.removeprefix("/scene")]
        assert len(trails) == pytest.approx(8.0 / SAMPLE_S, rel=0.2)
        assert trails[0] == known[:1]
        assert trails[-1][-1] in known[-round(2.0 * 50 * SAMPLE_S) :]
        assert all(place in known for place in trails[-1])
        assert 0.7 * 3.0 / SAMPLE_S < len(trails[-1]) <= 3.0 / SAMPLE_S + 1


def begin(path: Path) -> FlightLog:
    """A recording of the same vehicle, to be written by hand."""
    about = About(config="", vehicle="mqx", controller="pid", trajectory="hold", period_s=0.0)
    return FlightLog(path, about, epoch_ns=0, tell=lambda text, *_: print(text))


def test_a_recording_is_followed_while_it_is_written(tmp_path: Path) -> None:
    _, _, records = recorded()
    path = tmp_path / "growing.mcap"
    log = begin(path)
    entries = Recording(path).follow()
    assert next(entries) is None, "nothing yet, and no end"
    half = len(records) // 2
    for record in records[:half]:
        log.write(record)
    log.flush()
    first = list(iter(lambda: next(entries), None))
    assert len(first) > half
    for record in records[half:]:
        log.write(record)
    log.close()
    rest = list(entries)
    assert None not in rest, "it has ended"
    assert [*first, *rest] == list(Recording(path).entries())
