"""Identified figures of the bundled vehicles: flown in simulation, and identified once more."""

import re
import tempfile
import tomllib
from pathlib import Path
from typing import NamedTuple

from groundstation.analysis.identify import identify, read_stretch
from groundstation.config import ConfigError, presets, refuse_io
from groundstation.core.vehicle import Vehicle
from groundstation.machine import write_whole
from sim.runs import RECORDING, simulate


class FoundInFlight(NamedTuple):
    """One shipped vehicle, of which some figures were found on a flight of the excitation."""

    vehicle: str
    keys: dict[str, str]
    """Keys of its file that are what was found, and the parameter of each."""
    scenario: str
    overrides: tuple[str, ...]
    """Settings of the truth, and of the controller before anything is identified."""
    seed: int
    duration_s: float


EXCITATION = ("trajectory.kind=excitation", "trajectory.laps=1")
X500_WORLD = (
    "sim.plant=rotors",
    "sim.step_s=0.001",
    "sim.mass_kg=2.064",
    "sim.thrust_max_n=34.2",
    "sim.rate_limits_deg_s=[220, 220, 200]",
    "sim.drag_per_s=0",
    "sim.command_delay_s=0.005",
    "sim.rotors.arm_m=0.246",
    "sim.rotors.inertia_kg_m2=[0.0216667, 0.0216667, 0.04]",
    "sim.rotors.torque_per_thrust_m=0.016",
    "sim.rotors.spin_up_s=0.0125",
    "sim.rotors.spin_down_s=0.025",
    "sim.rotors.p=40",
    "sim.rotors.i=40",
    "sim.rotors.d=0.8",
)
"""PX4's model of the X500 (models/x500 and x500_base), and a rate loop of 40 rad/s, as the model has none."""
FOUND_IN_FLIGHT = (
    FoundInFlight("quad1kg", {"drag_per_s": "drag"}, "quad1kg", (*EXCITATION, "vehicle.drag_per_s=0"), 1, 22.0),
    FoundInFlight(
        "x500",
        {"rate_lag_s": "rate_lag", "rate_delay_s": "rate_delay"},
        "quad1kg",
        (
            *("trajectory.kind=excitation", "trajectory.laps=2"),
            *X500_WORLD,
            *("vehicle.preset=x500", "vehicle.rate_lag_s=0.05", "vehicle.rate_delay_s=0"),
        ),
        0,
        42.0,
    ),
)
DECIMALS = 3
"""To so many decimals they are kept, which is finer than any interval."""
SAME = 0.25
"""Difference, as a share of half the interval, below which a figure keeps its old value [-]."""


def fly_excitation(flown: FoundInFlight, folder: Path) -> Path:
    """The flight's recording, in ``folder``."""
    simulate(
        flown.scenario, seed=flown.seed, duration=flown.duration_s, overrides=flown.overrides, out=folder / "flight"
    )
    return folder / "flight" / RECORDING


def remake(flown: FoundInFlight, recording: Path) -> str:
    """The vehicle's file as ``recording`` has it: what was found there in its place, all else as it is.

    Raises:
        ValueError: the flight does not tell one of its figures.
    """
    found, text = identify(read_stretch(recording)).parameters, presets(Vehicle)[flown.vehicle]
    told = tomllib.loads(text)
    for key, name in flown.keys.items():
        one = found[name]
        if one.value is None or one.interval is None:
            raise ValueError(f"{flown.vehicle}: {key}: {one.note}")
        # Delays are found from a command's leaving; the link's part of them has a key of its own.
        value = one.value - (told["command_delay_s"] if name.endswith("_delay") else 0.0)
        if abs(value - told[key]) > SAME * 0.5 * (one.interval[1] - one.interval[0]):
            line = re.compile(rf"^{key} = \S+ *", re.MULTILINE)
            (old,) = line.findall(text)
            text = line.sub(f"{key} = {round(value, DECIMALS)}".ljust(len(old)), text)
    return text


def remake_all(folder: Path | None) -> list[str]:
    """Every file of :data:`FOUND_IN_FLIGHT` made anew, into ``folder`` where there is one; a line on each.

    Raises:
        ConfigError: a file can't be written.
    """
    if folder is not None and not folder.is_dir():
        raise ConfigError("--write", f"cannot write into {folder}: there is no such folder")
    lines = []
    for flown in FOUND_IN_FLIGHT:
        with tempfile.TemporaryDirectory(prefix="groundstation-vehicles-") as place:
            text = remake(flown, fly_excitation(flown, Path(place)))
        before = presets(Vehicle)[flown.vehicle]
        old, new = tomllib.loads(before), tomllib.loads(text)
        figures = ", ".join(
            f"{key} {new[key]:g}" + ("" if new[key] == old[key] else f" (was {old[key]:g})") for key in flown.keys
        )
        lines.append(f"{flown.vehicle:10} {'as it was' if text == before else 'changed  '}  {figures}")
        if folder is not None:
            path = folder / f"{flown.vehicle}.toml"
            with refuse_io("--write", f"cannot write {path}"):
                write_whole(path, text)
    return lines
