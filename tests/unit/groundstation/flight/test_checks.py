"""Every pre-flight check: what passes, warns and fails, by the vehicle as it stands and by what is
beside it.
"""

import math
import os
import random
from typing import Any

import msgspec
import pytest

from groundstation.config import ConfigError, from_dict
from groundstation.core.geometry.so3 import from_euler_zyx
from groundstation.core.messages import Check, Others, Pose, PoseStatus, Verdict
from groundstation.core.safety import Agreement, StandingPoses
from groundstation.flight.preflight import (
    Checks,
    Company,
    describe_checks,
    describe_failures,
    describe_trajectory,
    ensure_guarded,
    entry_of,
    examine_trajectory,
)
from groundstation.flight.preflight.configuration import find_real_key
from groundstation.machine import Running
from groundstation.settings import Config
from links.core import LinkStatus

BASE: dict[str, Any] = {
    "pose": {"kind": "vicon", "rate_hz": 50.0},
    "trajectory": {"kind": "hold", "position_ned": [0.0, 0.0, -1.0]},
}
LINK = LinkStatus(
    state="connected", sent=0, expired=0, received=9, dropped={}, text="", rtt_s=0.004
)
FENCE = {"kind": "box", "north_m": [-2.0, 2.0], "east_m": [-2.0, 2.0], "height_m": 2.0}


def standing(
    rate_hz: float = 50.0,
    *,
    tilt_deg: float = 0.0,
    drift_m: float = 0.0,
    down: float = 0.0,
    noise_deg: float = 0.0,
) -> StandingPoses:
    """A vehicle that has stood for a second until t = 1 s."""
    stands, dice = StandingPoses(), random.Random(1)
    count = int(rate_hz) + 1
    for i in range(count):
        t = i / rate_hz
        roll, pitch = (math.radians(dice.gauss(mean, noise_deg)) for mean in (tilt_deg, 0.0))
        stands.add(Pose(i, t, t, (drift_m * t, 0.0, down), from_euler_zyx(roll, pitch, 0.0)))
    return stands


def status_of(stands: StandingPoses) -> PoseStatus:
    return PoseStatus(accepted=len(stands.poses), dropped={})


def check(
    name: str,
    *,
    config: dict[str, Any] | None = None,
    stands: StandingPoses | None = None,
    noise_m: float = 0.0005,
    now_s: float = 1.03,
    witness: Agreement | None = None,
    source: PoseStatus | None = None,
    **link: Any,
) -> Check:
    checks, stands = Checks(from_dict({**BASE, **(config or {})}, Config)), stands or standing()
    source = source or status_of(stands)
    seen = checks(stands, noise_m, msgspec.structs.replace(LINK, **link), now_s, witness, source)
    return next(one for one in seen if one.name == name)


