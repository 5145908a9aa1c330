"""Estimator: a model-based observer at the newest pose's instant, rolled forward through sent
commands.

Its settings, the same under every controller, are part of the config section ``[controller]``. With
composite adaptation in its provable form the observer is autonomous: it is driven by its own d̂ and
ĉ, never by b̂. Otherwise b̂ drives it (see :meth:`ModelEstimator.drive`).

Observer: a Kalman filter of a chain of integrators, and the thrust effectiveness separated from the
    wind.

The chain is position, velocity, disturbance and its rate. The model's acceleration drives it, so
the filter only has to follow the rest:

    p˙ = v + n_p,   v˙ = a_model + d + n_a,   d˙ = c + n_d,   c˙ = n_c,   measured p + noise of
                    variance r

The three axes share one covariance, as the noise is assumed isotropic. n_p, n_a, n_d, n_c are
white. n_p is zero except for a source whose errors are configured to last longer than from pose to
pose, and for an autopilot, which measures velocity too: its position wanders against its velocity
(GPS). Neither is motion. The gain follows from the interval between poses, so a gap needs no
special case, and from r, which is measured (see :func:`fourth_difference`).

Jitter s of the stamps is noise along the velocity: R = r I + s² v vᵀ. Then there are two
covariances, along the motion and across it. Where the motion turns, both are projected onto the new
direction; the correlation of along with across is left out.

Effectiveness is a second stage beside that filter. The chain is driven by the model's acceleration,
in which thrust is λ times the configured one: -λ (T/m) R e3 + g e3 + d. λ is a constant, or nearly
(batteries sag). The effect of an error of λ̂ on the chain is linear and known, so it needs no state
in the filter: the filter's error is x̃ + V (λ - λ̂), where x̃ is its error if λ were known and V
follows the filter's own recursion. So λ is estimated from the innovations that V explains (B.
Friedland, "Treatment of bias in recursive filtering", IEEE TAC 14, 1969).

Weak thrust and wind have the same effect while thrust is constant: only their sum is observable
then. Commands that react to pose noise are correlated with the innovations, and would move λ̂ for
minutes. So λ̂ moves only while its innovations are excited: while the last second alone determines
it well, and adds a share to the information so far (:func:`is_excited`). Its variance follows from
the noise of its score as measured in flight, as the wind assumed by the chain is rougher, or
calmer, than the true one. Elementwise: floats, or arrays of shape (N,).
"""

import math
from collections import deque
from collections.abc import Sequence
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias

import msgspec

from groundstation.core.estimation.bounds import (
    Gravity,
    Jitter,
    MarkerWander,
    ModelNoise,
    PoseNoise,
    ThrustDeviation,
    ThrustWander,
    VelocityBias,
    VelocityNoise,
    Wander,
    WindNoise,
    WindRateNoise,
)
from groundstation.core.geometry import (
    FLOATS,
    ZERO,
    Ops,
    Quat,
    Real,
    Vec3,
    add_scaled,
    conjugate,
    multiply,
    rotate,
    rotation_vector,
    scale,
    subtract,
)
from groundstation.core.messages import Estimate, Pose
from groundstation.core.vehicle import (
    GRAVITY,
    ActuatorCommand,
    ActuatorResponse,
    Motion,
    Vehicle,
    begin_response,
    integrate_actuators,
    integrate_motion,
    schedule,
)

Covariance: TypeAlias = tuple[Real, Real, Real, Real, Real, Real, Real, Real, Real, Real]
"""The upper triangle of the covariance of (p, v, d, c), row by row, in SI units: pp, pv, pd, pc,
vv, vd, vc, dd, dc, cc. A plain tuple, as two are made with every pose."""
PP = 0
"""Index of the variance of position in it."""
VV = 4
"""Index of the variance of velocity in it."""


class Densities(NamedTuple):
    """White-noise densities that drive position [m²/s], velocity [m²/s³], disturbance [m²/s⁵], its
    rate [m²/s⁷].
    """

    position: float
    acceleration: float
    disturbance: float
    disturbance_rate: float


class Ahead(NamedTuple):
    """State of the vehicle at a later instant, by the model."""

    time_s: float
    response: ActuatorResponse
    """Response of the actuators to the commands since the newest pose."""
    motion: Motion


KalmanGain: TypeAlias = tuple[Real, Real, Real, Real]
"""Change by one metre of innovation: of position [-], velocity [1/s], disturbance [1/s²], its rate
[1/s³]."""


def initial_covariance(noise: Real, speed2: float = 1.0, disturbance2: float = 1.0) -> Covariance:
    """Covariance at the first pose: speed 0 to 1 m/s, disturbance 0 to 1 m/s², and constant."""
    return (noise, 0.0, 0.0, 0.0, speed2, 0.0, 0.0, disturbance2, 0.0, 0.01)


def predict_covariance(s: Covariance, h: Real, q: Densities) -> Covariance:
    """Predict ``s`` by ``h`` [s] without a pose: F S Fᵀ + Q, F the chain's exact transition.

    Q is diagonal, q h: the omitted terms are of second order in h and follow through F at the next
    step.
    """
    pp, pv, pd, pc, vv, vd, vc, dd, dc, cc = s
    a, b = 0.5 * h * h, h * h * h / 6.0
    p_v = pv + h * vv + a * vd + b * vc
    p_d = pd + h * vd + a * dd + b * dc
    p_c = pc + h * vc + a * dc + b * cc
    v_d = vd + h * dd + a * dc
    v_c = vc + h * dc + a * cc
    d_c = dc + h * cc
    after = (
        pp + h * pv + a * pd + b * pc + h * p_v + a * p_d + b * p_c + q.position * h,
        p_v + h * p_d + a * p_c,
        p_d + h * p_c,
        p_c,
        vv + h * vd + a * vc + h * v_d + a * v_c + q.acceleration * h,
        v_d + h * v_c,
        v_c,
        dd + h * dc + h * d_c + q.disturbance * h,
        d_c,
        cc + q.disturbance_rate * h,
    )
    return after


