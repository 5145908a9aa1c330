"""Units and axes of ArduPilot's .bin, as the file states them."""

import math
import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from groundstation.analysis.evidence.imports import import_command
from groundstation.config import ConfigError
from groundstation.recording import Recording

SIZES = {"Q": "Q", "B": "B", "b": "b", "f": "f", "d": "d", "n": "4s", "N": "16s", "Z": "64s"}
FMT, FMTU, MULT, UNIT, XKF1, RATE, GUIP = 128, 10, 11, 12, 20, 21, 22
FORMS = {
    FMT: ("FMT", "BBnNZ", "Type,Length,Name,Format,Columns"),
    FMTU: ("FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds"),
    MULT: ("MULT", "Qbd", "TimeUS,Id,Mult"),
    UNIT: ("UNIT", "QbZ", "TimeUS,Id,Label"),
    XKF1: ("XKF1", "QBfffffffff", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,PN,PE,PD"),
    RATE: ("RATE", "Qffff", "TimeUS,RDes,PDes,YDes,AOut"),
    GUIP: ("GUIP", "QBfffb", "TimeUS,Type,pX,pY,pZ,Terrain"),
}
LABELS = {"s": "s", "d": "deg", "r": "rad", "m": "m", "n": "m/s", "x": "m", "-": "", "#": "instance"}
SIZES_OF = {"-": 0.0, "0": 1.0, "B": 1e-2, "C": 1e-3, "F": 1e-6, "y": 0.01}
"""Units and multipliers by their letters, as a .bin states them first."""
HEIGHT_M, NORTH_M = 2.0, 3.0
ROLL_RAD = 0.1


def message(kind: int, *values: Any) -> bytes:
    packing = "<" + "".join(SIZES[letter] for letter in FORMS[kind][1])
    packed = (value.encode() if isinstance(value, str) else value for value in values)
    return b"\xa3\x95" + bytes([kind]) + struct.pack(packing, *packed)


def describe(kind: int) -> bytes:
    name, form, columns = FORMS[kind]
    size = 3 + struct.calcsize("<" + "".join(SIZES[letter] for letter in form))
    return message(FMT, kind, size, name, form, columns)


def log(
    folder: Path,
    *,
    guip: tuple[str, str] | None,
    target: tuple[float, float, float],
    more: Sequence[bytes] = (),
    roll: float = math.degrees(ROLL_RAD),
    kind: Callable[[int], int] = lambda _: 2,
    told: bool = True,
) -> Path:
    """Hovers 2 m above its origin, 3 m north; Guided's target is there too, as GUIP has it."""
    data = [describe(form) for form in FORMS]
    if told:
        data += [message(UNIT, 0, ord(letter), label) for letter, label in LABELS.items()]
        data += [message(MULT, 0, ord(letter), size) for letter, size in SIZES_OF.items()]
    if guip is not None:
        data.append(message(FMTU, 0, GUIP, *guip))
    data += more
    for k in range(400):
        us = 1_000_000 + 10_000 * k
        wave = 0.01 * math.sin(0.1 * k)
        data.append(message(XKF1, us, 0, roll, 0.0, 0.0, 0.0, 0.0, 0.0, NORTH_M + wave, 0.001 * k, -HEIGHT_M))
        data.append(message(RATE, us, 0.0, 0.0, 0.0, 0.4 + wave))
        if k % 10 == 0:
            data.append(message(GUIP, us, kind(k), *target, 0))
    path = folder / "flight.bin"
    path.write_bytes(b"".join(data))
    return path


def imported(path: Path, capsys: pytest.CaptureFixture[str]) -> tuple[list[Any], str]:
    """Positions of the reference, and what was said."""
    out = path.with_suffix(".mcap")
    import_command([path], "ardupilot-bin", out)
    captured = capsys.readouterr()
    entries = [entry.value()["position_ned"] for entry in Recording(out).entries(("/imported/reference",))]
    return [(one["x"], one["y"], one["z"]) for one in entries], captured.out + captured.err


CM = ("s-mmm-", "F-BBB-")
METRES = ("s-mmm-", "F-000-")


@pytest.mark.parametrize("guip, target, told, kind, count", [
    (CM, (300.0, 100.0, 200.0), True, lambda _: 2, 40),
    (CM, (300.0, 100.0, 200.0), False, lambda _: 2, 40),
    (METRES, (3.0, 1.0, -2.0), True, lambda _: 2, 40),
    (METRES, (3.0, 1.0, -2.0), False, lambda _: 2, 40),
    (METRES, (3.0, 1.0, -2.0), True, lambda k: 4 if k < 200 else 2, 20),  # rows that hold no position
    (("s-xxx-", "F-yyy-"), (300.0, 100.0, 200.0), True, lambda _: 2, 40),
])  # fmt: skip
def test_the_target_of_guided_mode_is_in_the_unit_and_axes_that_the_file_states(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    guip: tuple[str, str],
    target: Any,
    told: bool,
    kind: Any,
    count: int,
) -> None:
    found, _ = imported(log(tmp_path, guip=guip, target=target, told=told, kind=kind), capsys)
    assert len(found) == count
    assert found[0] == pytest.approx((3.0, 1.0, -2.0), abs=1e-5)


@pytest.mark.parametrize("guip, target, says", [
    (None, (3.0, 1.0, -2.0), "the unit of pX, pY, pZ in GUIP is unclear: the file states none"),
    (("s-mmm-", "F-CCC-"), (3000.0, 1000.0, 2000.0), "the file states mm, the mapping expects m"),
    (("s-mmm-", "F-00B-"), (3.0, 1.0, 200.0), "is unclear"),
    (("s-ddd-", "F-000-"), (3.0, 1.0, -2.0), "the file states deg"),
    (METRES, (3.0, 1.0, 2.0), "fit the flight only with the other sign"),  # a build between 4.6 and 4.7
    (CM, (300.0, 100.0, -200.0), "fit the flight only with the other sign"),
])  # fmt: skip
def test_a_target_whose_unit_or_axes_are_unclear_is_left_out_and_the_reason_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], guip: tuple[str, str] | None, target: Any, says: str
) -> None:
    found, told = imported(log(tmp_path, guip=guip, target=target), capsys)
    assert found == []
    assert f"no reference in it: {says}" in told or says in told