GENTLE = {
    "kind": "adaptive",
    "b_bound": 1.0,
    "sigma_bound": 0.3,
    "sigma_slope": 3.0,
    "rho_slope": 1.0,
}
CASES: list[tuple[str, dict[str, Any], Verdict]] = [
    ("pose rate", {}, Verdict.PASS),
    ("pose rate", {"stands": standing(30.0)}, Verdict.WARN),
    ("pose rate", {"stands": standing(15.0)}, Verdict.FAIL),
    ("pose age", {}, Verdict.PASS),
    ("pose age", {"now_s": 1.1}, Verdict.WARN),
    ("pose age", {"now_s": 1.2}, Verdict.FAIL),
    (
        "ready to arm",
        {"unfit": "GUID_OPTIONS is 0: it would take our thrust as a climb rate"},
        Verdict.FAIL,
    ),
    ("deadline", {}, Verdict.PASS),
    (
        "deadline",
        {"config": {"flight": {"coast_s": 0.4}, "guards": {"level_s": 0.1}}},
        Verdict.PASS,
    ),
    ("deadline", {"config": {"flight": {"coast_s": 0.3}}}, Verdict.WARN),
    ("deadline", {"config": {"guards": {"level_s": 0.75}}}, Verdict.WARN),
    ("pose noise", {}, Verdict.PASS),
    ("pose noise", {"noise_m": 0.004}, Verdict.WARN),
    ("pose noise", {"noise_m": 0.006}, Verdict.FAIL),
    ("pose noise", {"noise_m": math.nan}, Verdict.FAIL),
    ("pose noise", {"stands": standing(noise_deg=0.23)}, Verdict.PASS),
    ("pose noise", {"stands": standing(noise_deg=0.7)}, Verdict.WARN),
    ("pose noise", {"stands": standing(noise_deg=1.2)}, Verdict.FAIL),
    ("pose noise", {"stands": standing(noise_deg=0.35), "noise_m": 0.006}, Verdict.FAIL),
    ("at rest", {"stands": standing(drift_m=0.02)}, Verdict.PASS),
    ("at rest", {"stands": standing(drift_m=0.1)}, Verdict.FAIL),
    ("at rest", {"stands": standing(down=-850.0)}, Verdict.FAIL),
    (
        "at rest",
        {"stands": standing(down=-850.0), "config": {"pose": {"kind": "mavlink"}}},
        Verdict.PASS,
    ),
    ("at rest", {"source": PoseStatus(accepted=50, dropped={}, origin_moves=1)}, Verdict.PASS),
    ("at rest", {"source": PoseStatus(accepted=50, dropped={}, origin_moves=2)}, Verdict.WARN),
    ("at rest", {"source": PoseStatus(accepted=50, dropped={}, origin_moves=5)}, Verdict.FAIL),
    ("tilt", {}, Verdict.PASS),
    ("tilt", {"stands": standing(tilt_deg=8.0)}, Verdict.WARN),
    ("tilt", {"stands": standing(tilt_deg=20.0)}, Verdict.FAIL),
    ("floor", {}, Verdict.PASS),
    ("floor", {"stands": standing(down=0.3)}, Verdict.FAIL),
    ("fence", {}, Verdict.OFF),
    ("fence", {"config": {"fence": FENCE}}, Verdict.PASS),
    ("fence", {"config": {"fence": {**FENCE, "north_m": [0.5, 2.0]}}}, Verdict.FAIL),
    ("ways in the fence", {}, Verdict.OFF),
    ("ways in the fence", {"config": {"fence": FENCE}}, Verdict.PASS),
    ("ways in the fence", {"config": {"fence": {**FENCE, "height_m": 0.9}}}, Verdict.FAIL),
    (
        "ways in the fence",
        {
            "config": {
                "fence": FENCE,
                "trajectory": {"kind": "hold", "position_ned": [1.99, 2.5, -1.0]},
            }
        },
        Verdict.FAIL,
    ),
    ("battery", {}, Verdict.OFF),
    ("battery", {"battery_v": 3.9}, Verdict.OFF),
    ("battery", {"battery_v": 3.9, "config": {"guards": {"battery_v": 3.5}}}, Verdict.PASS),
    ("battery", {"battery_v": 3.4, "config": {"guards": {"battery_v": 3.5}}}, Verdict.FAIL),
    ("battery", {"battery_share": 0.9}, Verdict.PASS),
    ("battery", {"battery_share": 0.3}, Verdict.WARN),
    ("battery", {"battery_share": 0.1}, Verdict.FAIL),
    ("round trip", {}, Verdict.PASS),
    ("round trip", {"rtt_s": None}, Verdict.OFF),
    ("round trip", {"rtt_s": 0.15}, Verdict.WARN),
    ("round trip", {"rtt_s": 0.25}, Verdict.FAIL),
    ("ready to arm", {}, Verdict.PASS),
    ("ready to arm", {"state": "armed"}, Verdict.FAIL),
    ("ready to arm", {"state": "lost"}, Verdict.FAIL),
    ("ready to arm", {"ready": True}, Verdict.PASS),
    ("ready to arm", {"ready": False}, Verdict.WARN),
    ("frames", {}, Verdict.OFF),
    ("frames", {"conflict": "MAVLink system 42 sends SET_ATTITUDE_TARGET, too"}, Verdict.FAIL),
    ("frames", {"warning": "the autopilot is heard from two addresses"}, Verdict.WARN),
    ("frames", {"config": {"link": {"kind": "dsm"}}}, Verdict.PASS),
    (
        "frames",
        {"config": {"link": {"kind": "dsm"}}, "warning": "no real-time priority"},
        Verdict.WARN,
    ),
    ("link drops", {}, Verdict.PASS),
    (
        "link drops",
        {"received": 1000, "dropped": {"truncated": 10, "other_system": 500}},
        Verdict.PASS,
    ),
    ("link drops", {"received": 1000, "dropped": {"truncated": 40}}, Verdict.WARN),
    ("link drops", {"received": 1000, "dropped": {"bad_signature": 1}}, Verdict.WARN),
    ("link drops", {"sent": 100, "dropped": {"full": 3}}, Verdict.WARN),
    (
        "link drops",
        {"dropped": {"other_address": 1}, "other_addresses": ("192.168.1.7:14550",)},
        Verdict.WARN,
    ),
    ("pose drops", {}, Verdict.PASS),
    (
        "pose drops",
        {"source": PoseStatus(accepted=990, dropped={"jump": 9, "other_message": 500})},
        Verdict.PASS,
    ),
    ("pose drops", {"source": PoseStatus(accepted=900, dropped={"jump": 100})}, Verdict.WARN),
    ("failsafe", {}, Verdict.OFF),
    ("failsafe", {"config": {"link": {"kind": "dsm"}}}, Verdict.WARN),
    ("thrust bound", {}, Verdict.OFF),
    ("thrust bound", {"config": {"controller": GENTLE}}, Verdict.PASS),
    ("thrust bound", {"config": {"controller": {"kind": "pid"}}}, Verdict.OFF),
    ("trajectory", {}, Verdict.PASS),
    (
        "trajectory",
        {"config": {"trajectory": {"kind": "lemniscate"}, "limits": {"max_speed_m_s": 0.3}}},
        Verdict.FAIL,
    ),
]


