"""Configuration: what is accepted or refused in which words, overrides, and back to TOML."""

import math
import pickle
import tomllib
from itertools import permutations
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import msgspec
import pytest
from hypothesis import given, strategies as st

from groundstation.config import (
    RETIRED_KEYS,
    ConfigError,
    RetiredKeyWarning,
    UserCodeFault,
    dump,
    errors,
    from_dict,
    keys_of,
    load,
)
from groundstation.config.config_notices import config_notice
from groundstation.config.schema import suggest
from groundstation.core.geometry import World
from groundstation.core.trajectory.shapes import CircleConfig, HoldConfig
from groundstation.settings import Config

Positive = Annotated[float, msgspec.Meta(gt=0)]


class Strict(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A section as the project's own are."""


class Udp(Strict, frozen=True, tag_field="kind", tag="udp"):
    address: Annotated[
        str, msgspec.Meta(description="Where to send [host:port]. The rest is detail.")
    ] = "127.0.0.1:1"
    rate_hz: Annotated[float, msgspec.Meta(ge=10, le=500)] = 100.0


class Radio(Strict, frozen=True, tag_field="kind", tag="radio"):
    device: str
    channel: Annotated[int, msgspec.Meta(ge=1, le=8)] = 1

    def __post_init__(self) -> None:
        if self.device == "/dev/null":
            raise ValueError("device: /dev/null hears nothing")


class Vehicle(Strict, frozen=True):
    name: Annotated[str, msgspec.Meta(pattern="^[a-z]+$")] = "mqx"
    mass_kg: Annotated[Positive, msgspec.Meta(description="With battery [kg].")] = 0.08
    limits_deg_s: tuple[Positive, Positive, Positive] = (200.0, 200.0, 300.0)
    arms: int = 4
    lag_s: Positive | None = None
    model: Literal["paper", "raw"] = "paper"
    armed: bool = False


class Step(Strict, frozen=True):
    at_s: float
    link: Udp | Radio = Udp()


class Root(Strict, frozen=True):
    vehicle: Vehicle = Vehicle(arms=6)
    link: Udp | Radio = Udp(address="127.0.0.1:2", rate_hz=50.0)
    steps: tuple[Step, ...] = ()
    names: dict[str, Vehicle] = {}
    wait: float | Literal["forever"] = "forever"
    points: Annotated[tuple[float, ...], msgspec.Meta(min_length=2)] = (0.0, 1.0)


class Needy(Strict, frozen=True):
    link: Udp | Radio
    vehicle: Vehicle
    radio: Radio


POSITIVE = "vehicle.mass_kg: expected a number > 0"
KINDS = "link.kind: expected one of ['udp', 'radio']"
REFUSED = {
    "vehicle.mass_kg = -3": f"{POSITIVE}, got -3",
    "vehicle.mass_kg = 'fast'": f"{POSITIVE}, got 'fast'",
    "vehicle.mass_kg = true": f"{POSITIVE}, got true",
    "vehicle.mass_kg = nan": f"{POSITIVE}, got nan",
    "vehicle.mass_kg = inf": f"{POSITIVE}, got inf",
    "vehicle.mass_kg = 1" + "0" * 400: f"{POSITIVE}, got a number of more than 40 digits",
    "vehicle.mass_kg = {x = 1}": f"{POSITIVE}, got a table",
    "vehicle.lag_s = 0": "vehicle.lag_s: expected a number > 0, got 0",
    "vehicle.arms = 4.0": "vehicle.arms: expected a whole number, got 4.0",
    "vehicle.armed = 1": "vehicle.armed: expected true or false, got 1",
    "vehicle.name = 'B 1'": "vehicle.name: expected a string matching ^[a-z]+$, got 'B 1'",
    "vehicle.model = 'papr'": "vehicle.model: expected one of ['paper', 'raw'], got 'papr'; "
    "did you mean paper?",
    "vehicle.mas_kg = 1": "vehicle.mas_kg: unknown key; did you mean mass_kg? "
    "(known: name, mass_kg, limits_deg_s, arms, lag_s, model, armed)",
    "vehicle.limits_deg_s = [1, 2]": "vehicle.limits_deg_s: expected an array of 3 values, "
    "each a number > 0, got [1, 2]",
    "vehicle.limits_deg_s = [1, 0, 2]": "vehicle.limits_deg_s[1]: expected a number > 0, got 0",
    "vehicle = 3": "vehicle: expected a table, got 3",
    "vehicles.x = 1": "vehicles: unknown section; did you mean vehicle? "
    "(known: vehicle, link, steps, names, wait, points)",
    "link.kind = 'pigeon'": f"{KINDS}, got 'pigeon'",
    "link.kind = 'rado'": f"{KINDS}, got 'rado'; did you mean radio?",
    "link.kind = 3": f"{KINDS}, got 3",
    "link.kind = ['udp']": f"{KINDS}, got ['udp']",
    "link.kind = 'radio'": "link.device: missing; expected a string",
    "link = {kind = 'radio', device = 'a', channel = 9}": "link.channel: expected a whole number "
    ">= 1 and <= 8, got 9",
    "link = {kind = 'radio', device = '/dev/null'}": "link.device: /dev/null hears nothing",
    "link.device = 'a'": "link.device: unknown key (known: kind, address, rate_hz)",
    "steps = [{at_s = 1}, {at = 2}]": "steps[1].at: unknown key; did you mean at_s? "
    "(known: at_s, link)",
    "steps = [{at_s = 1}, {}]": "steps[1].at_s: missing; expected a number",
    "steps = [{at_s = 1, link = {kind = 'udp', rate_hz = 1}}]": "steps[0].link.rate_hz: "
    "expected a number >= 10 and <= 500, got 1",
    "names.b.mass_kg = 0": "names.b.mass_kg: expected a number > 0, got 0",
    "wait = 'never'": "wait: expected a number or one of ['forever'], got 'never'; "
    "did you mean forever?",
    "points = [1]": "points: expected an array of at least 2 values, each a number, got [1]",
    "points = [1, [2]]": "points[1]: expected a number, got [2]",
}
"""What stands in a file, and what is said of it."""


AXES = get_args(World)
NO_AXES = {"".join(letters) for letters in permutations("neswud", 3)} - {*AXES}


@pytest.mark.parametrize("written", ["ne", *sorted(NO_AXES)])
def test_no_axes_are_suggested_for_others(written: str) -> None:
    assert suggest(written, AXES) == ""


def test_a_word_is_suggested_where_it_alone_is_near() -> None:
    assert suggest("form", ["ned", "from"]) == "; did you mean from?"
    assert suggest("at", ["at_s", "link"]) == "; did you mean at_s?"
    assert suggest("k4", ["k2", "k3"]) == "", "both are equally near"
    assert suggest("pigeon", ["udp", "radio"]) == "", "none is near"


@pytest.mark.parametrize(("text", "line"), REFUSED.items(), ids=REFUSED.values())
def test_a_bad_value_is_refused_in_one_line_that_says_where_and_what_is_accepted(
    text: str, line: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        from_dict(tomllib.loads(text), Root, source="lab.toml")
    assert str(caught.value) == f"lab.toml: {line}"


WHOLE: dict[str, Any] = {"link": {"kind": "udp"}, "vehicle": {}, "radio": {"device": "x"}}
MISSING = {
    "link": "link: missing; expected a table with kind, one of ['udp', 'radio']",
    "vehicle": "vehicle: missing; expected a table",
    "radio": "radio: missing; expected a table with device",
    "link.kind": "link.kind: missing; expected one of ['udp', 'radio']",
}


@pytest.mark.parametrize(("key", "line"), MISSING.items(), ids=MISSING)
def test_what_is_required_and_missing_is_named(key: str, line: str) -> None:
    assert from_dict(WHOLE, Needy).vehicle == Vehicle()
    given = {name: value for name, value in WHOLE.items() if name != key}
    with pytest.raises(ConfigError) as caught:
        from_dict(given | {"link": {}} if key == "link.kind" else given, Needy)
    assert str(caught.value) == line


def test_a_table_keeps_the_defaults_of_its_place_for_the_keys_it_leaves_out() -> None:
    assert from_dict({}, Root) == load(None, Root) == Root()
    config = from_dict({"vehicle": {"mass_kg": 2}, "link": {"rate_hz": 20}}, Root)
    assert config.vehicle == Vehicle(arms=6, mass_kg=2.0)
    assert isinstance(config.vehicle.mass_kg, float)
    assert config.link == Udp(address="127.0.0.1:2", rate_hz=20.0)
    assert from_dict({"link": {"kind": "udp"}}, Root).link == Root().link
    assert from_dict({"link": {"kind": "radio", "device": "x"}}, Root).link == Radio(device="x")


OVERRIDES: dict[str, dict[str, Any]] = {
    "vehicle.mass_kg=0.1": {"vehicle": {"mass_kg": 0.1}},
    "vehicle.mass_kg = 0.1": {"vehicle": {"mass_kg": 0.1}},
    "vehicle.mass_kg=.1": {"vehicle": {"mass_kg": 0.1}},
    "vehicle.mass_kg=2.": {"vehicle": {"mass_kg": 2.0}},
    "vehicle.armed=true": {"vehicle": {"armed": True}},
    "vehicle.limits_deg_s=[1, 2.5, 3]": {"vehicle": {"limits_deg_s": [1, 2.5, 3]}},
    "vehicle.name=quad": {"vehicle": {"name": "quad"}},
    'vehicle.name="quad"': {"vehicle": {"name": "quad"}},
    "link.address=127.0.0.1:14540": {"link": {"address": "127.0.0.1:14540"}},
    "link.address=a=b": {"link": {"address": "a=b"}},
    "link.address=": {"link": {"address": ""}},
    "link.rate_hz=20": {"link": {"rate_hz": 20}},
    'link={kind="radio", device="x"}': {"link": {"kind": "radio", "device": "x"}},
    "names.b.mass_kg=3": {"names": {"b": {"mass_kg": 3}}},
    "steps=[{at_s=1}]": {"steps": [{"at_s": 1}]},
    "wait=forever": {"wait": "forever"},
}


@pytest.mark.parametrize(("override", "data"), OVERRIDES.items(), ids=OVERRIDES)
def test_an_override_equals_the_same_key_in_the_file(override: str, data: dict[str, Any]) -> None:
    assert from_dict({}, Root, [override]) == from_dict(data, Root)


def test_an_override_of_a_sections_kind_keeps_the_keys_of_the_file_that_fit() -> None:
    lab = {"trajectory": {"kind": "lemniscate", "speed_m_s": 0.7, "scale_m": 0.4, "yaw_deg": 20.0}}
    flown = from_dict(lab, Config, ["trajectory.kind=circle"]).trajectory
    assert flown == CircleConfig(speed_m_s=0.7, yaw_deg=20.0)
    lab = {"trajectory": {"scale_m": 0.4}}  # of the default kind
    assert from_dict(lab, Config, ["trajectory.kind=hold"]).trajectory == HoldConfig()
    assert lab == {"trajectory": {"scale_m": 0.4}}


UNREADABLE: list[tuple[bytes, str]] = [
    (b"[vehicle]\nmass_kg = = 3\n", "not valid TOML: Invalid value (at line 2, column 11)"),
    (b"wait = 3\ncount = " + 5000 * b"1", "line 2: a number of more than 4,300 digits"),
    (b"\n", "empty: what wrote it may not have finished"),
    (b"name = '\xff'", "not UTF-8 text (byte 8): save it as UTF-8"),
]


@pytest.mark.parametrize(("data", "says"), UNREADABLE, ids=[says for _, says in UNREADABLE])
def test_a_file_that_is_no_toml_is_refused_with_the_place_of_its_mistake(
    tmp_path: Path, data: bytes, says: str
) -> None:
    path = tmp_path / "lab.toml"
    path.write_bytes(data)
    with pytest.raises(ConfigError) as caught:
        load(path, Root)
    assert str(caught.value).startswith(f"{path}: {says}")


def test_a_file_may_say_nothing_or_begin_as_notepad_writes_it_and_one_that_is_missing_is_named(
    tmp_path: Path,
) -> None:
    path = tmp_path / "lab.toml"
    with pytest.raises(ConfigError) as caught:
        load(path, Root)
    assert str(caught.value) == f"{path}: cannot read the configuration: No such file or directory"
    with pytest.raises(ConfigError, match="Is a directory"):
        load(tmp_path, Root)
    with pytest.raises(ConfigError, match="/dev/zero: larger than 64 MB, or endless"):
        load(Path("/dev/zero"), Root)
    path.write_text("# all as it is by default\n")
    assert load(path, Root) == Root()
    path.write_bytes(b"\xef\xbb\xbfwait = 3")
    assert load(path, Root).wait == 3


def test_what_is_dumped_tells_the_meaning_of_each_key_and_loads_to_the_same(tmp_path: Path) -> None:
    config = Root(
        vehicle=Vehicle(name="a", mass_kg=1.5, lag_s=0.1),
        link=Radio(device='odd "name" \\ \n'),
        steps=(Step(at_s=1.0), Step(at_s=2.0, link=Radio(device="y"))),
        names={"plain": Vehicle(), "with a.dot": Vehicle(arms=3)},
        wait=3.5,
    )
    text = dump(config)
    path = tmp_path / "dumped.toml"
    path.write_text(text)
    assert load(path, Root) == config
    assert "mass_kg = 1.5  # With battery [kg]." in text
    assert 'address = "127.0.0.1:2"  # Where to send [host:port].\n' in dump(Root())
    assert "# lag_s is not set" in dump(Root())


FINITE = st.floats(allow_nan=False, allow_infinity=False)
VEHICLES = st.builds(
    Vehicle,
    name=st.from_regex("^[a-z]+$", fullmatch=True),
    mass_kg=FINITE.filter(lambda x: x > 0),
    arms=st.integers(-(2**63) + 1, 2**63 - 1),
    lag_s=st.none() | st.floats(1e-9, 10),
    model=st.sampled_from(["paper", "raw"]),
    armed=st.booleans(),
)
LINKS = st.builds(Udp, address=st.text(), rate_hz=st.floats(10, 500)) | st.builds(
    Radio, device=st.text().filter(lambda text: text != "/dev/null"), channel=st.integers(1, 8)
)
ROOTS = st.builds(
    Root,
    vehicle=VEHICLES,
    link=LINKS,
    steps=st.lists(st.builds(Step, at_s=FINITE, link=LINKS), max_size=3).map(tuple),
    names=st.dictionaries(st.text(), VEHICLES, max_size=3),
    wait=st.just("forever") | FINITE,
    points=st.lists(FINITE, min_size=2, max_size=5).map(tuple),
)


@given(ROOTS)
def test_dump_and_load_are_inverse(config: Root) -> None:
    assert from_dict(tomllib.loads(dump(config)), Root) == config


WORDS = st.sampled_from(["udp", "radio", "paper"]) | st.text(max_size=5)
KEYS = st.sampled_from(["kind", "device", "address", "mass_kg", "at_s", "link", "x"])
SECTIONS = st.sampled_from(["vehicle", "link", "steps", "names", "wait", "points", "x"])
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | WORDS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(KEYS, inner, max_size=4),
    max_leaves=8,
)


@given(st.dictionaries(SECTIONS, VALUES))
def test_any_data_give_a_valid_configuration_or_one_line_of_complaint(data: dict[str, Any]) -> None:
    try:
        config = from_dict(data, Root)
    except ConfigError as error:
        assert error.key
        assert "\n" not in str(error)
    else:
        assert msgspec.convert(msgspec.to_builtins(config), Root) == config
        assert math.isfinite(config.vehicle.mass_kg)


@pytest.mark.filterwarnings("ignore::groundstation.config.RetiredKeyWarning")
@given(st.text())
def test_any_override_text_is_taken_or_refused_as_a_configuration_error(text: str) -> None:
    for override in (text, f"vehicle.mass_kg={text}", f"{text}=1", f"link.address={text}"):
        try:
            from_dict({}, Root, [override])
        except ConfigError as error:
            assert "--set" in str(error)


def test_a_key_a_password_or_a_certificate_is_beside_the_configuration_wherever_one_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Names(Strict, frozen=True):
        key_file: str = "from the default"
        ca_file: str = ""
        where: str = ""

    class Keys(Strict, frozen=True):
        mqtt: Names = Names()
        clients: dict[str, Names] = {}

    (tmp_path / "lab").mkdir()
    file = tmp_path / "lab" / "lab.toml"
    file.write_text(
        '[mqtt]\nkey_file = "a.key"\nca_file = ""\nwhere = "b"\n[clients.c]\nkey_file = '
        '"/etc/c.key"\n'
    )
    monkeypatch.chdir(tmp_path)
    config = load(Path("lab/lab.toml"), Keys)
    assert config.mqtt == Names(key_file=str(tmp_path / "lab" / "a.key"), where="b")
    assert config.clients["c"].key_file == "/etc/c.key"
    (tmp_path / "again.toml").write_text(dump(config))
    assert load(tmp_path / "again.toml", Keys) == config
    assert load(file, Keys, ["mqtt.key_file=z.key"]).mqtt.key_file == "z.key"


ADVICE = {"vehicle.arm_length_m": "The mixer needs none.", "pilot": "Its limits are in [guards]."}


def test_a_key_of_an_earlier_version_is_ignored_with_a_word_of_advice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for key, advice in ADVICE.items():
        monkeypatch.setitem(RETIRED_KEYS, key, advice)
    file = tmp_path / "old.toml"
    file.write_text("[vehicle]\narm_length_m = 0.1\narms = 3\n[pilot]\nx = 1\n")
    with pytest.warns(RetiredKeyWarning) as told:
        assert load(file, Root).vehicle == Vehicle(arms=3)
    assert [str(each.message) for each in told] == [
        f"{file}: vehicle.arm_length_m: no longer used, ignored. The mixer needs none.",
        f"{file}: pilot: no longer used, ignored. Its limits are in [guards].",
    ]
    with pytest.warns(RetiredKeyWarning, match=r"--set: vehicle\.arm_length_m: no longer used"):
        assert load(None, Root, ["vehicle.arm_length_m=2"]) == Root()
    with pytest.raises(ConfigError, match=r"vehicle\.arm_lengt_m: unknown key"):
        from_dict({"vehicle": {"arm_lengt_m": 1}}, Root)


def test_no_key_that_is_read_is_retired() -> None:
    known = keys_of(Config)
    assert [
        key for key in RETIRED_KEYS if any(f"{one}.".startswith(f"{key}.") for one in known)
    ] == []


SENTENCE = config_notice("file.exists", path="lab.toml")

RAISED = (
    errors.ConfigError("vehicle.mass_kg", "too light", "lab.toml"),
    errors.ConfigError("--out", SENTENCE),
    errors.ArgumentError("--workers", SENTENCE),
    errors.ArgumentError("--set", "expected key=value"),
    errors.Problem(("link", "kind"), SENTENCE),
)


@pytest.mark.parametrize("error", RAISED, ids=lambda error: f"{type(error).__name__}: {error}")
def test_an_error_is_the_same_after_it_was_pickled(error: Exception) -> None:
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error)
    assert str(again) == str(error)
    assert vars(again) == vars(error)