UNEXPECTED = 3.0
"""Ratio of an innovation's square to its expected square above which the covariance is widened [-]:
3 % of those of a consistent filter (χ² of three axes). With 4 `adverse` has 2 % more error, with
2.5 the effort there is beyond its limit."""
WIDEST = 5.0
"""Largest factor of that widening [-]; 20 changes no scenario by 1 %."""


def widen_covariance(ops: Ops, s: Covariance, r: Real, step: Vec3) -> Covariance:
    """Widen ``s`` until it explains the innovation ``step`` [m], with position noise ``r`` [m²].

    A front of wind is a jump that the chain's noise does not contain. Σ then grows as a whole, so
    that the chain follows the next poses faster; it may exceed FΣFᵀ at any time
    (docs/explanation/law-proof.md, 5.5).
    """
    x, y, z = step
    share = (x * x + y * y + z * z) / (3.0 * UNEXPECTED * (s[PP] + r))
    k = ops.clamp(share, 1.0, WIDEST)
    pp, pv, pd, pc, vv, vd, vc, dd, dc, cc = s
    return (k * pp, k * pv, k * pd, k * pc, k * vv, k * vd, k * vc, k * dd, k * dc, k * cc)


def update_covariance(s: Covariance, r: Real, of: int = 0) -> tuple[KalmanGain, Covariance]:
    """Return the gain for a measurement of noise ``r``, and the covariance after it.

    ``of`` is 0 for a position, with ``r`` in [m²] and the gain for 1 m, and 1 for a velocity, in
    [m²/s²] and for 1 m/s.
    """
    pp, pv, pd, pc, vv, vd, vc, dd, dc, cc = s
    p, v, d, c = (pv, vv, vd, vc) if of else (pp, pv, pd, pc)
    w = 1.0 / (s[VV if of else PP] + r)
    kp, kv, kd, kc = p * w, v * w, d * w, c * w
    after = (
        pp - kp * p,
        pv - kp * v,
        pd - kp * d,
        pc - kp * c,
        vv - kv * v,
        vd - kv * d,
        vc - kv * c,
        dd - kd * d,
        dc - kd * c,
        cc - kc * c,
    )
    return (kp, kv, kd, kc), after


def fourth_difference(times: Sequence[Real], places: Sequence[Vec3]) -> tuple[Real, Real, Real]:
    """Measure the noise of five positions at five ``times`` [s], with their motion almost
    cancelled.

    The fourth divided difference of a cubic motion is 0, and that of independent noise has the sum
    of its squared weights times its variance. At equal intervals h a smooth motion leaves snap ·
    h⁴/√70 (0.02 mm for 100 m/s⁴ at 50 Hz).

    Returns:
        The variance per axis [m²]; that along the way from the first to the last [m²]; that way
        squared [m²].
    """
    r, s, t, u, v = times
    rs, rt, ru, rv, st, su, sv, tu, tv, uv = (
        s - r,
        t - r,
        u - r,
        v - r,
        t - s,
        u - s,
        v - s,
        u - t,
        v - t,
        v - u,
    )
    i, j, k = 1.0 / (rs * rt * ru * rv), -1.0 / (rs * st * su * sv), 1.0 / (rt * st * tu * tv)
    m, n = -1.0 / (ru * su * tu * uv), 1.0 / (rv * sv * tv * uv)
    (ax, ay, az), (bx, by, bz), (cx, cy, cz), (dx, dy, dz), (ex, ey, ez) = places
    x = i * ax + j * bx + k * cx + m * dx + n * ex
    y = i * ay + j * by + k * cy + m * dy + n * ey
    z = i * az + j * bz + k * cz + m * dz + n * ez
    weight2 = i * i + j * j + k * k + m * m + n * n
    north, east, down = ex - ax, ey - ay, ez - az
    way2 = north * north + east * east + down * down
    along = north * x + east * y + down * z
    return (
        (x * x + y * y + z * z) / (3.0 * weight2),
        along * along / (weight2 * (way2 + NO_WAY_M2)),
        way2,
    )


NO_WAY_M2 = 1e-20
"""Added to a squared distance that may be 0 and divides [m²]."""


StampNoise: TypeAlias = tuple[Real, Real]
"""Mean fourth differences along the motion: variance along it [m²], and square of the speed
[m²/s²]. Elementwise."""

JITTER_RATIO = 2.0
"""Ratio of the noise variances along and across the motion above which the stamps have jitter [-]:
by chance, with memory of 100 poses, it is 1.2 (1σ)."""


def split_noise(
    ops: Ops, noise: Real, measured: StampNoise, least: float, configured_s: float | None
) -> tuple[Real, Real]:
    """Split the noise into that across the motion, per axis [m²], and the squared jitter of the
    stamps [s²].

    Args:
        ops: elementary functions.
        noise: mean of the three axes [m²].
        measured: noise along the motion.
        least: least noise across the motion [m²].
        configured_s: configured jitter [s]; None for the measured one, which is 0 where it is not
            significant.
    """
    if configured_s == 0.0:
        return noise, 0.0
    along, speed2 = measured
    across = ops.clamp(1.5 * noise - 0.5 * along, least, math.inf)
    if configured_s is not None:
        return across, configured_s * configured_s + 0.0 * across
    has_jitter = along > JITTER_RATIO * across
    return ops.where(has_jitter, across, noise), ops.where(
        has_jitter, (along - across) / (speed2 + NO_WAY_M2), 0.0
    )


class AlongTrack(NamedTuple):
    """Filter along the motion, where stamps have jitter: its own covariance, and direction."""

    axis: Vec3
    """Unit vector, NED."""
    covariance: Covariance


class AlongGain(NamedTuple):
    """Difference of the gain along the motion from that in every direction."""

    axis: Vec3
    more: KalmanGain
    """Gain to be added along it; below 0, as poses are noisier there."""
    weight: Real
    """Ratio of the innovation's deviation across the motion to that along it, less 1 [-]."""