@pytest.mark.parametrize(("name", "given", "verdict"), CASES)
def test_each_check_has_its_verdict_and_a_sentence(
    name: str, given: dict[str, Any], verdict: Verdict
) -> None:
    found = check(name, **given)
    assert found.verdict is verdict, found.says
    assert len(found.says) > 8


AGREES = Agreement(
    alarm=0.2,
    tilt_deg=0.3,
    mounting_deg=1.2,
    agrees=True,
    disagrees_since_s=None,
    alike=(),
    unlike=(),
)
WITNESSED: list[tuple[Agreement | None, Verdict, str]] = [
    (AGREES, Verdict.PASS, "1.2° apart"),
    (AGREES._replace(alike=("roll", "pitch")), Verdict.PASS, "roll, pitch went the same way"),
    (None, Verdict.WARN, "does not send its attitude"),
    (AGREES._replace(disagrees_since_s=0.5), Verdict.WARN, "is the vehicle being carried?"),
    (AGREES._replace(mounting_deg=7.9), Verdict.PASS, "7.9° apart"),
    (AGREES._replace(mounting_deg=8.1), Verdict.FAIL, "8.1° apart: is it the right body?"),
    (AGREES._replace(unlike=("roll",)), Verdict.FAIL, "roll turned another way in the poses"),
    (AGREES._replace(unlike=("roll", "pitch")), Verdict.FAIL, "roll and pitch turned another way"),
]


@pytest.mark.parametrize(("witness", "verdict", "says"), WITNESSED)
def test_the_autopilots_attitude_is_a_second_witness(
    witness: Agreement | None, verdict: Verdict, says: str
) -> None:
    found = check("second witness", witness=witness)
    assert found.verdict is verdict
    assert says in found.says


@pytest.mark.parametrize(
    ("config", "says"),
    [
        ({"pose": {"kind": "mavlink"}}, "the poses are the autopilot's own"),
        ({"link": {"kind": "dsm", "port": "/dev/ttyUSB0"}}, "this radio does not report"),
    ],
)
def test_where_nobody_else_can_tell_the_second_witness_is_off(
    config: dict[str, Any], says: str
) -> None:
    found = check("second witness", config=config)
    assert found.verdict is Verdict.OFF
    assert says in found.says


def test_without_poses_nothing_else_is_asked_of_them() -> None:
    checks = Checks(from_dict(BASE, Config))(
        StandingPoses(), 0.0, LINK, 1.0, None, status_of(StandingPoses())
    )
    assert "poses: no poses" in describe_failures(checks)


def checked(source: PoseStatus, stands: StandingPoses, pose: dict[str, Any]) -> str:
    config = from_dict({**BASE, "pose": pose}, Config)
    return describe_failures(Checks(config)(stands, 0.0005, LINK, 1.03, None, source))


