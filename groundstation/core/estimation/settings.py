"""What the estimator is told, the same under every controller: part of the config section ``[controller]``."""

from typing import Annotated, Literal, TypeAlias

import msgspec

Positive = Annotated[float, msgspec.Meta(gt=0.0)]
NonNegative = Annotated[float, msgspec.Meta(ge=0.0)]

Composite: TypeAlias = Literal["provable", "raw", "off"]
"""What innovations correct beside the motion: the observer's own d̂, a controller's b̂, or nothing."""


class Estimation(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Gains and switches of observer and predictor. Defaults: docs/explanation/law.md."""

    gravity: Positive = 9.81
    """g [m/s²]."""
    delay_prediction: bool = True
    """Roll the estimate forward from the pose's time stamp to the instant the command acts."""
    observer: Literal["model", "backward_euler"] = "model"
    """Velocity from a model-based observer, or from the paper's backward difference of positions."""
    attitude_gain: Annotated[float, msgspec.Meta(gt=0.0, le=1.0)] = 1.0
    """How much of a pose's attitude is believed against the model's [-]; 1 takes the measurement."""
    pose_noise_m: Positive = 0.0003
    """Position noise to begin with, 1σ per axis [m]; then measured in flight."""
    velocity_noise_m_s: Positive = 0.1
    """Velocity noise of a source that measures velocity, 1σ per axis [m/s]; PX4's own figure outdoors is 0.1."""
    position_wander: NonNegative = 0.2
    """How the position of such a source wanders against its velocity [m/√s]; PX4 on simulated GPS: 0.18."""
    acceleration_noise: Positive = 0.01
    """What the model's acceleration may do from one instant to the next [m/s² per √Hz]."""
    wind_noise: Positive = 0.1
    """How the disturbance may jump [m/s³ per √Hz]: turbulence of 0.2 m/s² RMS and 2.6 s has 0.18."""
    wind_rate_noise: Positive = 1.7
    """How its rate may jump [m/s⁴ per √Hz]: larger follows gusts faster and takes more noise for wind."""

    effectiveness_deviation: NonNegative = 0.15
    """How well thrust over mass is known before the flight, 1σ [-]; 0 leaves all to the disturbance."""
    effectiveness_walk: NonNegative = 0.005
    """How it may wander in flight [1/√s]."""

    @property
    def kind(self) -> str:
        """The controller's name, as ``controller.kind`` has it."""
        return str(self.__struct_config__.tag)

    @property
    def composite(self) -> Composite:
        """The observer finds the disturbance by itself, unless the controller's config says otherwise."""
        return "provable"

    @property
    def kb(self) -> float:
        """Weight of adaptation in V [1/s² per m/s²]: none, unless the controller adapts."""
        return 0.0
