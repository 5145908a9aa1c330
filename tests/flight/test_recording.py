"""Recordings: their content, whoever reads them and wherever they were cut off."""

import json
import os
import stat
import tomllib
from collections import Counter
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, strategies as st
from mcap.reader import make_reader

from groundstation.__main__ import main as groundstation_main
from groundstation.analysis import export_command
from groundstation.analysis.recordings import SUFFIXES
from groundstation.config import ConfigError, from_dict
from groundstation.core.messages import PoseRecord, TickRecord
from groundstation.machine import RecordingConfig, make_folder
from groundstation.recording import (
    CHANNELS,
    LineRecord,
    NoRecording,
    ReceivedRecord,
    Record,
    Recording,
    SentRecord,
    schema,
)
from groundstation.recording.writer import FLUSH_S
from groundstation.settings import Config
from sim.__main__ import main
from sim.runs import RECORDING, fly
from sim.runs.simulation import RunFolder
from sim.scenarios import SCENARIOS, prepare
from tests.e2e.stations import run_here
from tests.recordings import recorded

RARE = {"/lost", "/request"}
"""Channels that a flight without trouble, begun in the air, has nothing for."""


def messages(path: Path) -> list[tuple[str, str, dict[str, Any]]]:
    """Topic, schema's name and content of every message, by mcap's own reader."""
    with path.open("rb") as file:
        found = make_reader(file, validate_crcs=True).iter_messages()
        return [
            (to.topic, kind.name if kind else "", json.loads(one.data)) for kind, to, one in found
        ]


@pytest.mark.parametrize("link", ["mavlink", "dsm", "crsf", "rf_bridge"])
def test_what_leaves_is_recorded_whatever_the_link(link: str) -> None:
    records: list[Record] = []
    fly(*prepare(SCENARIOS["paper"], [], link=link), seed=0, duration_s=0.5, give=records.append)
    commands = sum(isinstance(record, TickRecord) for record in records)
    assert sum(isinstance(record, SentRecord) for record in records) >= commands > 10


def fits(value: Any, shape: dict[str, Any]) -> bool:
    """Whether ``value`` is as the JSON schema ``shape`` says, as far as ours go."""
    numbers = {"number": (int, float), "integer": int}
    kinds = {**numbers, "string": str, "boolean": bool, "array": list, "object": dict}
    if not isinstance(value, kinds[shape["type"]]):  # type: ignore[arg-type]  # mypy joins them to object
        return False
    if shape["type"] == "array":
        return all(fits(item, shape["items"]) for item in value)
    if shape["type"] == "object" and "properties" in shape:
        properties = shape["properties"]
        return set(shape["required"]) <= set(value) <= set(properties) and all(
            (item is None and key not in shape["required"]) or fits(item, properties[key])
            for key, item in value.items()
        )
    return True


def test_every_channel_is_in_the_file_and_keeps_its_schema() -> None:
    path, _, _ = recorded()
    seen = {topic: name for topic, name, _ in messages(path)}
    assert seen == {topic: name for topic, (name, _) in CHANNELS.items() if topic not in RARE}
    shapes = {topic: json.loads(schema(name, kind)) for topic, (name, kind) in CHANNELS.items()}
    for topic, _, content in messages(path):
        assert fits(content, shapes[topic]), (topic, content)


def test_the_well_known_schemas_have_the_fields_that_foxglove_asks_for() -> None:
    vector = {"x", "y", "z"}
    shapes = {topic: json.loads(schema(*CHANNELS[topic])) for topic in ("/pose", "/tf", "/log")}
    log = "timestamp level message name file line"
    assert set(shapes["/log"]["required"]) == set(log.split())
    transform = shapes["/tf"]["properties"]
    frame = "timestamp parent_frame_id child_frame_id translation rotation"
    assert set(transform) == set(frame.split())
    assert transform["timestamp"]["title"] == "time"
    assert set(transform["timestamp"]["properties"]) == {"sec", "nsec"}
    assert set(transform["translation"]["properties"]) == vector
    assert set(transform["rotation"]["properties"]) == vector | {"w"}
    assert set(shapes["/pose"]["properties"]) == {"timestamp", "frame_id", "pose"}
    assert set(shapes["/pose"]["properties"]["pose"]["properties"]) == {"position", "orientation"}
    assert not any("$ref" in json.dumps(shape) for shape in shapes.values())


def test_the_first_record_says_what_flew_and_how_to_fly_it_again() -> None:
    path, _, _ = recorded()
    about = Recording(path).about
    assert about["vehicle"] == "mqx"
    assert from_dict(tomllib.loads(about["config"]), Config).vehicle.name == "mqx"
    assert about["scenario"] == "paper"
    assert about["seed"] == "0"
    assert tomllib.loads(about["sim"])["mass_kg"] == 0.08
    assert about["version"] in about["packages"]
    with path.open("rb") as file:
        names = [metadata.name for metadata in make_reader(file).iter_metadata()]
        assert names == ["about", "result"]


