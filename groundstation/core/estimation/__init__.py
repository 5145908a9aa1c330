"""The estimator: a Kalman filter at the newest pose, rolled forward through the commands sent since."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.core.estimation.estimator import (
        NOISE_FLOOR_M2,
        NOISE_MEMORY,
        STEP_LIMIT,
        Composite,
        Estimation,
        ModelEstimator,
        NonNegative,
        Positive,
    )
    from groundstation.core.estimation.observer import (
        Covariance,
        Densities,
        Effectiveness,
        correct,
        correct_attitude,
        correct_by_both,
        fourth_difference,
        initial_covariance,
        initial_effectiveness,
        innovation,
        predict_covariance,
        predict_effectiveness,
        update_covariance,
        update_effectiveness,
        update_moving_covariance,
        widen_covariance,
    )

_MODULES = {
    "estimator": (
        "Composite",
        "Estimation",
        "ModelEstimator",
        "NOISE_FLOOR_M2",
        "NOISE_MEMORY",
        "NonNegative",
        "Positive",
        "STEP_LIMIT",
    ),
    "observer": (
        "Covariance",
        "Densities",
        "Effectiveness",
        "correct",
        "correct_attitude",
        "correct_by_both",
        "fourth_difference",
        "initial_covariance",
        "initial_effectiveness",
        "innovation",
        "predict_covariance",
        "predict_effectiveness",
        "update_covariance",
        "update_effectiveness",
        "update_moving_covariance",
        "widen_covariance",
    ),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