def test_a_fault_in_the_users_code_brings_the_users_frames_and_none_of_the_worker() -> None:
    try:
        raise RuntimeError("no gains for this vehicle")
    except RuntimeError as error:
        fault = UserCodeFault("controller mine:Bad", error)
    again = pickle.loads(pickle.dumps(fault))
    again.__cause__ = RuntimeError("frames of the pool of workers")
    assert str(again) == "controller mine:Bad failed: RuntimeError: no gains for this vehicle"
    assert again.frames() == fault.frames()
    assert again.frames().endswith("RuntimeError: no gains for this vehicle\n")


def test_a_wrong_value_of_the_users_code_brings_no_frames() -> None:
    again = pickle.loads(pickle.dumps(UserCodeFault("controller mine:Bad returned 3")))
    again.__cause__ = RuntimeError("frames of the pool of workers")
    assert (str(again), again.frames()) == ("controller mine:Bad returned 3", "")


def test_a_file_of_a_folder_that_can_not_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "results.csv").mkdir()
    with (
        pytest.raises(
            errors.ConfigError, match=r"^--out: cannot write .*results\.csv: Is a directory$"
        ),
        errors.refuse_io("--out", "file.unwritten", tmp_path),
    ):
        (tmp_path / "results.csv").write_text("a table")