def test_every_command_pose_and_byte_is_in_it_to_the_last_bit() -> None:
    path, _, records = recorded()
    entries = [(entry.topic, entry.value()) for entry in Recording(path).entries()]
    ticks = [record.tick for record in records if isinstance(record, TickRecord)]
    commands = [value for topic, value in entries if topic == "/command"]
    assert len(ticks) == len(commands) > 300
    for tick, value in zip(ticks, commands, strict=True):
        rates = value["rates_rad_s"]
        commanded = (tick.command.thrust_n, *tick.command.rates_rad_s)
        assert (value["thrust_n"], rates["x"], rates["y"], rates["z"]) == commanded
        assert (value["time_s"], value["deadline_s"]) == (tick.time_s, tick.command.deadline_s)
    stamps = [value["time_s"] for topic, value in entries if topic == "/measured"]
    assert stamps == [record.pose.time_s for record in records if isinstance(record, PoseRecord)]
    for kind, channel in ((ReceivedRecord, "/raw/received"), (SentRecord, "/raw/sent")):
        held = [value["data"] for topic, value in entries if topic == channel]
        assert len(held) == sum(isinstance(record, kind) for record in records) > 300


@given(st.floats(0.0, 1.0), st.binary(max_size=20))
def test_a_cut_recording_gives_all_but_its_last_quarter_second(share: float, tail: bytes) -> None:
    path, _, _ = recorded()
    data = path.read_bytes()
    size = int(share * len(data))
    cut = path.with_name("cut_anywhere.mcap")
    cut.write_bytes(data[:size] + tail)
    whole = [(entry.topic, entry.data) for entry in Recording(path).entries()]
    try:
        recording = Recording(cut)
    except NoRecording:
        about_bytes = sum(len(key) + len(text) + 8 for key, text in Recording(path).about.items())
        # Only the beginning of the file may be without what makes it a recording.
        assert size < about_bytes + 200
        return
    found = [(entry.topic, entry.data) for entry in recording.entries()]
    assert found == whole[: len(found)]
    # What is missing before the cut is less than a chunk's bytes.
    assert len(found) / len(whole) > share - (2.0 * FLUSH_S / 8.0) - 0.02


@given(st.integers(0, 1 << 30), st.integers(1, 255))
def test_a_damaged_byte_never_gives_a_false_message(where: int, flip: int) -> None:
    path, _, _ = recorded()
    data = bytearray(path.read_bytes())
    data[where % len(data)] ^= flip
    bad = path.with_name("damaged.mcap")
    bad.write_bytes(data)
    whole = [entry.data for entry in Recording(path).entries()]
    try:
        found = [entry.data for entry in Recording(bad).entries()]
    except NoRecording:
        return
    assert found == whole[: len(found)]


def test_a_recording_is_for_its_owner_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, _, _ = recorded()
    for file in (path, path.with_suffix(".tlog")):
        assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert export_command(path, "mcap", [], tmp_path / "copy.mcap") == 0
    assert stat.S_IMODE((tmp_path / "copy.mcap").stat().st_mode) == 0o600
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    before = os.umask(0)
    try:
        usual = make_folder(RecordingConfig())
        chosen = make_folder(RecordingConfig(folder=str(tmp_path / "chosen")))
        usual.chmod(0o755)  # as older versions made it
        make_folder(RecordingConfig())
        shared = tmp_path / "shared"
        shared.mkdir(0o750)
        make_folder(RecordingConfig(folder=str(shared)))
    finally:
        os.umask(before)
    modes = [stat.S_IMODE(folder.stat().st_mode) for folder in (usual, chosen, shared)]
    assert modes == [0o700, 0o700, 0o750]


def test_a_recording_that_was_cut_off_is_made_whole(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, _, _ = recorded()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[:-50000])
    with pytest.raises(Exception):  # noqa: B017  # mcap's own reader wants an index
        messages(cut)
    assert export_command(cut, "mcap", [], None) == 0
    assert "cut off" in capsys.readouterr().out
    with (tmp_path / "cut-whole.mcap").open("rb") as file:
        whole = make_reader(file, validate_crcs=True).iter_messages()
        made = Counter((channel.topic, message.data) for _, channel, message in whole)
    assert made == Counter((entry.topic, entry.data) for entry in Recording(cut).entries())


def damage(path: Path, data: bytes) -> int:
    """Write the recording ``data`` to ``path``, its first messages damaged; return where."""
    at, chunk = 8, 6  # behind MCAP's magic bytes; the first record that holds messages
    while data[at] != chunk:
        at += 9 + int.from_bytes(data[at + 1 : at + 9], "little")
    path.write_bytes(data[: at + 100] + bytes([data[at + 100] ^ 0xFF]) + data[at + 101 :])
    return at


