"""Before a flight: every check, the proof on file, and the confirmation that motors may start."""

import asyncio
import math
import os
import pty
import random
import signal
from pathlib import Path
from typing import Any

import msgspec
import pytest

from groundstation.config import ConfigError, from_dict
from groundstation.core.geometry.so3 import from_euler_zyx
from groundstation.core.health import Agreement
from groundstation.core.messages import Check, Others, Pose, PoseStatus, Verdict
from groundstation.core.safety import StandingPoses
from groundstation.flight.preflight import (
    LISTEN_S,
    Checks,
    Proof,
    SurroundingsChecks,
    confirm_arming,
    describe_checks,
    describe_failures,
    describe_trajectory,
    ensure_guarded,
    entry_of,
    examine_trajectory,
    hash_sections,
    line_from_terminal,
    proof_path,
    read_proof,
    save_proof,
)
from groundstation.flight.preflight.configuration import find_real_key
from groundstation.flight.preflight.proof import explain_missing_proof
from groundstation.machine import Running
from groundstation.settings import Config
from links.core import LinkStatus
from sim.scenarios import SCENARIOS, prepare
from sim.time import VirtualTimeLoop

BASE: dict[str, Any] = {
    "pose": {"kind": "vicon", "rate_hz": 50.0},
    "trajectory": {"kind": "hold", "position_ned": [0.0, 0.0, -1.0]},
}
LINK = LinkStatus(
    state="connected", sent=0, expired=0, received=9, dropped={}, text="", rtt_s=0.004
)
EIGHT = {"trajectory": {"kind": "lemniscate"}}
OUTSIDE = {"trajectory": {"kind": "hold", "position_ned": [1.99, 2.5, -1.0]}}
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


SLOPES = {"sigma_slope": 3.0, "rho_slope": 1.0}
GENTLE = {"kind": "adaptive", "b_bound": 1.0, "sigma_bound": 0.3, **SLOPES}
DSM = {"link": {"kind": "dsm", "port": "/dev/ttyUSB0"}}


def poses(accepted: int, *, origin_moves: int = 0, **dropped: int) -> PoseStatus:
    return PoseStatus(accepted=accepted, dropped=dropped, origin_moves=origin_moves)


def within(**fence: Any) -> dict[str, Any]:
    return {"config": {"fence": {**FENCE, **fence}}}


