"""groundstation/analysis/viewers: what Foxglove is given of a flight, as a file and while it is recorded."""

from collections import Counter
from pathlib import Path

import pytest
from mcap.reader import make_reader

from groundstation.analysis import export_command
from groundstation.analysis.viewers import FoxgloveScene
from groundstation.recording import About, FlightLog, Recording
from tests.recordings import recorded


@pytest.fixture(scope="module")
def flight() -> Path:
    return recorded(duration_s=25.0)[0]


@pytest.fixture(scope="module")
def exported(flight: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("viewers") / "flight-foxglove.mcap"
    assert export_command(flight, "foxglove", [], target) == 0
    return target


def test_foxglove_reads_the_scene_as_protobuf_beside_all_messages_as_they_were(flight: Path, exported: Path) -> None:
    with exported.open("rb") as file:
        rows = [(c.topic, c.message_encoding, s.name) for s, c, _ in make_reader(file).iter_messages() if s]
    drawn = {topic: name for topic, encoding, name in rows if encoding == "protobuf"}
    assert drawn == {topic: f"foxglove.{kind}" for topic, kind in FoxgloveScene.kinds.items()}
    own = Counter(topic for topic, encoding, _ in rows if encoding == "json")
    before = Counter(entry.topic for entry in Recording(flight).entries())
    assert own == before
    assert list(Recording(exported).entries()) == list(Recording(flight).entries())
    assert Recording(exported).headline() == Recording(flight).headline()


def begin(path: Path) -> FlightLog:
    """A recording of the same vehicle, to be written by hand."""
    return FlightLog(
        path,
        About(config="", vehicle="mqx", controller="adaptive", trajectory="lemniscate", period_s=0.0),
        epoch_ns=0,
        tell=lambda text, *_: print(text),
    )


def test_a_recording_is_followed_while_it_is_written(tmp_path: Path) -> None:
    _, _, records = recorded(duration_s=25.0)
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
