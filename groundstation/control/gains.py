"""Every gain and switch of our controller, with unit, default and reason. Config section ``[controller]``."""

from typing import Annotated, Literal

import msgspec

Positive = Annotated[float, msgspec.Meta(gt=0.0)]
NonNegative = Annotated[float, msgspec.Meta(ge=0.0)]
Fraction = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]


class Law(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Gains of the pure law. Defaults: the paper's where it gives them (section VI), else docs/explanation/law.md."""

    k2: Positive = 2.0
    """Gain on ρ(z2) [m/s²]; paper: 2."""
    k3: Positive = 4.0
    """Gain on z3 [1/s]; paper: 4."""
    kb: NonNegative = 1.0
    """Adaptation gain [1/s² per m/s² of V's gradient]; paper: 1; 0 switches adaptation off."""
    k_yaw: NonNegative = 1.0
    """Heading gain [1/s]."""
    sigma_bound: Positive = 1.5
    """M: bound of σ [m/s]; paper: 1.5."""
    sigma_slope: Positive = 3.0
    """r: slope of σ at 0 [1/s]; paper: 3."""
    rho_bound: Positive = 1.0
    """Bound of ρ [-]."""
    rho_slope: Positive = 1.0
    """Slope of ρ at 0 [s/m]."""
    velocity_scale: Positive = 1.0
    """c: how fast Ω grows beyond M [m/s]."""
    b_bound: Positive = 5.0
    """B: largest disturbance to adapt to [m/s²]. It must cover thrust-scale errors (0.2 g = 2 m/s²) too."""
    epsilon: Positive = 0.5
    """ε: b̂ stays within B + ε [m/s²]."""
    delta: Positive = 0.1
    """δ: smooths the projection [m²/s⁴]."""
    projection_order: Annotated[int, msgspec.Meta(ge=1, le=6)] = 1
    """n: the projection is n times continuously differentiable."""
    gravity: Positive = 9.81
    """g [m/s²]."""


class Gains(Law, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The law's gains, and those of the blocks around it that make it fly with lag and delay."""

    kind: Literal["adaptive", "uncompensated"] = "adaptive"
    """Our controller, or the printed law: backward differences, no model of lag or delay, no second witness."""
    actuator_compensation: bool = True
    """Feed the law the thrust the rotors give now (modelled), and invert the lags of thrust and rates."""
    delay_prediction: bool = True
    """Roll the estimate forward from the pose's time stamp to the instant the command acts."""
    observer: Literal["model", "backward_euler"] = "model"
    """Velocity from a model-based observer, or from the paper's backward difference of positions."""
    composite: Literal["provable", "raw", "off"] = "provable"
    """Second witness of the disturbance, beside the tracking error: the observer's own d̂, through the projection
    (provable); the observer's innovations added to b̂, which then drives it (raw); or none, as the paper has it."""
    kappa: NonNegative = 7.0
    """κ: pull of b̂ towards d̂ [1/s per kb], provable form only. The proof needs kb² κ < 2 k3."""
    k_omega: Positive = 14.0
    """How fast a body-rate error shall decay [1/s]."""
    rate_feedforward: NonNegative = 0.03
    """Time constant of the filter on the derivative of the wanted rate ω˙_d [s]."""
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

    def effective(self) -> "Gains":
        """The switches as they fly: ``uncompensated`` has all of the blocks around the law off."""
        if self.kind == "adaptive":
            return self
        return msgspec.structs.replace(
            self,
            actuator_compensation=False,
            delay_prediction=False,
            observer="backward_euler",
            composite="off",
        )