CASES: list[tuple[str, dict[str, Any], str]] = [
    ("pose rate", {}, "PASS"),
    ("pose rate", {"stands": standing(30.0)}, "WARN"),
    ("pose rate", {"stands": standing(15.0)}, "FAIL"),
    ("pose age", {}, "PASS"),
    ("pose age", {"now_s": 1.1}, "WARN"),
    ("pose age", {"now_s": 1.2}, "FAIL"),
    ("deadline", {}, "PASS"),
    ("deadline", {"config": {"flight": {"coast_s": 0.4}, "guards": {"level_s": 0.1}}}, "PASS"),
    ("deadline", {"config": {"flight": {"coast_s": 0.3}}}, "WARN"),
    ("deadline", {"config": {"guards": {"level_s": 0.75}}}, "WARN"),
    ("pose noise", {}, "PASS"),
    ("pose noise", {"noise_m": 0.004}, "WARN"),
    ("pose noise", {"noise_m": 0.006}, "FAIL"),
    ("pose noise", {"noise_m": math.nan}, "FAIL"),
    ("pose noise", {"stands": standing(noise_deg=0.23)}, "PASS"),
    ("pose noise", {"stands": standing(noise_deg=0.7)}, "WARN"),
    ("pose noise", {"stands": standing(noise_deg=1.2)}, "FAIL"),
    ("pose noise", {"stands": standing(noise_deg=0.35), "noise_m": 0.006}, "FAIL"),
    ("at rest", {"stands": standing(drift_m=0.02)}, "PASS"),
    ("at rest", {"stands": standing(drift_m=0.1)}, "FAIL"),
    ("at rest", {"stands": standing(down=-850.0)}, "FAIL"),
    ("at rest", {"stands": standing(down=-850.0), "config": {"pose": {"kind": "mavlink"}}}, "PASS"),
    ("at rest", {"source": poses(50, origin_moves=1)}, "PASS"),
    ("at rest", {"source": poses(50, origin_moves=2)}, "WARN"),
    ("at rest", {"source": poses(50, origin_moves=5)}, "FAIL"),
    ("tilt", {}, "PASS"),
    ("tilt", {"stands": standing(tilt_deg=8.0)}, "WARN"),
    ("tilt", {"stands": standing(tilt_deg=20.0)}, "FAIL"),
    ("floor", {}, "PASS"),
    ("floor", {"stands": standing(down=0.3)}, "FAIL"),
    ("fence", {}, "OFF"),
    ("fence", within(), "PASS"),
    ("fence", within(north_m=[0.5, 2.0]), "FAIL"),
    ("ways in the fence", {}, "OFF"),
    ("ways in the fence", within(), "PASS"),
    ("ways in the fence", within(height_m=0.9), "FAIL"),
    ("ways in the fence", {"config": {"fence": FENCE, **OUTSIDE}}, "FAIL"),
    ("battery", {}, "OFF"),
    ("battery", {"battery_v": 3.9}, "OFF"),
    ("battery", {"battery_v": 3.9, "config": {"guards": {"battery_v": 3.5}}}, "PASS"),
    ("battery", {"battery_v": 3.4, "config": {"guards": {"battery_v": 3.5}}}, "FAIL"),
    ("battery", {"battery_share": 0.9}, "PASS"),
    ("battery", {"battery_share": 0.3}, "WARN"),
    ("battery", {"battery_share": 0.1}, "FAIL"),
    ("round trip", {}, "PASS"),
    ("round trip", {"rtt_s": None}, "OFF"),
    ("round trip", {"rtt_s": 0.15}, "WARN"),
    ("round trip", {"rtt_s": 0.25}, "FAIL"),
    ("ready to arm", {}, "PASS"),
    ("ready to arm", {"unfit": "it would take our thrust as a climb rate"}, "FAIL"),
    ("ready to arm", {"state": "armed"}, "FAIL"),
    ("ready to arm", {"state": "lost"}, "FAIL"),
    ("ready to arm", {"ready": True}, "PASS"),
    ("ready to arm", {"ready": False}, "WARN"),
    ("frames", {}, "OFF"),
    ("frames", {"conflict": "MAVLink system 42 sends SET_ATTITUDE_TARGET, too"}, "FAIL"),
    ("frames", {"warning": "the autopilot is heard from two addresses"}, "WARN"),
    ("frames", {"config": DSM}, "PASS"),
    ("frames", {"config": DSM, "warning": "no real-time priority"}, "WARN"),
    ("link drops", {}, "PASS"),
    ("link drops", {"received": 1000, "dropped": {"truncated": 10, "other_system": 500}}, "PASS"),
    ("link drops", {"received": 1000, "dropped": {"truncated": 40}}, "WARN"),
    ("link drops", {"received": 1000, "dropped": {"bad_signature": 1}}, "WARN"),
    ("link drops", {"sent": 100, "dropped": {"full": 3}}, "WARN"),
    ("link drops", {"dropped": {"other_address": 1}, "other_addresses": ("10.0.0.7:1",)}, "WARN"),
    ("pose drops", {}, "PASS"),
    ("pose drops", {"source": poses(990, jump=9, other_message=500)}, "PASS"),
    ("pose drops", {"source": poses(900, jump=100)}, "WARN"),
    ("failsafe", {}, "OFF"),
    ("failsafe", {"config": DSM}, "WARN"),
    ("thrust bound", {}, "OFF"),
    ("thrust bound", {"config": {"controller": GENTLE}}, "PASS"),
    ("thrust bound", {"config": {"controller": {"kind": "pid"}}}, "OFF"),
    ("trajectory", {}, "PASS"),
    ("trajectory", {"config": {"limits": {"max_speed_m_s": 0.3}, **EIGHT}}, "FAIL"),
]


@pytest.mark.parametrize(("name", "given", "verdict"), CASES)
def test_each_check_has_its_verdict_and_a_sentence(
    name: str, given: dict[str, Any], verdict: str
) -> None:
    found = check(name, **given)
    assert found.verdict == verdict, found.says
    assert len(found.says) > 8


