"""The estimator: a Kalman filter at the newest pose, rolled forward through the commands sent
since.
"""

from groundstation.core.estimation.bounds import (
    AccelerationBound,
    AccelerationGain,
    FilterTime,
    Gain,
    GainOrOff,
    IntegralGain,
    PositionGain,
    Ratio,
    Smoothing,
    SpeedBound,
    WitnessGain,
)
from groundstation.core.estimation.estimator import (
    LOST_INTERVALS,
    NOISE_FLOOR_M2,
    NOISE_MEMORY,
    NOISE_SPAN_S,
    PP,
    STEP_LIMIT,
    Ahead,
    AlongTrack,
    Chain,
    Composite,
    Covariance,
    Densities,
    Effectiveness,
    Estimation,
    ModelEstimator,
    StampNoise,
    apply_effectiveness,
    correct_attitude,
    correct_chain,
    find_direction,
    fourth_difference,
    initial_covariance,
    initial_effectiveness,
    part_along,
    predict_covariance,
    predict_effectiveness,
    split_noise,
    turn_track,
    update_covariance,
    update_effectiveness,
    weigh_along,
    widen_covariance,
)
from groundstation.core.estimation.reckoning import Reckoning, Trusted
from groundstation.core.estimation.significance import HIGHLY_SIGNIFICANT, SIGNIFICANT