def find_direction(ops: Ops, velocity: Vec3) -> tuple[Vec3, Real]:
    """Unit vector along ``velocity`` [m/s], 0 for 0, and the speed squared [m²/s²]."""
    x, y, z = velocity
    speed2 = x * x + y * y + z * z
    k = 1.0 / ops.sqrt(speed2 + NO_WAY_M2)
    return (k * x, k * y, k * z), speed2


def turn_track(across: Covariance, track: AlongTrack, axis: Vec3) -> tuple[Covariance, Covariance]:
    """Return the covariances across and along the motion, turned to ``axis``: the mean over all
    directions across.

    Equal covariances stay exactly the same.
    """
    a, b, c = track.axis
    x, y, z = axis
    cosine = a * x + b * y + c * z
    kept = cosine * cosine
    lost = 0.5 * (1.0 - kept)
    pairs = list(zip(across, track.covariance, strict=True))
    both: Any = (tuple(s + share * (t - s) for s, t in pairs) for share in (lost, kept))
    one, other = both
    return one, other


def weigh_along(
    ops: Ops,
    axis: Vec3,
    gain: KalmanGain,
    along: tuple[KalmanGain, Covariance],
    across2: Real,
    along2: Real,
) -> tuple[AlongGain, AlongTrack]:
    """Return the difference of the gain ``along`` the motion from ``gain``, for the innovation's
    two variances.
    """
    (kp, kv, kd, kc), ((p, v, d, c), covariance) = gain, along
    more = (p - kp, v - kv, d - kd, c - kc)
    return AlongGain(axis, more, ops.sqrt(across2 / along2) - 1.0), AlongTrack(axis, covariance)


def part_along(axis: Vec3, of: Vec3) -> Vec3:
    """Return the part of the vector ``of`` along the unit vector ``axis``."""
    (x, y, z), (a, b, c) = axis, of
    k = x * a + y * b + z * c
    return (k * x, k * y, k * z)


Chain: TypeAlias = tuple[Vec3, Vec3, Vec3, Vec3]
"""Position [m], velocity [m/s], disturbance [m/s²] and its rate [m/s³], or their derivatives by λ;
NED."""


def correct_chain(chain: Chain, gain: KalmanGain, step: Vec3) -> Chain:
    """Correct each of ``chain`` by its gain times ``step``."""
    (p, v, d, c), (kp, kv, kd, kc) = chain, gain
    return (
        add_scaled(p, kp, step),
        add_scaled(v, kv, step),
        add_scaled(d, kd, step),
        add_scaled(c, kc, step),
    )


def apply_effectiveness(chain: Chain, moved: Real, e: "Effectiveness") -> Chain:
    """Correct ``chain`` for the change ``moved`` of λ̂ [-], by V."""
    p, v, d, c = chain
    return (
        add_scaled(p, moved, e.p),
        add_scaled(v, moved, e.v),
        add_scaled(d, moved, e.d),
        add_scaled(c, moved, e.c),
    )


def correct_attitude(ops: Ops, predicted: Quat, measured: Quat, gain: float) -> Quat:
    """Turn the predicted attitude by ``gain`` (0..1) of the angle to the measured one.

    1 takes the measurement.
    """
    if gain >= 1.0:
        return measured
    x, y, z = rotation_vector(multiply(conjugate(predicted), measured), ops)
    return rotate(predicted, (gain * x, gain * y, gain * z))


EFFECTIVENESS_LIMITS = (0.6, 1.4)
"""Limits of λ̂ [-]: beyond them something is broken, not worn."""
EXCITED_INFORMATION = 100.0
"""Information of the last second below which λ̂ is frozen [-]: 100 determines it to 1/√100 = 0.1
(1σ). Commands that react to noise alone gain 18 (`quad1kg`) to 78 (`rotors_mqx`) a second; the
tones of a hold and the start of a flight gain 200 to 5,000."""
SHARE_OF_KNOWN = 0.1
"""Share of the information so far that the last second must add, else λ̂ is frozen [-]: noise then
never moves it for minutes."""
CALMEST_NOISE = 0.05
"""Least noise of λ̂'s score, as a share of that by the chain's noises [-]: a room with constant
wind, `paper` and `quad1kg`, measured in simulated holds and figures of 300 s. The chain is tuned to
follow gusts, so it assumes rougher wind."""
SCORE_MEMORY_S = 10.0
"""Time of excitation over which that noise is averaged [s]: in less, the first seconds of a calm
flight raise it."""
THRUST_KNOWN_S = 0.45
"""Time for which λ̂ is frozen after a release in the air [s]: thrust and speed of that instant are
not known, and take four lags of the slowest vehicle (0.11 s) to be forgotten. In `paper` the error
is 0.037 without, 0.006 with it."""


class Effectiveness(msgspec.Struct, frozen=True, gc=False):
    """λ̂, its variances, and V: the derivative of the observer's chain by λ, NED."""

    value: Real
    """λ̂: true thrust over configured thrust [-]."""
    variance: Real
    """Variance of λ̂ by the noise measured in flight [-]."""
    assumed: Real
    """Variance of λ̂ by the chain's noises [-]: the gain follows from it."""
    p: Vec3
    """V's position [m]."""
    v: Vec3
    """V's velocity [m/s]."""
    d: Vec3
    """V's disturbance [m/s²]."""
    c: Vec3
    """V's rate of disturbance [m/s³]."""
    gained: Real
    """Information of the last second: the sum of V²/S, S the variance of the innovations [-]."""
    score: Real
    """Sum of V i/S over that second, i the innovations at this λ̂ [-]: zero on average."""
    noise: Real
    """Mean square of the score, as a share of that by S [-]."""
    frozen_s: Real
    """Time until λ̂ may move [s]; below 0 it may."""


def initial_effectiveness(deviation: float) -> Effectiveness:
    """Return λ̂ = 1 with standard deviation ``deviation``, frozen until the thrust is known: before
    the flight.
    """
    variance = deviation * deviation
    return Effectiveness(
        1.0, variance, variance, ZERO, ZERO, ZERO, ZERO, 0.0, 0.0, CALMEST_NOISE, THRUST_KNOWN_S
    )


