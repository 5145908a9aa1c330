"""Fleet files: what is shared, what differs, and what two vehicles can't share."""

import tomllib
from pathlib import Path
from typing import Any

import msgspec
import pytest
import tomli_w

from groundstation.config import ConfigError, from_dict, load
from groundstation.interfaces.service.fleet import describe_core
from groundstation.lab import FleetPlan, read_fleet
from groundstation.settings import Config

LAB: dict[str, Any] = {
    "vehicle": {"mass_kg": 0.1},
    "pose": {"kind": "vicon", "listen": "0.0.0.0:51001"},
    "trajectory": {"kind": "circle", "radius_m": 0.5},
    "separation": {"distance_m": 0.7},
}
ANT: dict[str, Any] = {"name": "ant", "link": {"listen": "0.0.0.0:14541"}}
BEE: dict[str, Any] = {"name": "bee", "object": "Bee 2", "link": {"listen": "0.0.0.0:14542"}}


def told(section: Any) -> dict[str, Any]:
    found: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(section))
    return found


def fleet(
    folder: Path,
    *vehicles: dict[str, Any],
    lab: dict[str, Any] = LAB,
    sets: tuple[str, ...] = (),
    **more: Any,
) -> FleetPlan:
    (folder / "lab.toml").write_text(tomli_w.dumps(lab), "utf-8")
    file = folder / "fleet.toml"
    file.write_text(
        tomli_w.dumps({"config": "lab.toml", **more, "vehicles": list(vehicles)}), "utf-8"
    )
    return read_fleet(file, sets)


def test_each_vehicle_has_what_all_share_and_what_is_its_own(tmp_path: Path) -> None:
    own = {"vehicle": {"mass_kg": 0.1}, "trajectory": {"centre_ned": [3.0, 0.0, 0.0]}}
    ant, bee = fleet(tmp_path, ANT, {**BEE, **own}).members
    assert (ant.name, bee.name) == ("ant", "bee")
    assert (ant.lab.vehicle.name, ant.lab.vehicle.mass_kg) == ("ant", 0.1)
    assert (bee.lab.vehicle.name, bee.lab.vehicle.mass_kg) == ("bee", 0.1)
    assert told(bee.lab.trajectory)["radius_m"] == 0.5
    assert told(bee.lab.trajectory)["centre_ned"] == [3.0, 0.0, 0.0]
    assert (told(ant.lab.pose)["object"], told(bee.lab.pose)["object"]) == ("ant", "Bee 2")
    assert ant.lab.separation.others == ("Bee 2",)
    assert bee.lab.separation.others == ("ant",)
    assert bee.lab.separation.distance_m == 0.7


def test_a_section_of_another_kind_takes_the_place_of_the_whole(tmp_path: Path) -> None:
    ant, bee = fleet(tmp_path, ANT, {**BEE, "trajectory": {"kind": "hold"}}).members
    assert ant.lab.trajectory.__struct_config__.tag == "circle"
    assert bee.lab.trajectory.__struct_config__.tag == "hold"


def test_poses_that_come_to_one_port_are_handed_on_and_the_lab_s_own_address_is_what_guards_see(
    tmp_path: Path,
) -> None:
    found = fleet(tmp_path, ANT, BEE, relay_port=52000)
    assert found.relay_listen == "0.0.0.0:51001"
    assert found.relay_targets == ("127.0.0.1:52000", "127.0.0.1:52001")
    assert [told(one.lab.pose)["listen"] for one in found.members] == ["0.0.0.0:51001"] * 2


def test_who_asks_its_server_by_itself_needs_no_relay(tmp_path: Path) -> None:
    found = fleet(tmp_path, ANT, BEE, lab={"pose": {"kind": "natnet"}})
    assert found.relay_listen is None
    assert [told(one.core.pose)["name"] for one in found.members] == ["ant", "Bee 2"]
    assert found.members[0].core == found.members[0].lab


def test_overrides_are_for_every_vehicle(tmp_path: Path) -> None:
    found = fleet(tmp_path, ANT, BEE, sets=("flight.duration_s=7",))
    assert [one.lab.flight.duration_s for one in found.members] == [7, 7]