def test_stamps_in_the_wrong_unit_fail_with_the_factor_and_the_unit() -> None:
    source = PoseStatus(accepted=50, dropped={}, stamp_rate=1000.0)
    failures = checked(source, standing(), {"kind": "json"})
    assert "pose rate: the time stamps of the poses run 1000 times too fast" in failures
    assert "t is expected in seconds, and looks like milliseconds" in failures
    assert "pose rate" not in checked(source, standing(), {"kind": "vicon"}), "frames have no unit"


def test_a_second_sender_of_the_vehicle_s_poses_fails_until_it_is_gone() -> None:
    both = PoseStatus(
        accepted=50,
        dropped={"second_sender": 3},
        advice="poses of the vehicle come from two addresses",
    )
    assert "pose drops: poses of the vehicle come from two" in checked(
        both, standing(), {"kind": "json"}
    )
    gone = PoseStatus(accepted=500, dropped={"second_sender": 50})
    assert "pose drops" not in checked(gone, standing(), {"kind": "json"})


def test_a_clock_that_steps_again_and_again_fails() -> None:
    source = PoseStatus(accepted=50, dropped={}, unsteady_clock=True)
    assert "pose age: the tracker's clock stepped" in checked(source, standing(), {"kind": "json"})


def test_what_fails_is_one_sentence_and_all_of_it_a_list() -> None:
    checks = [
        Check("a", Verdict.PASS, "fine"),
        Check("b", Verdict.FAIL, "bad"),
        Check("c", Verdict.FAIL, "worse"),
    ]
    assert describe_failures(checks) == "b: bad; c: worse"
    assert len(describe_checks(checks).splitlines()) == 3


REAL: list[dict[str, Any]] = [
    {"link": {"kind": "mavlink", "listen": "0.0.0.0:14540"}},
    {"link": {"kind": "mavlink", "remote": "192.168.1.20:14540"}},
    {"link": {"kind": "mavlink", "serial": "/dev/ttyACM0"}},
    {"link": {"kind": "dsm", "port": "/dev/ttyUSB0"}},
    {"link": {"kind": "dsm", "port": "/dev/pts/3"}},
    {"link": {"kind": "crsf", "port": "/dev/ttyUSB0", "simulated": True}},
    {"link": {"kind": "mavlink", "serial": "/dev/pts/3"}},
    {"link": {"kind": "mavlink", "tcp": "sitl.example:5760"}},
    {"link": {"kind": "rf_bridge", "remote": "192.168.1.20:14600"}},
    {"pose": {"kind": "vicon", "listen": "0.0.0.0:51001"}},
    {"pose": {"kind": "natnet", "server": "127.0.0.1:1510", "interface": "192.168.1.5"}},
    {"pose": {"kind": "natnet", "server": "192.168.1.5:1510"}},
    {"pose": {"kind": "qualisys", "server": "qtm.example:22223"}},
    {"pose": {"kind": "json", "listen": "[::]:51002"}},
    {"pose": {"kind": "vision", "listen": "10.0.0.2:14551"}},
]


@pytest.mark.parametrize("data", REAL)
def test_a_real_vehicle_needs_a_fence_a_speed_limit_and_the_floor(data: dict[str, Any]) -> None:
    limits = {"max_speed_m_s": 1.0}
    assert find_real_key(from_dict(data, Config)) is not None
    for more, key in (
        ({}, "fence"),
        ({"limits": limits}, "fence"),
        ({"fence": FENCE}, "limits.max_speed_m_s"),
        ({"fence": FENCE, "limits": limits, "flight": {"start": "air"}}, "flight.start"),
    ):
        with pytest.raises(ConfigError) as error:
            ensure_guarded(from_dict({**data, **more}, Config))
        assert error.value.key == key
        assert "a real vehicle may fly here" in str(error.value)
    ensure_guarded(from_dict({**data, "fence": FENCE, "limits": limits}, Config))


LOCAL: list[dict[str, Any]] = [
    {},
    {"link": {"kind": "mavlink", "remote": "[::1]:14550"}},
    {"link": {"kind": "rf_bridge"}},
    *(
        {"pose": {"kind": kind}}
        for kind in ("vicon", "natnet", "qualisys", "json", "vision", "mavlink")
    ),
    {"pose": {"kind": "natnet", "multicast": True}},
]


