"""Every gain and switch of our controller, with unit, default and reason. Config section ``[controller]``."""

from typing import Annotated, Literal

import msgspec

from groundstation.core.estimation import Composite, Estimation, NonNegative, Positive


class Law(Estimation, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Gains of the pure law. Defaults: the paper's where it gives them (section VI), else docs/explanation/law.md.

    It stands on :class:`Estimation` only because a struct has one base; the law reads ``gravity`` of it.
    """

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


class Gains(Law, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="adaptive"):
    """The law's gains, and those of the blocks around it that make it fly with lag and delay."""

    actuator_compensation: bool = True
    """Feed the law the thrust the rotors give now (modelled), and invert the lags of thrust and rates."""
    composite: Composite = "provable"
    """Second witness of the disturbance, beside the tracking error: the observer's own d̂, through the projection
    (provable); the observer's innovations added to b̂, which then drives it (raw); or none, as the paper has it."""
    kappa: NonNegative = 7.0
    """κ: pull of b̂ towards d̂ [1/s per kb], provable form only. The proof needs kb² κ < 4 k3."""
    k_omega: Positive = 14.0
    """How fast a body-rate error shall decay [1/s]."""
    rate_feedforward: NonNegative = 0.03
    """Time constant of the filter on the derivative of the wanted rate ω˙_d [s]."""


class Uncompensated(
    Gains, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="uncompensated"
):
    """The printed law: the same keys, but every block around it is off unless it is switched on."""

    actuator_compensation: bool = False
    """See :class:`Gains`."""
    delay_prediction: bool = False
    """See :class:`Gains`."""
    observer: Literal["model", "backward_euler"] = "backward_euler"
    """See :class:`Gains`."""
    composite: Composite = "off"
    """See :class:`Gains`."""
