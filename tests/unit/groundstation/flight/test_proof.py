"""Proof on file: what a test with the propellers off holds for, and who may have written it."""

from pathlib import Path
from typing import Any

import pytest

from groundstation.config import from_dict
from groundstation.core.messages import Check, PoseStatus, Verdict
from groundstation.flight.preflight import (
    Checks,
    Proof,
    hash_sections,
    proof_path,
    read_proof,
    save_proof,
)
from groundstation.flight.preflight.proof import explain_missing_proof
from groundstation.settings import Config
from tests.unit.groundstation.flight.test_checks import BASE, LINK, standing

REAL: dict[str, Any] = {**BASE, "link": {"kind": "mavlink", "remote": "192.168.1.20:14540"}}


def made(*overrides: str) -> Config:
    return from_dict(REAL, Config, overrides)


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
