"""Proof on file: the result of the last test with the propellers off, kept for the operator's own
vehicle.
"""

import hashlib
import os
from pathlib import Path
from typing import Any

import msgspec

from groundstation.core.messages import Sentence, notice
from groundstation.machine import FILE, RecordingConfig, folder_of, is_ours, open_private
from groundstation.settings import Config

SECTIONS = ("vehicle", "pose", "gate", "link", "flight", "guards")
"""Sections that decide how motors start and stop: a change of one of them voids an earlier test."""
COMMAND = "groundstation props-off CONFIG"
"""Command of the test with the propellers off, as the operator reads it."""


class Proof(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A passed test with the propellers off."""

    vehicle: str
    """The vehicle's name."""
    digest: str
    """Hash of the configuration, see :func:`hash_sections`."""
    firmware: str
    """Firmware of the autopilot as it reports it; empty where it reports none."""
    date: str
    """End of the test (ISO 8601, UTC)."""
    steps: dict[str, str]
    """Findings of each step, by its name."""


def hash_sections(config: Config) -> str:
    """Return the hash of ``SECTIONS``, 16 hexadecimal digits.

    File names and ``flight.duration_s`` are left out: they start and stop no motor.
    """
    values = msgspec.to_builtins(config)
    sections = {name: _without_files(values[name]) for name in SECTIONS}
    del sections["flight"]["duration_s"]
    digest = hashlib.sha256(msgspec.json.encode(sections, order="deterministic")).hexdigest()
    return digest[:16]  # 64 bits tell the configurations of one vehicle apart


def proof_path(config: Config) -> Path:
    """File of the vehicle's newest test: props-off/VEHICLE.json in $XDG_STATE_HOME/groundstation
    (~/.local/state), where the recordings are by default, too.
    """
    state_folder = folder_of(RecordingConfig()).parent
    return state_folder / "props-off" / f"{config.vehicle.name}.json"


def save_proof(proof: Proof, path: Path) -> None:
    """Write ``proof`` to ``path`` in the place of an older one, readable for its owner alone.

    Raises:
        OSError: it can't be written.
    """
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    new = path.with_name(f".{path.name}.{os.getpid()}")
    with open(new, "xb", opener=open_private) as file:
        file.write(msgspec.json.format(msgspec.json.encode(proof)) + b"\n")
    new.replace(path)


def read_proof(path: Path) -> Proof | None:
    """Read the test at ``path``; None if there is none, another user wrote it, or it is not
    readable.
    """
    try:
        if not is_ours(path.lstat(), FILE):
            return None
        return msgspec.json.decode(path.read_bytes(), type=Proof)
    except (OSError, msgspec.MsgspecError):
        return None


def explain_missing_proof(proof: Proof | None, config: Config, firmware: str) -> Sentence | None:
    """Return why ``proof`` does not cover this vehicle with its present configuration and
    ``firmware``, as the autopilot reports it; None if it does.
    """
    if proof is None or proof.vehicle != config.vehicle.name:
        return notice("check.props_off_none", vehicle=config.vehicle.name, command=COMMAND)
    if proof.digest != hash_sections(config):
        sections = f"[{'], ['.join(SECTIONS)}]"
        return notice(
            "check.props_off_changed", date=proof.date, sections=sections, command=COMMAND
        )
    if proof.firmware != firmware:
        proven, found = proof.firmware or "unknown", firmware or "unknown"
        return notice(
            "check.props_off_firmware", date=proof.date, proven=proven, found=found, command=COMMAND
        )
    return None


def _without_files(value: dict[str, Any]) -> dict[str, Any]:
    """Return ``value`` without the keys that name files, in nested tables too."""
    return {
        key: _without_files(item) if isinstance(item, dict) else item
        for key, item in value.items()
        if not key.endswith("file")
    }
