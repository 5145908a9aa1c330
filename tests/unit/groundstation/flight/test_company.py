"""What is beside a vehicle before it is armed: other flights of this machine, and other bodies of the room."""

from typing import Any

import pytest

from groundstation.config import from_dict
from groundstation.core.messages import Check, Others, Verdict
from groundstation.flight.preflight import Company, entry_of
from groundstation.machine import Running
from groundstation.settings import Config
from tests.unit.groundstation.flight.test_checks import standing

BASE: dict[str, Any] = {
    "vehicle": {"name": "ant"},
    "pose": {"kind": "vicon", "object": "ant", "listen": "0.0.0.0:51001"},
    "link": {"kind": "mavlink", "listen": "127.0.0.1:14540"},
}
OTHER: dict[str, Any] = {
    "vehicle": {"name": "bee"},
    "pose": {"kind": "vicon", "object": "bee", "listen": "0.0.0.0:51001"},
    "link": {"kind": "mavlink", "listen": "127.0.0.1:14541"},
}


def config_of(table: dict[str, Any]) -> Config:
    return from_dict(table, Config)


def beside(*others: dict[str, Any]) -> Check:
    running = [entry_of(config_of(other), "daemon", 77) for other in others]
    return Company(config_of(BASE), None, lambda: running, None)(standing(), 1.0)[0]


@pytest.mark.parametrize(
    ("change", "verdict", "says"),
    [
        ({}, Verdict.PASS, "none of this machine"),
        ({"pose": BASE["pose"]}, Verdict.FAIL, "daemon bee (process 77) follows the body 'ant' as well"),
        ({"pose": {**BASE["pose"], "listen": "0.0.0.0:51002"}}, Verdict.WARN, "follows the body 'ant' as well"),
        ({"link": BASE["link"]}, Verdict.FAIL, "commands mavlink 127.0.0.1:14540 system 1 as well"),
        ({"link": {**BASE["link"], "target_system": 2}}, Verdict.PASS, "none of this machine"),
        ({"vehicle": BASE["vehicle"]}, Verdict.WARN, "has the same name"),
        ({"pose": {"kind": "mavlink"}}, Verdict.PASS, "none of this machine"),
    ],
)
def test_equal_names_of_running_flights_are_told(change: dict[str, Any], verdict: Verdict, says: str) -> None:
    seen = beside({**OTHER, **change})
    assert seen.verdict is verdict
    assert says in seen.says


def test_a_bridge_is_compared_by_its_port() -> None:
    bridge = Running(pid=77, command="rf-bridge", vehicle="0.0.0.0:14600", link="crsf /dev/ttyUSB0")
    config = config_of({**BASE, "link": {"kind": "crsf", "port": "/dev/ttyUSB0"}})
    assert Company(config, None, lambda: [bridge], None)(standing(), 1.0)[0].verdict is Verdict.FAIL


def bodies_near(places: dict[str, tuple[float, float, float]], now_s: float = 1.0, size_m: float = 0.3) -> Check:
    config = from_dict({**BASE, "vehicle": {"name": "ant", "size_m": size_m}}, Config)
    bodies = Others((), own="ant")
    for name, place in places.items():
        if name in bodies:
            bodies.see(name, 1.0, place)
    return Company(config, bodies, tuple, None)(standing(), now_s)[1]


def test_a_body_nearer_than_the_vehicles_size_fails_with_both_names_and_the_distance() -> None:
    seen = bodies_near({"bee": (0.5, 0.0, 0.0), "cat": (0.12, 0.16, 0.0)})
    assert seen.verdict is Verdict.FAIL
    assert seen.says.startswith("'cat' is 0.20 m from 'ant', less than vehicle.size_m (0.3 m)")


@pytest.mark.parametrize(
    ("places", "now_s", "says"),
    [
        ({}, 1.0, "no other body in sight"),
        ({"ant": (0.0, 0.0, 0.0)}, 1.0, "no other body in sight"),
        ({"bee": (0.31, 0.0, 0.0)}, 1.0, "'bee' is 0.31 m from 'ant', the nearest"),
        ({"bee": (0.0, 0.0, 0.0)}, 1.6, "no other body in sight"),
    ],
)
def test_bodies_that_are_far_or_not_seen_any_more_pass(
    places: dict[str, tuple[float, float, float]], now_s: float, says: str
) -> None:
    seen = bodies_near(places, now_s)
    assert (seen.verdict, seen.says) == (Verdict.PASS, says)


def test_once_it_takes_off_only_those_count_that_are_looked_for() -> None:
    bodies = Others(("bee",), own="ant")
    assert ("bee" in bodies, "cat" in bodies, "ant" in bodies) == (True, True, False)
    bodies.see("cat", 1.0, (1.0, 0.0, 0.0))
    assert (bodies.names, bodies.bodies) == (("bee",), ("bee", "cat"))
    assert bodies.unseen(0.0) == ("bee",)
    Company(config_of(BASE), bodies, tuple, None).leave()
    assert ("bee" in bodies, "cat" in bodies, "dog" in bodies) == (True, False, False)
