"""The estimator: a Kalman filter at the newest pose, rolled forward through the commands sent since."""

from groundstation.core.estimation import effectiveness as effectiveness

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.core.estimation.effectiveness import Effectiveness, initial_effectiveness
    from groundstation.core.estimation.estimator import NOISE_FLOOR_M2, NOISE_MEMORY, STEP_LIMIT, ModelEstimator
    from groundstation.core.estimation.observer import (
        Covariance,
        Densities,
        corrected,
        corrected_attitude,
        corrected_twice,
        fourth_difference,
        initial_covariance,
        innovation,
        predict_covariance,
        update_covariance,
    )
    from groundstation.core.estimation.settings import Composite, Estimation, NonNegative, Positive

_MODULES = {
    "effectiveness": ("Effectiveness", "initial_effectiveness"),
    "estimator": ("ModelEstimator", "NOISE_FLOOR_M2", "NOISE_MEMORY", "STEP_LIMIT"),
    "observer": (
        "Covariance",
        "Densities",
        "corrected",
        "corrected_attitude",
        "corrected_twice",
        "fourth_difference",
        "initial_covariance",
        "innovation",
        "predict_covariance",
        "update_covariance",
    ),
    "settings": ("Composite", "Estimation", "NonNegative", "Positive"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