@pytest.mark.parametrize(
    ("command", "says"),
    [
        ("identify", "holds no flight: there are no commands in it"),
        ("report", "holds no command, so there is nothing to report"),
    ],
)
def test_a_flight_of_which_too_little_can_be_read_is_not_told_as_none(
    command: str, says: str, tmp_path: Path
) -> None:
    at = damage(bad := tmp_path / "bad.mcap", recorded()[0].read_bytes())
    told = run_here(groundstation_main, command, bad).stderr
    assert f"{says}; the recording is damaged at byte {at}: the rest is not read" in told


@pytest.mark.parametrize("form", ["csv", "mcap", "npz"])
def test_an_export_of_which_nothing_can_be_read_is_refused(form: str, tmp_path: Path) -> None:
    at = damage(damaged := tmp_path / "damaged.mcap", recorded()[0].read_bytes())
    with pytest.raises(ConfigError, match=rf"^LOG: nothing .* is damaged at byte {at}"):
        export_command(damaged, form, [], target := tmp_path / f"made{SUFFIXES[form]}")
    assert not target.exists()


TAKEN = r"^--out: .*mine is there already: name another, or remove it$"


@pytest.mark.parametrize(
    ("form", "name", "says"),
    [
        *((form, "mine", TAKEN) for form in ("mcap", "npz", "mat")),
        ("csv", "mine.csv", r"^--out: .*mine\.csv is no folder$"),
    ],
)
def test_an_export_replaces_no_file_that_is_there(
    form: str, name: str, says: str, tmp_path: Path
) -> None:
    (mine := tmp_path / name).write_text("an hour's work")
    with pytest.raises(ConfigError, match=says):
        export_command(recorded()[0], form, [], mine)
    assert mine.read_text() == "an hour's work"


@pytest.mark.parametrize("form", ["csv", "mcap", "npz"])
def test_an_export_says_that_it_could_not_write_and_where(form: str) -> None:
    with pytest.raises(ConfigError, match=r"^--out: cannot write .*null/a"):
        export_command(recorded()[0], form, [], Path("/dev/null") / f"a{SUFFIXES[form]}")


def test_a_recording_that_is_not_there_is_what_export_names() -> None:
    with pytest.raises(ConfigError, match=r"^LOG: cannot read nosuch\.mcap: No such file"):
        export_command(Path("nosuch.mcap"), "csv", ["errors"], None)


def test_a_file_that_is_no_recording_is_told_of(tmp_path: Path) -> None:
    other = tmp_path / "x.mcap"
    for content in (b"", b"\x89MCAP0\r\n", b"MCAP" * 100, b"\x89MCAP0\r\n" + b"\0" * 100):
        other.write_bytes(content)
        with pytest.raises(
            NoRecording, match=r"MCAP file|cut off before|damaged at byte \d+, before its flight"
        ):
            Recording(other)
    whole = BytesIO(recorded()[0].read_bytes())
    assert next(iter(make_reader(whole).iter_metadata())).name == "about"


def test_a_recording_ends_as_its_flight_did(tmp_path: Path) -> None:
    def ended(
        name: str, *overrides: str, duration_s: float
    ) -> tuple[dict[str, str], list[LineRecord]]:
        world, config = prepare(SCENARIOS["paper"], list(overrides))
        run = RunFolder(tmp_path / name, config, world, scenario="paper", seed=0)
        records: list[Record] = []

        def give(record: Record) -> None:
            records.append(record)
            run.give(record)

        result = fly(world, config, seed=0, duration_s=duration_s, give=give)
        run.close({"completed": result.completed, "why": result.why})
        recording = Recording(tmp_path / name / RECORDING)
        list(recording.entries())
        return recording.result, [record for record in records if isinstance(record, LineRecord)]

    cut_off, told = ended("a", duration_s=1.0)
    assert (cut_off["state"], cut_off["reason"]) == ("tracking", "flown to the end")
    assert not any("Cancelled" in one.text or one.state == "aborted" for one in told)
    landed, _ = ended("b", "flight.duration_s=1.0", "trajectory.altitude_m=0.0", duration_s=30.0)
    assert (landed["state"], landed["reason"]) == ("landed", "landed and disarmed")


def test_a_flight_that_fails_is_recorded_up_to_its_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: Any, give: Callable[[Record], None], **__: Any) -> None:
        for n in range(507):
            give(LineRecord(0.001 * n, "tracking", f"line {n}"))
        raise ZeroDivisionError

    monkeypatch.setattr("sim.runs.simulation.fly", broken)
    with pytest.raises(ZeroDivisionError):
        run_here(main, "fly", "--out", tmp_path)
    assert len(list(Recording(tmp_path / "flight.mcap").entries(["/mission"]))) == 507
