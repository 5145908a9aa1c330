"""What feeds V_m from one command to the next: its terms, from measured quantities. Sans-IO.

V_m = V_known + |w|²/(2 kb), w = d̂ - b̂, obeys V_m˙ = -(W + κ|w|²) + the terms below (docs/explanation/law.md, section
5.9). Each is a gradient at mid-frame times what moved within the frame. Floats only.
"""

from groundstation.core.geometry.ops import Vec3
from groundstation.core.geometry.so3 import to_body
from groundstation.core.messages.snapshot import Diagnostics
from groundstation.core.vehicle.model import Motion

RATES = "rate error of the actuators"
THRUST = "thrust error of the actuators"
LIMITS = "commands at their limit"
WITNESSES = "observer and tracking disagree about the wind (kb² κ against 4 k3)"
SIDEWAYS = "the disturbance moves sideways (gusts; or rate lag, delay or attitude not as told)"
VERTICAL = "the disturbance moves vertically (gusts; or thrust, its lag or delay not as told)"
POSES = "poses contradict the model (noise, or lags or delay not as told)"


def terms(
    before: Motion,
    told: Diagnostics,
    saturated: bool,
    after: Motion,
    now: Diagnostics,
    dt: float,
    *,
    total: float,
    mass: float,
    pull: float,
) -> dict[str, float]:
    """What V_m gained from each source within one frame [m²/s²].

    Args:
        before: the vehicle at the last command.
        told: what the law said there.
        saturated: whether that command was clamped; the law then adapts nothing at the present one.
        after: the vehicle at the present command.
        now: what the law says there.
        dt: between the two [s].
        total: V_m's rise plus the decrease W + κ|w|² over the frame [m²/s²].
        mass: [kg].
        pull: kb κ [1/s].
    """
    z3: Vec3 = (
        0.5 * (told.z3[0] + now.z3[0]),
        0.5 * (told.z3[1] + now.z3[1]),
        0.5 * (told.z3[2] + now.z3[2]),
    )
    zx, zy, zz = to_body(before.attitude, z3)
    x, y = (0.5 * (before.rates[i] + after.rates[i]) - told.rates_wanted[i] for i in (0, 1))
    turning = before.thrust / mass * (zy * x - zx * y) * dt
    pushing = (told.thrust_rate * dt - (after.thrust - before.thrust)) / mass * zz
    d, e = told.disturbance, now.disturbance
    moved = (z3[0] * (e[0] - d[0]), z3[1] * (e[1] - d[1]), z3[2] * (e[2] - d[2]))
    w = (d[0] - told.b_hat[0], d[1] - told.b_hat[1], d[2] - told.b_hat[2])
    found = {
        LIMITS if saturated else RATES: turning,
        WITNESSES: 0.0 if saturated else pull * dt * (z3[0] * w[0] + z3[1] * w[1] + z3[2] * w[2]),
        SIDEWAYS: moved[0] + moved[1],
        VERTICAL: moved[2],
    }
    if saturated:
        found[LIMITS] += pushing
    else:
        found[THRUST] = pushing
    found[POSES] = total - sum(found.values())
    return found
