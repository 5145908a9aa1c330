"""What was proven of a vehicle with its propellers off: lab/props_off/ keeps it, pre-flight asks for it."""

import hashlib
import os
from pathlib import Path

import msgspec

from groundstation.runtime import FILE, RecordingConfig, folder_of, ours
from groundstation.settings import Config

SECTIONS = ("vehicle", "pose", "gate", "link", "flight", "guards")
"""What decides how motors start and stop: a test is of no worth once one of these has changed."""
COMMAND = "groundstation props-off CONFIG"


class Proof(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One test that was passed."""

    vehicle: str
    """The vehicle's name."""
    digest: str
    """Of the configuration, see :func:`digest`."""
    firmware: str
    """Of the autopilot, in its own words; empty where it does not tell."""
    date: str
    """When the test was over (ISO 8601, UTC)."""
    steps: dict[str, str]
    """Each step of the test, and what was seen and measured in it."""


def digest(config: Config) -> str:
    """Of the sections that decide how motors start and stop; names of files, and how long it flies, do not count."""
    told = msgspec.to_builtins(config)
    sections = {name: _without_files(told[name]) for name in SECTIONS}
    del sections["flight"]["duration_s"]
    return hashlib.sha256(msgspec.json.encode(sections, order="deterministic")).hexdigest()[:16]


def place(config: Config) -> Path:
    """Where its newest test is kept: ``$XDG_STATE_HOME/groundstation/props-off/VEHICLE.json``, or in ~/.local/state."""
    return folder_of(RecordingConfig()).parent / "props-off" / f"{config.vehicle.name}.json"


def save(proof: Proof, path: Path) -> None:
    """Keep ``proof`` for its owner alone, in the place of an older one.

    Raises:
        OSError: it can't be written.
    """
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    new = path.with_name(f".{path.name}.{os.getpid()}")
    with open(new, "wb", opener=lambda name, flags: os.open(name, flags | os.O_EXCL | os.O_NOFOLLOW, 0o600)) as file:
        file.write(msgspec.json.format(msgspec.json.encode(proof)) + b"\n")
        file.flush()
        os.fsync(file.fileno())
    new.replace(path)


def on_file(path: Path) -> Proof | None:
    """The test that is kept at ``path``; None where there is none, or none that this user wrote."""
    try:
        if not ours(path.lstat(), FILE):
            return None
        return msgspec.json.decode(path.read_bytes(), type=Proof)
    except (OSError, msgspec.MsgspecError):
        return None


def lacks(proof: Proof | None, config: Config, firmware: str) -> str:
    """Why ``proof`` does not hold for this vehicle as it is now; empty where it does."""
    if proof is None or proof.vehicle != config.vehicle.name:
        return f"no test with the propellers off is on file for {config.vehicle.name}: {COMMAND}"
    if proof.digest != digest(config):
        return (
            f"since the test with the propellers off ({proof.date}) the configuration has changed in one of "
            f"[{'], ['.join(SECTIONS)}]: do it again, {COMMAND}"
        )
    if proof.firmware != firmware:
        return (
            f"the test with the propellers off ({proof.date}) was of another firmware, {proof.firmware or 'unknown'}; "
            f"this is {firmware or 'unknown'}: do it again, {COMMAND}"
        )
    return ""


def _without_files(value: object) -> dict[str, object]:
    assert isinstance(value, dict), "a section is a table"
    return {
        key: _without_files(item) if isinstance(item, dict) else item
        for key, item in value.items()
        if not key.endswith("file")
    }
