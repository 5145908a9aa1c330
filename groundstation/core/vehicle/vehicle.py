"""Vehicle: what the controller is told of it (config section ``[vehicle]``, or a file of its own), and its limits.

The limits (config section ``[limits]``) are what a flight may ask of it, beside what it can do.
"""

import math
from typing import Annotated, Any, ClassVar

import msgspec

from groundstation.config import VEHICLE_LETTERS, FromFile, Problem, completed, dotted, name_of, presets, toml

Positive = Annotated[float, msgspec.Meta(gt=0.0)]
NonNegative = Annotated[float, msgspec.Meta(ge=0.0)]
Share = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
Inside = Annotated[float, msgspec.Meta(gt=0.0, lt=1.0)]


class Vehicle(FromFile, msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Mass, limits and lags. Defaults: the paper's Blade mQX."""

    PRESETS: ClassVar[str] = "vehicles"
    preset: str | None = None
    """Vehicle that comes along to start from, see `groundstation vehicles`; its keys then stand here."""
    file: str | None = None
    """Vehicle file to start from, beside the configuration; its keys then stand here."""
    name: Annotated[str, msgspec.Meta(pattern=name_of(VEHICLE_LETTERS))] = "mqx"
    """What the operator calls it; asked for before arming."""
    mass_kg: Positive = 0.080
    """With battery and markers [kg]."""
    thrust_max_n: Positive = 1.37
    """Largest thrust to command [N]; without hover_thrust also what the full signal (1) gives."""
    thrust_min_n: Positive = 0.02
    """Least thrust to command in the air [N]; the law needs T > 0."""
    thrust_curve: Share = 0.0
    """f of thrust = f u² + (1 - f) u, from the signal u (0..1) to the share of full thrust [-]. 0 is straight: right
    where the autopilot straightens the motors' curve itself."""
    hover_thrust: Inside | None = None
    """Signal (0..1) that carries the vehicle, as the autopilot shows it (PX4: MPC_THR_HOVER) [-]; it says how many
    newtons the full signal gives."""
    rate_limits_deg_s: tuple[Positive, Positive, Positive] = (200.0, 200.0, 300.0)
    """Largest commanded roll, pitch and yaw rate [deg/s]."""
    thrust_lag_s: NonNegative = 1.0 / (2.0 * math.pi * 1.5)
    """Time constant from commanded to actual thrust [s]."""
    rate_lag_s: NonNegative = 1.0 / (2.0 * math.pi * 1.5)
    """Time constant from commanded to actual body rates [s]."""
    command_delay_s: NonNegative = 0.0
    """From a command leaving us to the actuators seeing it [s]."""
    frame_period_s: Positive = 0.0225
    """How long a command is held: the period of command frames [s]."""
    size_m: Positive = 0.3
    """Its largest extent, propellers included [m]: another tracked body that is nearer before arming is too near, or
    one body under two names."""
    hover_range: tuple[Positive, Positive] = (0.7, 1.45)
    """Least and largest thrust at which it may hover, as a share of its weight [-]; outside, it lands again."""
    hover_n: Positive | None = None
    """Thrust that hovers, where it was measured (`groundstation identify` does) [N]: take-off then goes
    to 1.1 of it and no further, in the place of 1.3 of the weight."""

    def __post_init__(self) -> None:
        """Only the reader of configurations follows ``preset`` and ``file``.

        Raises:
            ValueError: one of them is given elsewhere.
        """
        if self.preset is not None or self.file is not None:
            raise ValueError(
                "preset and file are for configurations: read one with groundstation.config.loader.from_dict"
            )

    @classmethod
    def with_text(cls, table: dict[str, Any], text: str) -> dict[str, Any]:
        """``table`` on top of a vehicle file: TOML with the keys of this section, and all of them.

        A file may start from a ``preset``; then it needs only what differs.

        Raises:
            ValueError: not TOML, a key that is unknown or missing, or a value outside its bounds.
        """
        try:
            told = toml(text)
            base = told.pop("preset", None)
            if "file" in told:
                raise ValueError("file: a vehicle file can't name another; it may name a preset")
            if base is not None:
                known = presets(cls)
                if not isinstance(base, str) or base not in known:
                    raise ValueError(f"preset: expected one of {list(known)}, got {base!r}")
                told = {**toml(known[base]), **told}
            told = completed(cls, told)
        except Problem as problem:
            raise ValueError(f"{dotted(problem.path)}: {problem.text}") from None
        missing = [key for key in cls.__struct_fields__ if key not in {*told, *_OPTIONAL}]
        if missing:
            raise ValueError(f"missing: {', '.join(missing)}; say all of it, or name a preset to start from")
        return {**told, **table}


_OPTIONAL = (
    "preset", "file", "command_delay_s", "thrust_curve", "hover_thrust", "hover_range", "size_m", "hover_n",
)  # fmt: skip
"""What a vehicle file may leave out."""


class LimitsConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Bounds on the planned flight; a trajectory that would leave them is refused before take-off."""

    max_speed_m_s: Annotated[float, msgspec.Meta(gt=0.0, le=50.0)] | None = None
    """Fastest the reference may go [m/s]."""
    max_acceleration_m_s2: Annotated[float, msgspec.Meta(gt=0.0, le=100.0)] | None = None
    """Largest acceleration of the reference [m/s²]."""
    max_tilt_deg: Annotated[float, msgspec.Meta(gt=0.0, le=80.0)] = 45.0
    """Farthest the vehicle may lean to follow the reference in still air [deg]."""
    reserve: Annotated[float, msgspec.Meta(ge=0.0, le=0.4)] = 0.1
    """Share of the vehicle's thrust range, at either end, and of its body rates kept for wind and errors [-]."""