@pytest.mark.parametrize("data", LOCAL)
def test_a_simulated_one_needs_neither(data: dict[str, Any]) -> None:
    assert find_real_key(from_dict(data, Config)) is None
    ensure_guarded(from_dict(data, Config))


def test_a_simulated_port_is_believed_of_a_pseudo_terminal_alone_and_told_before_each_flight() -> (
    None
):
    far, near = os.openpty()
    try:
        for port, believed in (
            (os.ttyname(near), True),
            ("/dev/ttyUSB0", False),
            ("/dev/pts/../ttyUSB0", False),
        ):
            config = from_dict({"link": {"kind": "dsm", "port": port, "simulated": True}}, Config)
            assert (find_real_key(config) is None) == believed
            (told,) = (
                one
                for one in Checks(config)(standing(), 0.0, LINK, 1.0, None, status_of(standing()))
                if one.name == "simulated"
            )
            assert told.verdict is Verdict.WARN
            assert port in told.says
            assert ("not believed" in told.says) != believed
    finally:
        os.close(far)
        os.close(near)


def test_heights_of_a_trajectory_count_from_the_floor() -> None:
    trajectory = {"kind": "hold", "position_ned": [0.0, 0.0, -1.0]}
    for floor_z_m, height in ((0.0, "1.00 to 1.00"), (1.0, "2.00 to 2.00"), (-0.5, "0.50 to 0.50")):
        config = from_dict({"trajectory": trajectory, "flight": {"floor_z_m": floor_z_m}}, Config)
        assert f"{height} m above the floor" in describe_trajectory(
            config, examine_trajectory(config)
        )


ANT: dict[str, Any] = {
    "vehicle": {"name": "ant"},
    "pose": {"kind": "vicon", "object": "ant", "listen": "0.0.0.0:51001"},
    "link": {"kind": "mavlink", "listen": "127.0.0.1:14540"},
}
BEE: dict[str, Any] = {
    "vehicle": {"name": "bee"},
    "pose": {"kind": "vicon", "object": "bee", "listen": "0.0.0.0:51001"},
    "link": {"kind": "mavlink", "listen": "127.0.0.1:14541"},
}


def beside(*others: dict[str, Any]) -> Check:
    running = [entry_of(from_dict(other, Config), "daemon", 77) for other in others]
    return Company(from_dict(ANT, Config), None, lambda: running, None)(standing(), 1.0)[0]


@pytest.mark.parametrize(
    ("change", "verdict", "says"),
    [
        ({}, Verdict.PASS, "none of this machine"),
        (
            {"pose": ANT["pose"]},
            Verdict.FAIL,
            "daemon bee (process 77) follows the body 'ant' as well",
        ),
        (
            {"pose": {**ANT["pose"], "listen": "0.0.0.0:51002"}},
            Verdict.WARN,
            "follows the body 'ant' as well",
        ),
        ({"link": ANT["link"]}, Verdict.FAIL, "commands mavlink 127.0.0.1:14540 system 1 as well"),
        ({"link": {**ANT["link"], "target_system": 2}}, Verdict.PASS, "none of this machine"),
        ({"vehicle": ANT["vehicle"]}, Verdict.WARN, "has the same name"),
        ({"pose": {"kind": "mavlink"}}, Verdict.PASS, "none of this machine"),
    ],
)
def test_equal_names_of_running_flights_are_told(
    change: dict[str, Any], verdict: Verdict, says: str
) -> None:
    seen = beside({**BEE, **change})
    assert seen.verdict is verdict
    assert says in seen.says


def test_a_bridge_is_compared_by_its_port() -> None:
    bridge = Running(pid=77, command="rf-bridge", vehicle="0.0.0.0:14600", link="crsf /dev/ttyUSB0")
    config = from_dict({**ANT, "link": {"kind": "crsf", "port": "/dev/ttyUSB0"}}, Config)
    assert Company(config, None, lambda: [bridge], None)(standing(), 1.0)[0].verdict is Verdict.FAIL


def bodies_near(
    places: dict[str, tuple[float, float, float]], now_s: float = 1.0, size_m: float = 0.3
) -> Check:
    config = from_dict({**ANT, "vehicle": {"name": "ant", "size_m": size_m}}, Config)
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
    Company(from_dict(ANT, Config), bodies, tuple, None).leave()
    assert ("bee" in bodies, "cat" in bodies, "dog" in bodies) == (True, False, False)