AGREES = Agreement(
    alarm=0.2, tilt_deg=0.3, mounting_deg=1.2, agrees=True, disagrees_since_s=None, alike=(),
    unlike=(),
)  # fmt: skip
WITNESSED: list[tuple[dict[str, Any], str, str]] = [
    ({"witness": AGREES}, "PASS", "1.2° apart"),
    ({"witness": AGREES._replace(alike=("roll", "pitch"))}, "PASS", "roll, pitch went the same"),
    ({"witness": None}, "WARN", "has poses beside it"),
    ({"witness": AGREES._replace(disagrees_since_s=0.5)}, "WARN", "is the vehicle being carried?"),
    ({"witness": AGREES._replace(mounting_deg=7.9)}, "PASS", "7.9° apart"),
    ({"witness": AGREES._replace(mounting_deg=8.1)}, "FAIL", "8.1° apart: is it the right body?"),
    ({"witness": AGREES._replace(unlike=("roll",))}, "FAIL", "roll turned another way"),
    ({"witness": AGREES._replace(unlike=("roll", "yaw"))}, "FAIL", "roll and yaw turned another"),
    ({"config": {"pose": {"kind": "mavlink"}}}, "OFF", "the poses are the autopilot's own"),
    ({"config": DSM}, "OFF", "this radio does not report"),
]


@pytest.mark.parametrize(("given", "verdict", "says"), WITNESSED)
def test_the_autopilots_attitude_is_a_second_witness(
    given: dict[str, Any], verdict: str, says: str
) -> None:
    found = check("second witness", **given)
    assert found.verdict == verdict
    assert says in found.says


def test_without_poses_nothing_else_is_asked_of_them() -> None:
    assert "no poses" in check("poses", stands=StandingPoses()).says


TWO_SENDERS = "poses of the vehicle come from two addresses"
MILLISECONDS = "1000 times too fast, limit 2: t is expected in seconds, and looks like milliseconds"
JSON = {"pose": {"kind": "json"}}


@pytest.mark.parametrize(
    ("name", "config", "source", "says"),
    [
        ("pose rate", JSON, {"stamp_rate": 1000.0}, MILLISECONDS),
        ("pose rate", {}, {"stamp_rate": 1000.0}, ""),  # frames have no unit
        ("pose drops", JSON, {"dropped": {"second_sender": 3}, "advice": TWO_SENDERS}, TWO_SENDERS),
        ("pose drops", JSON, {"accepted": 500, "dropped": {"second_sender": 50}}, ""),  # it is gone
        ("pose age", JSON, {"unsteady_clock": True}, "the tracker's clock stepped"),
    ],
)
def test_stamps_clocks_and_a_second_sender_of_the_poses_fail_with_what_is_wrong(
    name: str, config: dict[str, Any], source: dict[str, Any], says: str
) -> None:
    status = PoseStatus(**{"accepted": 50, "dropped": {}, **source})
    found = check(name, config=config, source=status)
    assert (found.verdict == "FAIL") == bool(says)
    assert says in found.says


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


def test_a_simulated_port_is_believed_of_a_pseudo_terminal_alone() -> None:
    far, near = os.openpty()
    ports = {os.ttyname(near): True, "/dev/ttyUSB0": False, "/dev/pts/../ttyUSB0": False}
    try:
        for port, believed in ports.items():
            link = {"link": {"kind": "dsm", "port": port, "simulated": True}}
            assert (find_real_key(from_dict(link, Config)) is None) == believed
            told = check("simulated", config=link)
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


def named(name: str, port: int) -> dict[str, Any]:
    """A vehicle with its own body and its own link."""
    return {
        "vehicle": {"name": name},
        "pose": {"kind": "vicon", "object": name, "listen": "0.0.0.0:51001"},
        "link": {"kind": "mavlink", "listen": f"127.0.0.1:{port}"},
    }


ANT, BEE = named("ant", 14540), named("bee", 14541)
NONE = "none of this machine"
NEAR = "'cat' is 0.20 m from 'ant', less than vehicle.size_m (0.3 m)"


def beside(own: dict[str, Any], other: Running) -> Check:
    return SurroundingsChecks(from_dict(own, Config), None, lambda: [other], None)(standing(), 1.0)[
        0
    ]