@pytest.mark.parametrize("letter, multiplier, roll", [
    ("d", "0", math.degrees(ROLL_RAD)), ("r", "0", ROLL_RAD), ("d", "B", 100.0 * math.degrees(ROLL_RAD)),
    ("-", "-", math.degrees(ROLL_RAD)),
])  # fmt: skip
def test_the_attitude_is_in_the_unit_that_the_file_states(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], letter: str, multiplier: str, roll: float
) -> None:
    stated = message(FMTU, 0, XKF1, f"s#{3 * letter}nnnmmm", f"F-{3 * multiplier}000000")
    path = log(tmp_path, guip=METRES, target=(3.0, 1.0, -2.0), more=[stated], roll=roll)
    imported(path, capsys)
    entry = next(iter(Recording(path.with_suffix(".mcap")).entries(("/measured",))))
    assert 2.0 * math.asin(entry.value()["attitude"]["x"]) == pytest.approx(ROLL_RAD, abs=1e-6)


def test_poses_of_an_unclear_unit_are_refused(tmp_path: Path) -> None:
    stated = message(FMTU, 0, XKF1, "s#dddnnnddd", "F-000000000")
    path = log(tmp_path, guip=METRES, target=(3.0, 1.0, -2.0), more=[stated])
    with pytest.raises(ConfigError, match="the unit of PN, PE, PD in XKF1 is unclear: the file states deg"):
        import_command([path], "ardupilot-bin", tmp_path / "flight.mcap")
