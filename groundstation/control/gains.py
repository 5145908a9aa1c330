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
    """Second witness of the disturbance: through the projection (provable), added to b̂ (raw), or none."""
    k_omega: Positive = 14.0
    """How fast a body-rate error shall decay [1/s]."""
    rate_feedforward: NonNegative = 0.03
    """Time constant of the filter on the derivative of the wanted rate ω˙_d [s]; needs actuator_compensation."""
    observer_gains: tuple[Fraction, Fraction, Fraction] = (0.7, 0.35, 0.04)
    """(L1, L2, L3) per pose on position [-], velocity [1/dt] and disturbance [1/dt²] at 50 Hz."""
    attitude_gain: Annotated[float, msgspec.Meta(gt=0.0, le=1.0)] = 1.0
    """How much of a pose's attitude is believed against the model's [-]; 1 takes the measurement."""
    kappa: NonNegative = 8.0
    """κ: weight of the witness d̂ - b̂ in the adaptation [1/s]; provable form only; 0 gives the paper's law."""

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