@pytest.mark.parametrize(
    ("change", "verdict", "says"),
    [
        ({}, "PASS", NONE),
        ({"pose": ANT["pose"]}, "FAIL", "daemon bee (process 77) follows the body 'ant' as well"),
        ({"pose": ANT["pose"] | {"listen": "0.0.0.0:51002"}}, "WARN", "the body 'ant' as well"),
        ({"link": ANT["link"]}, "FAIL", "commands mavlink 127.0.0.1:14540 system 1 as well"),
        ({"link": ANT["link"] | {"target_system": 2}}, "PASS", NONE),
        ({"vehicle": ANT["vehicle"]}, "WARN", "has the same name"),
        ({"pose": {"kind": "mavlink"}}, "PASS", NONE),
    ],
)
def test_equal_names_of_running_flights_are_told(
    change: dict[str, Any], verdict: str, says: str
) -> None:
    seen = beside(ANT, entry_of(from_dict({**BEE, **change}, Config), "daemon", 77))
    assert seen.verdict == verdict
    assert says in seen.says


def test_a_bridge_is_compared_by_its_port() -> None:
    bridge = Running(pid=77, command="rf-bridge", vehicle="0.0.0.0:14600", link="crsf /dev/ttyUSB0")
    own = {**ANT, "link": {"kind": "crsf", "port": "/dev/ttyUSB0"}}
    assert beside(own, bridge).verdict is Verdict.FAIL


@pytest.mark.parametrize(
    ("places", "now_s", "verdict", "says"),
    [
        ({}, 1.0, "PASS", "no other body in sight"),
        ({"ant": (0.0, 0.0, 0.0)}, 1.0, "PASS", "no other body in sight"),
        ({"bee": (0.31, 0.0, 0.0)}, 1.0, "PASS", "'bee' is 0.31 m from 'ant', the nearest"),
        ({"bee": (0.0, 0.0, 0.0)}, 1.6, "PASS", "no other body in sight"),  # not seen any more
        ({"bee": (0.5, 0.0, 0.0), "cat": (0.12, 0.16, 0.0)}, 1.0, "FAIL", NEAR),
    ],
)
def test_a_body_nearer_than_the_vehicles_size_fails_with_both_names_and_the_distance(
    places: dict[str, tuple[float, float, float]], now_s: float, verdict: str, says: str
) -> None:
    bodies = Others((), own="ant")
    for name, place in places.items():
        if name in bodies:
            bodies.see(name, 1.0, place)
    config = from_dict({**ANT, "vehicle": {"name": "ant", "size_m": 0.3}}, Config)
    seen = SurroundingsChecks(config, bodies, tuple, None)(standing(), now_s)[1]
    assert seen.verdict == verdict
    assert seen.says.startswith(says)


def test_once_it_takes_off_only_those_count_that_are_looked_for() -> None:
    bodies = Others(("bee",), own="ant")
    assert ("bee" in bodies, "cat" in bodies, "ant" in bodies) == (True, True, False)
    bodies.see("cat", 1.0, (1.0, 0.0, 0.0))
    assert (bodies.names, bodies.bodies) == (("bee",), ("bee", "cat"))
    assert bodies.unseen(0.0) == ("bee",)
    SurroundingsChecks(from_dict(ANT, Config), bodies, tuple, None).leave()
    assert ("bee" in bodies, "cat" in bodies, "dog" in bodies) == (True, False, False)


# ---- the proof on file

PROVED: dict[str, Any] = {**BASE, "link": {"kind": "mavlink", "remote": "192.168.1.20:14540"}}


def made(*overrides: str) -> Config:
    return from_dict(PROVED, Config, overrides)


def proof(config: Config, **changes: str) -> Proof:
    told = {"vehicle": config.vehicle.name, "digest": hash_sections(config)}
    told |= {"firmware": "", "date": "2026-01-02", **changes}
    return Proof(**told, steps={"no poses": "seen"})


@pytest.mark.parametrize(
    ("override", "counts"),
    [
        ("link.bring_down=rates", True),
        ("flight.coast_s=0.2", True),
        ("flight.idle_thrust=0.1", True),
        ("guards.level_s=0", True),
        ("vehicle.thrust_max_n=1.3", True),
        ("pose.object=other", True),
        ("trajectory.yaw_deg=20", False),
        ("flight.duration_s=20", False),
        ("recording.folder=elsewhere", False),
        ("link.signing_key_file=there/key", False),
    ],
)
def test_a_test_holds_until_something_changes_that_decides_how_motors_stop(
    override: str, counts: bool
) -> None:
    was = proof(made())
    assert explain_missing_proof(was, made(), "") is None
    why = explain_missing_proof(was, made(override), "")
    assert bool(why) is counts
    assert not counts or "configuration has changed" in str(why)


