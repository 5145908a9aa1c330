"""A rehearsal reaches nothing real: one table decides of each key that may hold an address."""

from pathlib import Path
from typing import Any

import pytest

from groundstation.config import (
    ConfigError,
    dump,
    example_text,
    from_dict,
    keys_of,
    parse_toml,
    shipped_texts,
    texts_of,
)
from groundstation.lab import read_fleet
from groundstation.settings import Config, ensure_served, is_rehearsal, rehearse
from groundstation.settings.settings import ADDRESSES, TEXTS
from links.io import is_loopback, parse_address

FILE = Path("my_room.toml")
MULTICAST = {"server": "192.168.10.1:1510", "interface": "192.168.10.2", "multicast": True}
WAYS = (
    {"link": {"kind": "mavlink"}},
    {"link": {"kind": "mavlink", "listen": "192.168.20.2:14540"}},
    {"link": {"kind": "mavlink", "remote": "drone.lab:14550"}},
    {"link": {"kind": "mavlink", "remote": "127.0.0.1:14550", "local_port": 14551}},
    {"link": {"kind": "mavlink", "tcp": "[fe80::1]:5760"}},
    {"link": {"kind": "mavlink", "serial": "/dev/ttyACM0"}},
    {"link": {"kind": "dsm", "port": "/dev/ttyUSB0"}},
    {"link": {"kind": "crsf", "port": "/dev/ttyUSB0"}},
    {"link": {"kind": "rf_bridge", "remote": "192.168.1.20:14600"}},
    {"pose": {"kind": "vicon", "listen": "0.0.0.0:51001"}},
    {"pose": {"kind": "natnet", **MULTICAST}},
    {"pose": {"kind": "qualisys", "server": "192.168.10.1:22223"}},
    {"pose": {"kind": "libmotioncapture", "backend": "vrpn", "hostname": "vrpn.lab:3883"}},
    {"pose": {"kind": "vision", "listen": "192.168.10.1:14560"}},
    {"pose": {"kind": "json", "listen": "192.168.10.1:51002"}},
    {"mqtt": {"enabled": True, "host": "broker.lab", "username": "me", "tls": {"enabled": True}}},
    {"status": {"path": "/run/quad.sock"}, "vehicle": {"name": "quad"}},
)


def leaves(value: object, path: str = "") -> list[tuple[str, object]]:
    if not isinstance(value, dict):
        return [(path, value)]
    items = [(f"{path}.{key}" if path else key, item) for key, item in value.items()]
    return [leaf for key, item in items for leaf in leaves(item, key)]


def test_each_key_that_may_hold_an_address_is_in_the_table_or_among_the_plain_texts() -> None:
    """A new key of free text, or a new port, belongs into ADDRESSES or else into TEXTS."""
    ports = {key for key in keys_of(Config) if key.rpartition(".")[2].endswith("port")}
    assert set(texts_of(Config)) | ports <= set(ADDRESSES) | TEXTS | {"pose.data_port"}


def test_the_table_names_no_key_that_is_gone_and_none_twice() -> None:
    assert set(ADDRESSES) | TEXTS <= set(keys_of(Config))
    assert not set(ADDRESSES) & TEXTS


def is_address(value: object) -> bool:
    return isinstance(value, str) and (":" in value or "/" in value or value == "broker.lab")


@pytest.mark.parametrize("told", WAYS, ids=str)
def test_no_address_of_the_file_is_left_in_its_rehearsal(told: dict[str, Any]) -> None:
    after = rehearse(from_dict(told, Config), FILE)
    written = dump(after)
    for _, value in leaves(told):
        assert not is_address(value) or f'"{value}"' not in written
    assert after.rehearsal is not None
    for key, value in leaves(parse_toml(written)):
        if isinstance(value, str) and key in ADDRESSES and ":" in value:
            assert is_loopback(parse_address(value)[0])
            assert value.startswith(f"{after.rehearsal.host}:2")
        elif key in ("link.serial", "link.port"):
            assert value == after.rehearsal.serial


@pytest.mark.parametrize("told", WAYS, ids=str)
def test_a_rehearsed_configuration_reads_back_the_same_and_turns_no_further(
    told: dict[str, Any],
) -> None:
    once = rehearse(from_dict(told, Config), FILE)
    again = from_dict(parse_toml(dump(once)), Config)
    assert again == once
    assert rehearse(again, FILE).link == once.link and rehearse(again, FILE).pose == once.pose


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("link.listen", "127.0.0.1:14540"),
        ("link.listen", "192.168.20.2:14540"),
        ("pose.listen", "0.0.0.0:26001"),
        ("mqtt.host", "127.0.0.1"),
        ("vehicle.name", "quad"),
        ("recording.folder", "/var/flights"),
    ],
)
def test_a_rehearsal_with_one_address_that_leads_out_of_it_is_refused_by_its_key(
    key: str, value: str
) -> None:
    data = parse_toml(dump(rehearse(from_dict({}, Config), FILE)))
    section, _, name = key.partition(".")
    data[section][name] = value
    with pytest.raises(ConfigError, match=f"^{key}: leads out of the rehearsal"):
        from_dict(data, Config)


def test_without_the_flag_nothing_is_turned_and_no_vehicle_has_the_name_of_a_rehearsal() -> None:
    for name in shipped_texts("examples"):
        if name not in ("fleet", "fleet-lab", "vehicle", "waypoints"):
            told = parse_toml(example_text(name))
            config = from_dict(told, Config)
            assert config.rehearsal is None and not is_rehearsal(config.vehicle.name)
            for key, value in leaves(told):
                if key in ADDRESSES:
                    section, _, inner = key.partition(".")
                    assert getattr(getattr(config, section), inner) == value
    for name in ("rehearsal", "rehearsal-quad"):
        with pytest.raises(ConfigError, match="kept for rehearsals"):
            from_dict({"vehicle": {"name": name}}, Config)


def test_poses_and_telemetry_that_would_come_to_one_port_are_refused() -> None:
    pose = {"kind": "vicon", "listen": "0.0.0.0:51001"}
    link = {"kind": "mavlink", "listen": "0.0.0.0:46001"}
    says = r"pose\.listen: becomes 127\..*:26001 in a rehearsal, as link\.listen does"
    with pytest.raises(ConfigError, match=says):
        rehearse(from_dict({"pose": pose, "link": link}, Config), FILE)


def test_a_rehearsed_fleet_has_a_name_a_link_and_copies_of_the_poses_for_each(
    tmp_path: Path,
) -> None:
    for name in ("fleet", "fleet-lab"):
        (tmp_path / f"{name}.toml").write_text(example_text(name))
    fleet = read_fleet(tmp_path / "fleet.toml", rehearsed=True)
    assert [member.name for member in fleet.members] == ["rehearsal-ant", "rehearsal-bee"]
    assert len({member.lab.link for member in fleet.members}) == 2
    ends = [fleet.relay_listen, *fleet.relay_targets]
    room = fleet.members[0].lab.rehearsal
    assert room is not None and len(set(ends)) == 3
    assert all(end is not None and end.startswith(f"{room.host}:") for end in ends)


def test_a_rehearsal_that_nobody_plays_opens_nothing_and_says_what_to_start(tmp_path: Path) -> None:
    room = rehearse(from_dict({}, Config), tmp_path / "my_room.toml").rehearsal
    assert room is not None
    with pytest.raises(ConfigError, match="groundstation-sim serve --config"):
        ensure_served(room, tmp_path / "my_room.toml")