def test_the_configuration_that_is_shown_is_the_core_s(tmp_path: Path) -> None:
    found = fleet(tmp_path, ANT, BEE)
    text = describe_core(found, found.members[1])
    assert (
        "# Its poses come from: groundstation fleet relay 0.0.0.0:51001 --to 127.0.0.1:51101 --to "
        "127.0.0.1:51102" in text
    )
    (tmp_path / "bee.toml").write_text(text, "utf-8")
    assert from_dict(tomllib.loads(text), Config) == found.members[1].core


WRONG: list[tuple[dict[str, Any], tuple[str, ...]]] = [
    ({"name": "ant", "object": "x"}, ("vehicle ant", "name", "ant's already")),
    ({"object": "ant"}, ("vehicle bee", "object", "'ant' is ant's already")),
    ({"link": {"listen": "127.0.0.1:14541"}}, ("vehicle bee", "link.listen", "'14541' is ant's")),
    ({"link": {"listen": "0.0.0.0:51101"}}, ("vehicle bee", "link.listen", "taken by the poses")),
    ({"link": {"listen": "0.0.0.0:51001"}}, ("vehicle bee", "link.listen", "taken by the poses")),
    ({"pose": {"listen": "0.0.0.0:51009"}}, ("vehicle bee", "pose", "same source as ant's")),
    ({"pose": {"kind": "mavlink"}}, ("pose.kind", "must see the others")),
    ({"vehicle": {"mass": 1.0}}, ("vehicle bee", "vehicle.mass", "did you mean mass_kg?")),
    ({"vehicel": {}}, ("vehicle bee", "vehicel", "unknown section")),
    ({"pose": 3}, ("vehicle bee", "pose", "expected a table")),
]
"""What is wrong with a second vehicle."""
DSM = {"kind": "dsm", "port": "/dev/ttyUSB0"}
REMOTE = {"remote": "10.0.0.9:14550"}
HOSTS = [
    {**who, "pose": {"kind": "libmotioncapture", "hostname": host}}
    for who, host in ((ANT, "a"), (BEE, "b"))
]
SERVED = [
    {"name": name, "link": {"listen": f"127.0.0.1:{port}"}, "status": {"path": "/x"}}
    for name, port in (("bee", 9998), ("cat", 9999))
]
BOTH = ("ant", "bee")
WRONG_FLEETS: list[tuple[list[dict[str, Any]], dict[str, Any], tuple[str, ...]]] = [
    *(([ANT, {**BEE, **bee}], {}, says) for bee, says in WRONG),
    ([{"name": "ant"}, {"name": "bee"}], {}, ("vehicle bee", "link.listen", "'14540' is ant's")),
    ([{"name": n, "link": DSM} for n in BOTH], {}, ("vehicle bee", "link.port", "is ant's")),
    ([{"name": n, "link": REMOTE} for n in BOTH], {}, ("vehicle bee", "link.remote", "is ant's")),
    (HOSTS, {}, ("vehicle bee", "pose", "same source as ant's")),
    ([ANT, *SERVED], {}, ("vehicle cat", "status.path")),
    ([{**ANT, "link": 3}, BEE], {}, ("vehicle ant", "link", "expected a table")),
    ([{"link": {}}], {}, ("vehicles[0].name", "missing")),
    ([{"name": "a b"}], {}, ("vehicles[0].name", "matching")),
    ([{"name": 7}], {}, ("vehicles[0].name", "expected a string")),
    ([], {}, ("vehicles", "an array of at least 1 value")),
    ([ANT, BEE], {"relay_port": 51000}, ("relay_port", "51000 to 51001 take pose.listen")),
    ([ANT, BEE], {"relay_port": 80}, ("relay_port", ">= 1024")),
    ([ANT], {"speed": 3}, ("speed", "unknown key")),
]


@pytest.mark.parametrize(("vehicles", "more", "says"), WRONG_FLEETS)
def test_what_can_not_be_is_refused_by_vehicle_and_key(
    tmp_path: Path, vehicles: list[dict[str, Any]], more: dict[str, Any], says: tuple[str, ...]
) -> None:
    with pytest.raises(ConfigError) as refused:
        fleet(tmp_path, *vehicles, **more)
    for words in (*says, str(tmp_path)):
        assert words in str(refused.value)


def test_a_fleet_file_taken_for_a_configuration_is_told_the_command_that_flies_it(
    tmp_path: Path,
) -> None:
    fleet(tmp_path, ANT, BEE)
    with pytest.raises(ConfigError, match="this is a fleet file: `groundstation fleet` flies it"):
        load(tmp_path / "fleet.toml", Config)