def test_another_firmware_or_another_vehicle_needs_another_test() -> None:
    config = made()
    told = str(explain_missing_proof(proof(config, firmware="PX4 1.15.0"), config, "PX4 1.16.0"))
    assert told.startswith("the test with the propellers off")
    assert "PX4 1.15.0; this is PX4 1.16.0" in told
    assert "no test" in str(explain_missing_proof(proof(config, vehicle="another"), config, ""))
    assert "no test" in str(explain_missing_proof(None, config, ""))


def test_it_is_kept_for_the_owner_alone_and_the_newest_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    config = made()
    path = proof_path(config)
    assert path == tmp_path / "groundstation" / "props-off" / "mqx.json"
    assert read_proof(path) is None
    for date in ("2026-01-02", "2026-01-03"):
        save_proof(proof(config, date=date), path)
    assert path.stat().st_mode & 0o777 == 0o600
    assert path.parent.stat().st_mode & 0o777 == 0o700
    assert [file.name for file in path.parent.iterdir()] == ["mqx.json"]
    kept = read_proof(path)
    assert kept is not None
    assert (kept.date, kept.steps) == ("2026-01-03", {"no poses": "seen"})


@pytest.mark.parametrize("text", [b"", b"{}", b'{"vehicle": 3}', b"\xff" * 40])
def test_a_file_that_is_no_test_is_none(tmp_path: Path, text: bytes) -> None:
    path = tmp_path / "x.json"
    path.write_bytes(text)
    assert read_proof(path) is None


def test_a_file_that_others_may_write_or_a_link_is_none(tmp_path: Path) -> None:
    path = tmp_path / "x.json"
    save_proof(proof(made()), path)
    link = tmp_path / "y.json"
    link.symlink_to(path)
    assert read_proof(link) is None
    path.chmod(0o666)
    assert read_proof(path) is None


def checked(config: Config, kept: Proof | None) -> Check:
    seen = Checks(config, proof=kept)(standing(), 0.0005, LINK, 1.03, None, PoseStatus(50, {}))
    return next(one for one in seen if one.name == "props-off test")


def test_preflight_asks_a_real_vehicle_for_it_and_no_simulated_one() -> None:
    config = made()
    assert checked(config, None).verdict is Verdict.WARN
    assert "groundstation props-off CONFIG" in checked(config, None).says
    assert checked(config, proof(config)).verdict is Verdict.PASS
    assert "2026-01-02" in checked(config, proof(config)).says
    assert checked(made("flight.coast_s=0.2"), proof(config)).verdict is Verdict.WARN
    assert checked(config, proof(config, firmware="PX4 1.15.0")).verdict is Verdict.WARN
    assert checked(from_dict(BASE, Config), None).verdict is Verdict.OFF


# ---- the confirmation that the motors may start


@pytest.mark.parametrize(("start", "waits_s"), [("air", LISTEN_S), ("floor", 0.0)])
def test_nobody_is_armed_unasked_before_a_second_autopilot_would_be_heard(
    start: str, waits_s: float
) -> None:
    _, config = prepare(SCENARIOS["paper"], [])
    flight = msgspec.structs.replace(config.flight, start=start)
    told: Config = msgspec.structs.replace(config, flight=flight)
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        begun_s = runner.get_loop().time()
        assert runner.run(confirm_arming(told, told.vehicle.name))
        assert runner.get_loop().time() - begun_s == pytest.approx(waits_s)
    assert LISTEN_S > 1.0, "autopilots send one heartbeat a second"


@pytest.mark.real_time
def test_a_part_of_a_line_at_the_terminal_does_not_stop_the_station(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ours, theirs = pty.openpty()

    async def ask() -> tuple[float, str]:
        loop = asyncio.get_running_loop()
        begun_s = loop.time()
        asked = asyncio.ensure_future(line_from_terminal("name? "))
        os.write(ours, b"mq\x04")  # Ctrl-D hands over what is typed so far
        await asyncio.sleep(0.1)
        stood_s = loop.time() - begun_s
        os.write(ours, b"x\n")
        return stood_s, await asked

    # What blocks is told of, and not waited for.
    before = signal.signal(signal.SIGALRM, lambda *_: os.write(ours, b"\n"))
    signal.alarm(4)
    with os.fdopen(theirs) as terminal:
        monkeypatch.setattr("sys.stdin", terminal)
        stood_s, line = asyncio.run(ask())
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)
    os.close(ours)
    assert stood_s < 2.0
    assert line == "mqx\n"
