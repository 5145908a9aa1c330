"""The estimator: a Kalman filter at the newest pose, rolled forward through the commands sent since."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.core.estimation.estimator import (
        JITTER_SHOWS,
        NOISE_FLOOR_M2,
        NOISE_MEMORY,
        NOISE_SPAN_S,
        PP,
        STEP_LIMIT,
        AlongTrack,
        Composite,
        Covariance,
        Densities,
        Effectiveness,
        Estimation,
        ModelEstimator,
        NonNegative,
        Positive,
        StampNoise,
        correct,
        correct_attitude,
        correct_by_both,
        find_direction,
        fourth_difference,
        initial_covariance,
        initial_effectiveness,
        innovation,
        part_along,
        predict_covariance,
        predict_effectiveness,
        split_noise,
        turn_track,
        update_covariance,
        update_effectiveness,
        update_moving_covariance,
        weigh_along,
        widen_covariance,
    )


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