def is_excited(e: Effectiveness) -> Real:
    """Whether λ̂'s innovations are excited: the last second determines it well, and adds to the
    information so far.
    """
    enough = e.gained > EXCITED_INFORMATION
    return enough & (e.gained * e.assumed > SHARE_OF_KNOWN) & (e.frozen_s < 0.0)


def predict_effectiveness(
    ops: Ops, e: Effectiveness, h: Real, response: ActuatorResponse, mass: float, walk: float
) -> Effectiveness:
    """Predict ``e`` by ``h`` [s], in which the actuators gave ``response``.

    V follows the chain's exact transition, driven by the thrust of λ = 1 on the configured ``mass``
    [kg]. While λ̂ is excited, λ wanders by ``walk`` [1/√s]; else a change of λ is part of the
    disturbance.
    """
    (px, py, pz), (vx, vy, vz), (dx, dy, dz), c = e.p, e.v, e.d, e.c
    moves = is_excited(e)
    wanders = ops.where(moves, walk * walk * h, 0.0)
    # The score's memory is half that of the information.
    measured = 2.0 * e.score * e.score / (e.gained + NO_INFORMATION)
    followed = e.noise + h / SCORE_MEMORY_S * (measured - e.noise)
    noise = ops.where(moves, ops.clamp(followed, CALMEST_NOISE, math.inf), e.noise)
    keep = ops.where(e.frozen_s < 0.0, 1.0 / (1.0 + h), 0.0)
    (ix, iy, iz), (sx, sy, sz) = response.impulse, response.reach
    k = -1.0 / mass
    x, y, z = h * c[0], h * c[1], h * c[2]
    half, third = 0.5 * h, 1.0 / 3.0
    return Effectiveness(
        e.value,
        e.variance + wanders * ops.clamp(noise, 0.0, 1.0),
        e.assumed + wanders,
        (
            px + h * (vx + half * (dx + third * x)) + k * sx,
            py + h * (vy + half * (dy + third * y)) + k * sy,
            pz + h * (vz + half * (dz + third * z)) + k * sz,
        ),
        (
            vx + h * (dx + 0.5 * x) + k * ix,
            vy + h * (dy + 0.5 * y) + k * iy,
            vz + h * (dz + 0.5 * z) + k * iz,
        ),
        (dx + x, dy + y, dz + z),
        c,
        keep * e.gained,
        keep * e.score,
        noise,
        e.frozen_s - h,
    )


NO_INFORMATION = 1e-9
"""Added to an information that may be 0 and divides [-]."""


def update_effectiveness(
    ops: Ops,
    e: Effectiveness,
    step: Vec3,
    gain: KalmanGain,
    innovation2: Real,
    of: int = 0,
    along: AlongGain | None = None,
) -> tuple[Effectiveness, Real]:
    """Update ``e`` by an innovation.

    Return it, and the change of λ̂, by which times V the observer changes, too.

    Args:
        ops: elementary functions.
        e: λ̂ at the instant of the measurement.
        step: innovation of position [m] (``of`` = 0) or of velocity [m/s] (``of`` = 1), NED.
        gain: the observer's gain for it.
        innovation2: variance of the innovation in the observer's filter [m² or m²/s²].
        of: index of the measured part of the chain.
        along: difference along the motion, where that has another variance.
    """
    derivative = whitened = e.v if of else e.p
    if along is not None:  # scaled to the same variance in every direction
        step = add_scaled(step, along.weight, part_along(along.axis, step))
        whitened = add_scaled(whitened, along.weight, part_along(along.axis, whitened))
    (north, east, down), (x, y, z) = step, whitened
    gained = e.gained + (x * x + y * y + z * z) / innovation2
    score = e.score + (x * north + y * east + z * down) / innovation2
    moves = is_excited(e)
    moved: Real = 0.0
    # One axis after the other. The gain follows from the assumed variance; that of λ̂, in Joseph's
    # form, from the measured noise.
    w, known = e.assumed, e.variance
    s, measured2 = innovation2, innovation2 * e.noise
    for i, of_lambda in ((north, x), (east, y), (down, z)):
        k = w * of_lambda / (s + of_lambda * of_lambda * w)
        left = 1.0 - k * of_lambda
        moved = moved + k * (i - of_lambda * moved)
        w, known = left * w, left * left * known + k * k * measured2
    value = ops.clamp(e.value + ops.where(moves, moved, 0.0), *EFFECTIVENESS_LIMITS)
    moved = value - e.value
    score = score - gained * moved
    assumed, variance = ops.where(moves, w, e.assumed), ops.where(moves, known, e.variance)
    chain = correct_chain((e.p, e.v, e.d, e.c), gain, scale(-1.0, derivative))
    if along is not None:
        chain = correct_chain(chain, along.more, scale(-1.0, part_along(along.axis, derivative)))
    after = Effectiveness(value, variance, assumed, *chain, gained, score, e.noise, e.frozen_s)
    return after, moved


Composite: TypeAlias = Literal["provable", "raw", "off"]
"""Target of the innovations beside the motion: the observer's own d̂, a controller's b̂, or
none."""


