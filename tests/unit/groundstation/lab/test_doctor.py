"""The doctor: what it says of an autopilot or a board, and how it changes a parameter."""

import asyncio
import json
import re
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

from groundstation.config import ConfigError, from_dict
from groundstation.lab import DoctorOrders, run_doctor
from groundstation.lab.doctor import BoardVisit, load_restore
from groundstation.lab.doctor_advice import (
    EMPTY_SLOT,
    Rule,
    Setting,
    VehicleFacts,
    ardupilot_advice,
    between,
    exactly,
    judge,
    near,
    px4_advice,
    with_bits,
    without_bit,
)
from groundstation.runtime import Exit
from groundstation.settings import Config
from sim.__main__ import main
from sim.autopilots import (
    AUTOPILOTS,
    AutopilotPeer,
    BetaflightFirmware,
    SimulatedAutopilot,
    betaflight,
)
from sim.autopilots.parameters import ARDUPILOT_PARAMETERS, PX4_PARAMETERS
from tests.airframe_double import Brick
from tests.e2e.stations import run_here
from tests.loops import in_virtual_time, running

HERE = ("127.0.0.1", 14540)
HOVER = 0.080 * 9.81 / 1.37
FACTS = VehicleFacts(own_system=245, target_system=1, hover=HOVER, own_curve=False)
FORWARDING = FACTS._replace(forwards=True, pose_latency_s=0.010)
TABLES = {"px4": px4_advice, "ardupilot": ardupilot_advice}


class Visit:
    """The exit code and what was said, and the autopilot afterwards."""

    code: int
    said: str
    autopilot: SimulatedAutopilot


def visit(
    folder: Path,
    kind: str = "px4",
    *,
    armed: bool = False,
    answer: str | None = None,
    orders: dict[str, Any] | None = None,
    parameters: dict[str, float] | None = None,
) -> Visit:
    """Run the doctor on a simulated autopilot.

    ``answer`` is what the operator types, None where nobody is there.
    """
    seen = Visit()
    seen.autopilot = AUTOPILOTS[kind](Brick(), hover=HOVER, parameters=parameters)
    seen.autopilot.armed = armed
    lines: list[str] = []

    async def ask(question: str) -> str:
        lines.append(question)
        await asyncio.sleep(5.0)  # operators take their time
        return f"{answer}\n"

    async def main() -> int:
        config = Config()
        who: Callable[[str], Awaitable[str]] | None = ask if answer is not None else None
        async with running(AutopilotPeer(seen.autopilot, HERE)):
            return await run_doctor(
                config, DoctorOrders("doctor", folder=folder, **(orders or {})), who, lines.append
            )

    seen.code = in_virtual_time(main)()
    seen.said = "\n".join(lines)
    return seen


# ---- the tables


SAFETY = Path(__file__).parents[4] / "docs" / "explanation" / "safety.md"
WANTED_ROW = re.compile(r"^\| (PX4|ArduPilot) `(\w+)` \| ([\d.]+).*? \| ([^|]+) \|", re.MULTILINE)
WANTED = WANTED_ROW.findall(SAFETY.read_text("utf-8"))


@pytest.mark.parametrize(("autopilot", "name", "delivered", "wanted"), WANTED)
def test_what_the_page_on_safety_wants_of_an_autopilot_is_what_the_doctor_sets(
    autopilot: str, name: str, delivered: str, wanted: str
) -> None:
    rows = TABLES[autopilot.lower()](FACTS)
    (rule,) = [advice.rule for advice in rows if name in advice.names]
    assert not rule.accepts(float(delivered))
    span = re.match(r"[\d.]+ to [\d.]+", wanted)
    assert span is None or span[0] == rule.words
    best = re.search(r"best ([\d.]+)", wanted) or re.match(r"([\d.]+)", wanted)
    assert best is not None
    assert float(best[1]) == rule.better(float(delivered))
    assert len(WANTED) == 5


ALL_FACTS = (
    FACTS,
    FACTS._replace(own_curve=True),
    FORWARDING,
    FORWARDING._replace(pose_latency_s=None),
)


