"""The old value of a parameter on disk, before a new one is set: so that every change can be taken back."""

import os
from pathlib import Path

import msgspec

from links.mavlink.protocol import AutopilotParameter


class Restore(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One parameter as it was."""

    vehicle: str
    """The vehicle's name in its configuration."""
    autopilot: str
    """PX4 or ArduPilot."""
    system: int
    """Its MAVLink system."""
    name: str
    value: float
    kind: int
    """MAV_PARAM_TYPE."""

    @property
    def parameter(self) -> AutopilotParameter:
        """What is to be set."""
        return AutopilotParameter(self.name, self.value, self.kind)


def save(restore: Restore, folder: Path) -> Path:
    """Write ``restore`` into a new file in ``folder``, for its owner alone, and return its path.

    No file is ever overwritten.

    Raises:
        OSError: it can't be written.
    """
    number = 1
    while True:
        suffix = "" if number == 1 else f"-{number}"
        path = folder / f"restore-{restore.vehicle}-{restore.name}{suffix}.json"
        try:
            with open(path, "xb", opener=lambda name, flags: os.open(name, flags, 0o600)) as file:
                file.write(msgspec.json.encode(restore) + b"\n")
                file.flush()
                os.fsync(file.fileno())
        except FileExistsError:
            number += 1
        else:
            return path


def load(path: Path) -> Restore:
    """The parameter in the file at ``path``.

    Raises:
        ValueError: it can't be read or holds something else; the message says what.
    """
    try:
        return msgspec.json.decode(path.read_bytes(), type=Restore)
    except OSError as error:
        raise ValueError(f"cannot read {path}: {error.strerror}") from None
    except (msgspec.DecodeError, msgspec.ValidationError) as error:
        raise ValueError(f"{path} is no file that --fix has written: {error}") from None