class Estimation(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Gains and switches of observer and predictor. Defaults: docs/explanation/law.md."""

    gravity: Annotated[Gravity, msgspec.Meta(description="g [m/s²].")] = GRAVITY
    delay_prediction: Annotated[
        bool,
        msgspec.Meta(
            description="Roll the estimate forward from the pose's time stamp to the instant the "
            "command acts."
        ),
    ] = True
    observer: Annotated[
        Literal["model", "backward_euler"],
        msgspec.Meta(
            description="Velocity from a model-based observer, or from the paper's backward "
            "difference of positions."
        ),
    ] = "model"
    attitude_gain: Annotated[
        float,
        msgspec.Meta(
            ge=0.001,
            le=1.0,
            description="Weight of a pose's attitude against the model's [-]; 1 takes the "
            "measurement.",
        ),
    ] = 1.0
    pose_noise_m: Annotated[
        PoseNoise,
        msgspec.Meta(
            description="Initial position noise, 1σ per axis [m]; then measured in flight."
        ),
    ] = 0.0003
    pose_jitter_s: Annotated[
        Jitter | None,
        msgspec.Meta(
            description="Jitter of the poses' stamps, 1σ: noise along the velocity [s]. Without "
            "it, it is measured in flight; 0: no jitter."
        ),
    ] = None
    velocity_noise_m_s: Annotated[
        VelocityNoise,
        msgspec.Meta(
            description="Velocity noise of a source that measures velocity, 1σ per axis, beside "
            "its bias [m/s]."
        ),
    ] = 0.02
    velocity_bias_m_s: Annotated[
        VelocityBias,
        msgspec.Meta(
            description="Largest mean difference of such a velocity from that of its own "
            "positions, which is then corrected, per axis [m/s]; ArduCopter's, with a simulated "
            "GPS, is 0.016. 0: no correction."
        ),
    ] = 0.05
    position_wander: Annotated[
        Wander,
        msgspec.Meta(
            description="Random walk of the position of such a source against its velocity [m/√s]; "
            "PX4 on simulated GPS: 0.18."
        ),
    ] = 0.2
    pose_wander: Annotated[
        MarkerWander,
        msgspec.Meta(
            description="Random walk of the positions of a source without velocity, beside their "
            "white noise [m/√s]; 0: errors of neighbours are independent. `groundstation replay "
            "evidence` finds 0.0005 and 0.0006 of a Vicon whose errors last some 20 ms."
        ),
    ] = 0.0
    acceleration_noise: Annotated[
        ModelNoise,
        msgspec.Meta(description="White noise of the model's acceleration [m/s² per √Hz]."),
    ] = 0.01
    wind_noise: Annotated[
        WindNoise,
        msgspec.Meta(
            description="White noise of the disturbance's rate [m/s³ per √Hz]: turbulence of 0.2 "
            "m/s² RMS and 2.6 s has 0.18."
        ),
    ] = 0.1
    wind_rate_noise: Annotated[
        WindRateNoise,
        msgspec.Meta(
            description="White noise of that rate's derivative [m/s⁴ per √Hz]: a larger one "
            "follows gusts faster, and more noise."
        ),
    ] = 1.2

    effectiveness_deviation: Annotated[
        ThrustDeviation,
        msgspec.Meta(
            description="Error of thrust over mass before the flight, 1σ [-]; 0: all error is "
            "disturbance."
        ),
    ] = 0.15
    effectiveness_walk: Annotated[
        ThrustWander,
        msgspec.Meta(
            description="Its random walk in flight while its innovations are excited [1/√s]."
        ),
    ] = 0.005

    @property
    def kind(self) -> str:
        """Name of the controller in ``controller.kind``."""
        return str(self.__struct_config__.tag)

    @property
    def composite(self) -> Composite:
        """Use of the innovations: for the observer's own d̂, unless the controller's config
        overrides it.
        """
        return "provable"

    @property
    def kb(self) -> float:
        """Weight of adaptation in V [1/s² per m/s²]: 0 unless the controller adapts."""
        return 0.0


STEP_LIMIT = 0.025
"""Longest single step of the model [s]; longer spans are split."""
NOISE_MEMORY = 100
"""Poses over which the position noise is averaged."""
NOISE_SPAN_S = 0.5
"""Longest time of five poses whose noise is measured [s]: over a longer one motion would count as
noise."""
LOST_INTERVALS = 1.5
"""Interval of poses from which one was lost between, as a multiple of the mean of four [-]:
half-way to two."""
NOISE_FLOOR_M2 = 1e-12
"""Least noise variance of a source [m²]: a micrometre, above float rounding."""
BIAS_MEMORY_S = 10.0
"""Time constant of the mean difference of measured velocities from positions [s]."""
LIFTED_M_S = 0.1
"""Error of the speed at lift-off, 1σ per axis [m/s]."""
LIFTED_M_S2 = 0.5
"""Error of the disturbance at lift-off, 1σ per axis [m/s²]."""


class ModelEstimator:
    """Estimator of the state at the newest pose's stamp, and of its prediction by the commands
    since.

    The state before the first pose is unknown; :meth:`predict` must not be called then.
    """

    def __init__(self, vehicle: Vehicle, gains: Estimation) -> None:
        self._vehicle = vehicle
        self._gains = gains
        self._provable = gains.composite == "provable"
        self._separates = self._provable and gains.effectiveness_deviation > 0.0
        self._is_frozen = self._is_landing = False
        self._held: Vec3 | None = None
        self.actuator_response: ActuatorResponse | None = None
        """Response of the actuators between the last two poses; None at first and after a reset."""
        self._thrust_lag = vehicle.thrust_lag_s
        self._rate_lag = vehicle.rate_lag_s
        white = (gains.acceleration_noise**2, gains.wind_noise**2, gains.wind_rate_noise**2)
        self._still, self._moving = (
            Densities(wander**2, *white) for wander in (gains.pose_wander, gains.position_wander)
        )
        self._noise = gains.pose_noise_m**2
        self._stamp_noise = (self._noise, 0.0)
        self._uneven_s2 = 0.0
        """Variance of the stamps, by their intervals [s²]."""
        self._covariance = initial_covariance(self._noise)
        self._track: AlongTrack | None = None
        self._bias: Vec3 = ZERO
        self._effectiveness = initial_effectiveness(gains.effectiveness_deviation)
        self._recent: deque[tuple[float, Vec3]] = deque(maxlen=5)
        self._reset_count = 0
        self._stamp = 0.0
        self.motion: Motion | None = None
        """Motion at the newest pose; None before the first."""
        self.disturbance: Vec3 = ZERO
        """d̂ at the newest pose [m/s², NED]."""
        self._disturbance_rate: Vec3 = ZERO
        self._disturbance_step: Vec3 = ZERO
        self._drives: deque[tuple[float, ActuatorCommand]] = deque()
        self._path: list[tuple[float, ActuatorResponse, int]] = []

    @property
    def effectiveness(self) -> float:
        """λ̂, true thrust over configured thrust [-]."""
        return float(self._effectiveness.value)

    @property
    def effectiveness_deviation(self) -> float:
        """Standard deviation of λ̂ [-]."""
        return math.sqrt(self._effectiveness.variance)

    @property
    def _learns_thrust(self) -> bool:
        return (
            self._separates and not self._is_frozen and not self._is_landing and self._held is None
        )

    def add_command(self, time_s: float, drive: ActuatorCommand) -> None:
        """Take a command that reaches the actuators at ``time_s`` [s].

        It replaces any for that instant or later.
        """
        since_s, path = schedule(self._drives, self._vehicle, time_s, drive), self._path
        while len(path) > 1 and path[-1][0] > since_s:
            path.pop()

    def freeze_effectiveness(self) -> None:
        """Freeze λ̂ until the next lift-off: the floor's force, or false poses, are no error of the
        thrust.
        """
        self._is_frozen = True

    def set_landing(self, lands: bool) -> None:
        """Freeze λ̂ in a landing: ground effect is no error of the thrust."""
        self._is_landing = lands

    def release(self) -> None:
        """Forget the disturbance before the flight: it was the force of a stand, or a hand."""
        self._covariance, self._track = initial_covariance(self._noise), None
        self._effectiveness = initial_effectiveness(self._gains.effectiveness_deviation)
        self.disturbance = self._disturbance_rate = self._disturbance_step = ZERO

    def lift_off(self, climb_m_s: float, hover_share: float) -> Vec3:
        """Begin to fly from the floor: take the climb speed [m/s], and the hover thrust over the
        configured weight [-].

        The disturbance by the floor's force and friction is forgotten, and so is the estimated
        speed on the floor. The error of the hover thrust is divided between λ̂ and the disturbance
        by their variances; which of them it is can't be observed while thrust is constant. Friction
        ended some time ago, and wind has moved the vehicle since: the significant part of that
        disturbance stays. Return the disturbance that is left [m/s², NED].
        """
        self._is_frozen = self._is_landing = False
        north, east, _ = self.disturbance
        wind = math.hypot(north, east)
        kept = max(wind - LIFTED_M_S2, 0.0) / wind if self._provable and wind else 0.0
        self.release()
        self._covariance = initial_covariance(self._noise, LIFTED_M_S**2, LIFTED_M_S2**2)
        if self.motion is not None:
            velocity = (*self.motion.velocity[:2], -climb_m_s)
            self.motion = msgspec.structs.replace(self.motion, velocity=velocity)
        value = 1.0
        if self._separates:
            by_thrust = (self._gains.effectiveness_deviation * self._gains.gravity) ** 2
            # The disturbance has 1 m/s² by initial_covariance().
            weight = by_thrust / (by_thrust + 1.0)
            value = 1.0 / (1.0 + weight * (hover_share - 1.0))
            e = self._effectiveness
            moved = (0.0, 0.0, hover_share * self._gains.gravity)
            variance = (1.0 - weight) * e.variance
            self._effectiveness = msgspec.structs.replace(
                e, value=value, variance=variance, assumed=variance, d=moved, frozen_s=-1.0
            )
        self.disturbance = (
            kept * north,
            kept * east,
            (value * hover_share - 1.0) * self._gains.gravity,
        )
        return self.disturbance

    def hold(self, disturbance: Vec3, effectiveness: float) -> None:
        """Hold ``disturbance`` [m/s², NED] from the next pose on, and λ̂, until :meth:`resume`."""
        self._held = disturbance
        self._effectiveness = msgspec.structs.replace(self._effectiveness, value=effectiveness)

    def believe(self, motion: Motion, disturbance: Vec3, effectiveness: float) -> None:
        """Set the motion at the newest pose's stamp, regardless of that pose.

        Hold disturbance, from now on, and λ̂.
        """
        self.hold(disturbance, effectiveness)
        self.disturbance, self._disturbance_rate = disturbance, ZERO
        self.motion = motion
        self._path = [(self._stamp, begin_response(motion), 0)]

    def reset_motion(self, motion: Motion) -> None:
        """Set the motion at the newest pose's stamp, and estimate the disturbance anew."""
        self.believe(motion, self.disturbance, float(self._effectiveness.value))
        self._covariance, self._track = initial_covariance(self._noise), None
        self.resume()

    def resume(self) -> None:
        """End :meth:`hold`: the poses are believed again."""
        self._held = None

    def drive(self, disturbance: Vec3) -> None:
        """Drive the observer by b̂ [m/s², NED] instead of its own d̂ (composite adaptation off, or
        raw).
        """
        self.disturbance = disturbance

    @property
    def noise_m(self) -> float:
        """Measured position noise of the poses, 1σ per axis [m]."""
        return math.sqrt(self._noise)

    def find_noise(self, velocity: Vec3) -> float:
        """Position noise of a pose at ``velocity`` [m/s], 1σ per axis [m]: beside the measured one
        that by its stamp.

        A vehicle at rest does not show how much its stamps jitter, but their intervals do.
        """
        configured_s = self._gains.pose_jitter_s
        jitter_s = math.sqrt(self._uneven_s2) if configured_s is None else configured_s
        return math.hypot(self.noise_m, *(jitter_s * speed for speed in velocity))

    def look_ahead(self, time_s: float) -> Ahead | None:
        """Predict the state at ``time_s``, whether delays are predicted or not.

        None before the first pose.
        """
        motion = self.motion
        if motion is None:
            return None
        response = self._integrate_commands(time_s)
        return Ahead(time_s, response, self._at(motion, response, time_s - self._stamp))

    def update(self, pose: Pose, ahead: Ahead | None = None) -> None:
        """Correct the model by one pose.

        ``ahead``: result of :meth:`look_ahead` for its instant.
        """
        self.actuator_response = None
        previous = self.motion
        if previous is None:
            self._begin(self._first(pose), pose)
            return
        dt = pose.time_s - self._stamp
        if dt <= 0.0:
            return
        if pose.reset_count != self._reset_count:
            self._move_origin(pose, previous, dt)
            return
        self._measure_noise(pose)
        gains = self._gains
        _, response, model = self._ahead_to(pose, ahead)
        self.actuator_response = response
        if self._learns_thrust:
            mass, walk = self._vehicle.mass_kg, gains.effectiveness_walk
            self._effectiveness = predict_effectiveness(
                FLOATS, self._effectiveness, dt, response, mass, walk
            )
        step = subtract(pose.position_ned, model.position)
        disturbance = add_scaled(self.disturbance, dt, self._disturbance_rate)
        expected, track, noise, late2 = self._expect(pose, dt, model.velocity)
        expected = widen_covariance(FLOATS, expected, noise + late2, step)
        if track is not None:
            track = track._replace(
                covariance=widen_covariance(FLOATS, track.covariance, noise + late2, step)
            )
        chain = (model.position, model.velocity, disturbance)
        chain = self._correct(chain, step, expected, track, noise, noise + late2, 0)
        if pose.velocity_ned is not None:
            noise, measured = gains.velocity_noise_m_s**2, subtract(pose.velocity_ned, self._bias)
            chain = self._correct(
                chain, subtract(measured, chain[1]), self._covariance, self._track, noise, noise, 1
            )
            if len(self._recent) > 1 and not self._is_frozen and self._held is None:
                self._learn_bias(pose, measured, dt)
        position, velocity, self.disturbance = chain
        if self._held is not None:
            self.disturbance, self._disturbance_rate = self._held, ZERO
        if gains.observer == "backward_euler":
            position = pose.position_ned
            velocity = add_scaled(ZERO, 1.0 / dt, subtract(position, previous.position))
        attitude = correct_attitude(FLOATS, model.attitude, pose.attitude, gains.attitude_gain)
        self._begin(Motion(position, velocity, attitude, model.thrust, model.rates), pose)

    def _move_origin(self, pose: Pose, previous: Motion, dt: float) -> None:
        """Take the position of a ``pose`` whose source moved its origin, not the vehicle; keep
        velocity and disturbance.
        """
        moved = self._at(previous, self._integrate_commands(pose.time_s), dt)
        self.disturbance = add_scaled(self.disturbance, dt, self._disturbance_rate)
        moved = msgspec.structs.replace(moved, position=pose.position_ned, attitude=pose.attitude)
        self._begin(moved, pose)
        self._recent.clear()

    def update_attitude(self, pose: Pose, ahead: Ahead | None = None) -> None:
        """Take the attitude of one pose alone; all else is the model's."""
        if self.motion is None or pose.time_s <= self._stamp:
            return
        _, self.actuator_response, model = self._ahead_to(pose, ahead)
        self._begin(msgspec.structs.replace(model, attitude=pose.attitude), pose)

    def _ahead_to(self, pose: Pose, ahead: Ahead | None) -> Ahead:
        ahead = ahead or self.look_ahead(pose.time_s)
        assert ahead is not None and ahead.time_s == pose.time_s, (
            "there was a pose, and the prediction is for this one"
        )
        return ahead

    def _begin(self, motion: Motion, pose: Pose) -> None:
        """Set ``motion`` at the stamp of ``pose``; drop commands that no longer act."""
        stamp, drives = pose.time_s, self._drives
        while len(drives) > 1 and drives[1][0] <= stamp:
            drives.popleft()
        self.motion, self._stamp, self._reset_count = motion, stamp, pose.reset_count
        self._path = [(stamp, begin_response(motion), 0)]

    def _expect(
        self, pose: Pose, dt: float, velocity: Vec3
    ) -> tuple[Covariance, AlongTrack | None, float, float]:
        """Predict the covariances across and along the motion at ``pose``, and the noise of both
        [m²].

        The second noise is added along the motion; without it there is one covariance.
        """
        densities = self._still if pose.velocity_ned is None else self._moving
        expected = predict_covariance(self._covariance, dt, densities)
        jitter_s = self._gains.pose_jitter_s
        noise, jitter2 = split_noise(
            FLOATS, self._noise, self._stamp_noise, NOISE_FLOOR_M2, jitter_s
        )
        if jitter2 == 0.0:
            return expected, None, noise, 0.0
        axis, speed2 = find_direction(FLOATS, velocity)
        along = expected
        if self._track is not None:
            along = predict_covariance(self._track.covariance, dt, densities)
            expected, along = turn_track(expected, AlongTrack(self._track.axis, along), axis)
        return expected, AlongTrack(axis, along), noise, jitter2 * speed2

    def consistency(self, pose: Pose) -> float:
        """Normalized innovation squared of the next ``pose``: 3 on average where the filter is
        consistent.
        """
        ahead = self.predict(pose.time_s).motion
        expected, track, noise, late2 = self._expect(
            pose, pose.time_s - self._stamp, ahead.velocity
        )
        x, y, z = step = subtract(pose.position_ned, ahead.position)
        off2 = x * x + y * y + z * z
        if track is None:
            return off2 / (expected[PP] + noise)
        x, y, z = part_along(track.axis, step)
        along2 = x * x + y * y + z * z
        return (off2 - along2) / (expected[PP] + noise) + along2 / (
            track.covariance[PP] + noise + late2
        )

    def _correct(
        self,
        chain: tuple[Vec3, Vec3, Vec3],
        step: Vec3,
        expected: Covariance,
        track: AlongTrack | None,
        noise: float,
        along_noise: float,
        of: int,
    ) -> tuple[Vec3, Vec3, Vec3]:
        """Correct position, velocity and disturbance by one innovation.

        Covariances, ĉ, λ̂ and b̂'s step in place.

        Args:
            chain: position, velocity and disturbance before.
            step: innovation of position [m] (``of`` = 0) or of velocity [m/s] (``of`` = 1), NED.
            expected: covariance before, across the motion where there is a ``track``.
            track: covariance along the motion; None where it is the same.
            noise: variance of the measurement's noise across the motion [m² or m²/s²].
            along_noise: the same along it.
            of: index of the measured part of the chain.
        """
        index = VV if of else PP
        gain, self._covariance = update_covariance(expected, noise, of)
        variance, along = expected[index] + noise, None
        self._track = None
        if track is not None:
            updated = update_covariance(track.covariance, along_noise, of)
            along2 = track.covariance[index] + along_noise
            along, self._track = weigh_along(FLOATS, track.axis, gain, updated, variance, along2)
        full: Chain = (*chain, self._disturbance_rate)
        parts = [] if along is None else [(along.more, part_along(along.axis, step))]
        for by, part in (*parts, (gain, step)):
            full = correct_chain(full, by, part)
            if self._gains.composite == "raw":
                self._disturbance_step = add_scaled(self._disturbance_step, by[2], part)
        if self._learns_thrust:
            # A change of λ̂ changes the chain, too.
            e, moved = update_effectiveness(
                FLOATS, self._effectiveness, step, gain, variance, of, along
            )
            self._effectiveness, full = e, apply_effectiveness(full, moved, e)
        if self._provable:
            self._disturbance_rate = full[3]
        return full[0], full[1], full[2] if self._provable else chain[2]

    def predict(self, time_s: float) -> Estimate:
        """Predict the state at ``time_s``.

        Without delay prediction it is that of the newest pose.
        """
        motion = self.motion
        assert motion is not None, "predict() before the first pose"
        h = time_s - self._stamp
        ahead = self._at(motion, self._integrate_commands(time_s), h)
        if not self._gains.delay_prediction:
            # The actuators are modelled from our own commands and need no pose.
            ahead = msgspec.structs.replace(motion, thrust=ahead.thrust, rates=ahead.rates)
        step, self._disturbance_step = self._disturbance_step, ZERO
        disturbance = add_scaled(self.disturbance, h, self._disturbance_rate)
        value, deviation = self._effectiveness.value, self.effectiveness_deviation
        return Estimate(time_s, ahead, disturbance, step, value, deviation)

    def _measure_noise(self, pose: Pose) -> None:
        """Follow the noise of the source by fourth differences, and that of its stamps by their
        second ones.
        """
        recent = self._recent
        recent.append((pose.time_s, pose.position_ned))
        if len(recent) < 5:
            return
        times, places = zip(*recent, strict=True)
        span_s = times[-1] - times[0]
        if span_s > NOISE_SPAN_S:
            return
        variance, along, way2 = fourth_difference(times, places)
        self._noise = max(self._noise + (variance - self._noise) / NOISE_MEMORY, NOISE_FLOOR_M2)
        before, speed2 = self._stamp_noise
        speed2 += (way2 / (span_s * span_s) - speed2) / NOISE_MEMORY
        self._stamp_noise = (before + (along - before) / NOISE_MEMORY, speed2)
        last_s, newest_s = times[3] - times[2], times[4] - times[3]
        if max(last_s, newest_s) < LOST_INTERVALS * 0.25 * span_s:
            # Of three independent stamps, weights 1, -2 and 1.
            uneven_s2 = (newest_s - last_s) ** 2 / 6.0
            self._uneven_s2 += (uneven_s2 - self._uneven_s2) / NOISE_MEMORY

    def _learn_bias(self, pose: Pose, measured: Vec3, dt: float) -> None:
        """Correct the bias by the positions' displacement.

        ``measured`` [m/s] is without the bias so far.
        """
        (_, before), (_, now) = self._recent[-2], self._recent[-1]
        most, k = self._gains.velocity_bias_m_s, 1.0 / BIAS_MEMORY_S
        x, y, z = add_scaled(
            self._bias, k, subtract(add_scaled(ZERO, dt, measured), subtract(now, before))
        )
        self._bias = (max(-most, min(most, x)), max(-most, min(most, y)), max(-most, min(most, z)))

    def _first(self, pose: Pose) -> Motion:
        velocity = pose.velocity_ned or (0.0, 0.0, 0.0)
        drive = self._drives[-1][1] if self._drives else ActuatorCommand(0.0, (0.0, 0.0, 0.0))
        return Motion(pose.position_ned, velocity, pose.attitude, drive.thrust, drive.rates)

    def _integrate_commands(self, end: float) -> ActuatorResponse:
        """Integrate the actuators from the newest pose to ``end`` [s].

        Steps are kept for the next call.
        """
        drives, path = self._drives, self._path
        while len(path) > 1 and path[-1][0] > end:
            path.pop()
        time, state, index = path[-1]
        last = len(drives) - 1
        while time < end - 1e-9:
            changes = drives[index + 1][0] if index < last else math.inf
            while changes <= time + 1e-9:
                index += 1
                changes = drives[index + 1][0] if index < last else math.inf
            drive = drives[index][1] if drives else ActuatorCommand(state.thrust, state.rates)
            longest = time + STEP_LIMIT
            until = changes if changes < longest else longest
            if until > end:
                return integrate_actuators(
                    FLOATS, state, drive, end - time, self._thrust_lag, self._rate_lag
                )
            state = integrate_actuators(
                FLOATS, state, drive, until - time, self._thrust_lag, self._rate_lag
            )
            time = until
            path.append((time, state, index))
        return state

    def _at(self, motion: Motion, response: ActuatorResponse, h: float) -> Motion:
        """Integrate ``motion`` of the newest pose by ``h`` [s], in which the actuators gave
        ``response``.
        """
        vehicle, (x, y, z) = self._vehicle, self.disturbance
        mass, other = vehicle.mass_kg / self._effectiveness.value, (x, y, z + self._gains.gravity)
        return integrate_motion(
            motion, response, h, mass, other, self._disturbance_rate, vehicle.drag_per_s
        )