@pytest.mark.parametrize("facts", ALL_FACTS)
@pytest.mark.parametrize("kind", TABLES)
def test_every_advice_recommends_what_it_accepts_and_says_why(
    kind: str, facts: VehicleFacts
) -> None:
    table = TABLES[kind](facts)
    for advice in table:
        for value in (0.0, 1.0, 33.0):
            assert advice.rule.accepts(advice.rule.better(value)), advice.names
        assert len(advice.why) > 30
    names = [name for advice in table for name in advice.names]
    assert len(set(names)) == len(names)
    assert all(len(name) <= 16 for name in names)


PARAMETERS = {"px4": PX4_PARAMETERS, "ardupilot": ARDUPILOT_PARAMETERS}


@pytest.mark.parametrize("facts", [FACTS, FORWARDING])
@pytest.mark.parametrize("kind", TABLES)
def test_the_simulated_autopilot_has_every_parameter_that_is_looked_at(
    kind: str, facts: VehicleFacts
) -> None:
    has = PARAMETERS[kind].keys()
    assert [one.names for one in TABLES[kind](facts) if not has & set(one.names)] == []


ESTIMATOR: dict[str, dict[str, tuple[float, float]]] = {
    "px4": {
        "EKF2_EV_CTRL": (1.0, 11.0),
        "EKF2_HGT_REF": (1.0, 3.0),
        "EKF2_GPS_CTRL": (7.0, 0.0),
        "EKF2_MAG_TYPE": (7.0, 5.0),
    },
    "ardupilot": {
        "VISO_TYPE": (7.0, 1.0),
        "EK3_SRC1_POSXY": (7.0, 6.0),
        "EK3_SRC1_YAW": (7.0, 6.0),
        "GPS1_TYPE": (7.0, 0.0),
    },
}
"""What an estimator is found at, and what it is set to where it gets our poses."""


@pytest.mark.parametrize("kind", TABLES)
@pytest.mark.parametrize("forwards", [True, False])
def test_an_estimator_is_told_to_go_by_our_poses_where_they_are_forwarded(
    kind: str, forwards: bool
) -> None:
    found = {name: Setting(name, was) for name, (was, _) in ESTIMATOR[kind].items()}
    judged = [judge(one, found) for one in TABLES[kind](FORWARDING if forwards else FACTS)]
    set_to = {
        one.name: one.recommended
        for one in judged
        if one.name in found and one.recommended is not None
    }
    wanted = {name: becomes for name, (_, becomes) in ESTIMATOR[kind].items()}
    assert set_to == (wanted if forwards else {})


@pytest.mark.parametrize(
    ("latency_s", "delay_ms", "accepted"),
    [
        (0.010, 10.0, True),
        (0.080, 10.0, False),
        (0.080, 80.0, True),
        (None, 10.0, True),  # a source that tells its latency itself
    ],
)
def test_ardupilots_delay_of_poses_is_what_we_are_told_of_theirs(
    latency_s: float | None, delay_ms: float, accepted: bool
) -> None:
    table = ardupilot_advice(FORWARDING._replace(pose_latency_s=latency_s))
    (rule,) = [advice.rule for advice in table if "VISO_DELAY_MS" in advice.names]
    assert rule.accepts(delay_ms) == accepted


@pytest.mark.parametrize(
    ("rule", "good", "bad", "better"),
    [
        (exactly(1.0), (1.0,), (0.0, 1.5), 1.0),
        (between(0.2, 1.0, 0.5), (0.2, 0.20000000298, 1.0), (0.19, 1.01), 0.5),
        (near(0.5, 0.2), (0.41, 0.59), (0.39, 0.61), 0.5),
        (with_bits(8, ""), (8.0, 9.0, 15.0), (0.0, 7.0, 16.0), 15.0),
        (without_bit(0, ""), (0.0, 2.0, 32.0), (1.0, 33.0), 6.0),
    ],
)
def test_a_rule_accepts_and_recommends(
    rule: Rule, good: tuple[float, ...], bad: tuple[float, ...], better: float
) -> None:
    assert all(map(rule.accepts, good))
    assert not any(map(rule.accepts, bad))
    assert rule.better(7.0) == better


# ---- looking


@pytest.mark.parametrize("kind", TABLES)
def test_an_autopilot_that_is_set_up_well_has_nothing_to_change(tmp_path: Path, kind: str) -> None:
    seen = visit(tmp_path, kind, parameters={"GUID_TIMEOUT": 0.5} if kind == "ardupilot" else {})
    assert seen.code == Exit.DONE
    assert "Nothing to change" in seen.said


WRONG: dict[str, dict[str, float]] = {
    "px4": {
        "MAV_FWDEXTSP": 0.0, "MAV_TYPE": 0.0, "COM_OF_LOSS_T": 5.0, "COM_OBL_RC_ACT": 0.0,
        "MPC_THR_HOVER": 0.3,
    },
    "ardupilot": {
        "GUID_OPTIONS": 1.0, "ATC_ANGLE_BOOST": 1.0, "ATC_ACCEL_R_MAX": 110000.0,
        "ATC_ACCEL_P_MAX": 110000.0, "GUID_TIMEOUT": 3.0, "FS_GCS_ENABLE": 1.0,
        "FS_GCS_TIMEOUT": 5.0, "RC_OPTIONS": 1.0, "SYSID_MYGCS": 255.0, "MOT_THST_HOVER": 0.35,
    },
}  # fmt: skip


@pytest.mark.parametrize("kind", WRONG)
def test_each_wrong_value_is_found(tmp_path: Path, kind: str) -> None:
    seen = visit(tmp_path, kind, orders={"as_json": True}, parameters=WRONG[kind])
    assert seen.code == Exit.FAILED
    facts = json.loads(seen.said)
    found = {f["name"]: f["value"] for f in facts["findings"] if f["verdict"] in ("must", "should")}
    assert found == {name: pytest.approx(value) for name, value in WRONG[kind].items()}
    assert facts["healthy"] is False
    assert facts["fixed"] == []


# ---- changing


@pytest.mark.parametrize(
    ("kind", "name", "old", "new"),
    [
        ("px4", "COM_OF_LOSS_T", 5.0, 0.4),
        ("px4", "COM_OBL_RC_ACT", 0.0, 4.0),
        ("ardupilot", "GUID_OPTIONS", 5.0, 13.0),
        ("ardupilot", "ATC_ANGLE_BOOST", 1.0, 0.0),
    ],
)
def test_a_parameter_whose_name_the_operator_types_is_set_and_can_be_put_back(
    tmp_path: Path, kind: str, name: str, old: float, new: float
) -> None:
    seen = visit(tmp_path, kind, answer=name, orders={"fix": (name,)}, parameters={name: old})
    assert seen.autopilot.parameters[name] == pytest.approx(new, rel=1e-6)  # float32 on the wire
    assert f"{name}: {old:g} became {new:g}, read back" in seen.said
    (file,) = tmp_path.iterdir()
    kept = load_restore(file)
    assert (kept.name, kept.value) == (name, old)
    back = visit(tmp_path, kind, orders={"restore": file, "yes": True}, parameters={name: new})
    assert back.autopilot.parameters[name] == old
    assert len(list(tmp_path.iterdir())) == 2


def test_nothing_is_set_where_one_of_several_makes_no_sense(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="expected one of"):
        visit(tmp_path, orders={"fix": ("COM_OF_LOSS_T=0.3", "NO_SUCH"), "yes": True})
    assert list(tmp_path.iterdir()) == []


FIX = {"fix": ("COM_OF_LOSS_T",)}


@pytest.mark.parametrize(
    ("how", "code", "says"),
    [
        ({}, Exit.FAILED, ""),  # it only looks
        ({"answer": "yes", "orders": FIX}, Exit.FAILED, ""),  # the name must be typed
        ({"armed": True, "orders": {**FIX, "yes": True}}, Exit.UNHEARD, "the vehicle is armed"),
    ],
)
def test_nothing_changes_unless_it_is_asked_for_by_name_of_a_vehicle_that_is_not_armed(
    tmp_path: Path, how: dict[str, Any], code: int, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    seen = visit(tmp_path, parameters={"COM_OF_LOSS_T": 5.0}, **how)
    assert seen.code == code
    assert says in capsys.readouterr().err
    assert seen.autopilot.parameters["COM_OF_LOSS_T"] == 5.0
    assert how.get("armed") or list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("built", "says"), [(False, "run `make firmware` in a checkout"), (True, "install gcc")]
)
def test_a_missing_firmware_or_compiler_is_said_with_what_to_do(
    built: bool, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("PATH", str(tmp_path))
    if built:
        binary = betaflight.cache_folder() / betaflight.BINARY
        binary.parent.mkdir(parents=True)
        binary.touch()
    with pytest.raises(ConfigError, match=says):
        BetaflightFirmware()


@pytest.mark.parametrize(
    ("option", "says"),
    [
        ("--link=mavlink", "expected crsf, dsm or rf_bridge"),
        ("--config=mine.toml", "--config: Betaflight flies one vehicle of a scenario"),
    ],
)
def test_betaflight_flies_behind_a_receiver_only(option: str, says: str) -> None:
    done = run_here(main, "fly", "--autopilot", "betaflight", option)
    assert done.returncode == 2 and says in done.stderr


ARM = "0 0 1700 2100 0 0"


@pytest.mark.parametrize(
    ("rows", "verdicts"),
    [
        ([ARM, EMPTY_SLOT], {"aux 0": "ok"}),
        ([EMPTY_SLOT, ARM], {"aux 1": "ok"}),
        ([EMPTY_SLOT], {"aux 0": "must"}),
        (["0 1 1700 2100 0 0"], {"aux 0": "must"}),  # another channel
        (["0 0 900 2100 0 0"], {"aux 0": "must"}),  # always
        (["0 0 900 1300 0 0"], {"aux 0": "must"}),  # the wrong way round
        ([ARM, "0 3 1300 1700 0 0"], {"aux 0": "ok", "aux 1": "must"}),  # arms twice
        ([ARM, "1 1 1300 1700 0 0"], {"aux 0": "ok", "aux 1": "must"}),  # ANGLE where frames rest
        ([ARM, "1 1 1700 2100 0 0"], {"aux 0": "ok", "aux 1": "ok"}),  # ANGLE by nobody
        ([ARM, "2 0 1700 2100 0 0"], {"aux 0": "ok", "aux 1": "must"}),  # HORIZON while armed
        ([ARM, "13 1 900 2100 0 0"], {"aux 0": "ok", "aux 1": "ok"}),  # a beeper
    ],
)
def test_arming_is_by_one_row_and_no_mode_that_our_frames_meet_takes_the_sticks(
    rows: list[str], verdicts: dict[str, str]
) -> None:
    config = from_dict({"link": {"kind": "crsf", "map": {"arm": {"channel": 5}}}}, Config)
    visit = BoardVisit(config, "/dev/ttyACM0")
    visit.parameters = {f"aux {k}": Setting(f"aux {k}", row) for k, row in enumerate(rows)}
    advices = [advice for advice in visit.advice if advice.names[0].startswith("aux")]
    found = [judge(advice, visit.parameters) for advice in advices]
    assert {one.name: one.verdict for one in found} == verdicts
    for advice, one in zip(advices, found, strict=True):
        assert one.recommended is None or advice.rule.accepts(one.recommended)


PORT = "/dev/ttyACM0"
ODD_RATE = {"roll": {"channel": 1, "full_rate_deg_s": 205}}


@pytest.mark.parametrize(
    ("link", "port", "says"),
    [
        ({"kind": "crsf"}, None, "expected the flight controller's own port"),
        ({"kind": "crsf"}, "ttyACM0", "is not an address"),
        ({"kind": "dsm"}, PORT, "link.map.arm: Betaflight arms by a channel"),
        ({"kind": "crsf", "map": ODD_RATE}, PORT, "whole tens"),
        ({"kind": "rf_bridge"}, PORT, "expected mavlink, dsm or crsf"),
    ],
)
def test_a_board_is_looked_at_by_its_own_port_and_a_map_that_it_can_have(
    link: dict[str, Any], port: str | None, says: str
) -> None:
    with pytest.raises(ConfigError, match=says):
        BoardVisit(from_dict({"link": link}, Config), port)
