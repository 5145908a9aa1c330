"""Errors of a configuration, on their way from a worker process to the one that started it."""

import inspect
import pickle

import pytest

from groundstation.config import errors
from groundstation.config.config_notices import config_notice

SENTENCE = config_notice("file.missing", path="lab.toml")

RAISED = (
    errors.ConfigError("vehicle.mass_kg", "too light", "lab.toml"),
    errors.ConfigError("--out", SENTENCE),
    errors.ArgumentError("--workers", SENTENCE),
    errors.ArgumentError("--set", "expected key=value"),
    errors.Problem(("link", "kind"), SENTENCE),
)


@pytest.mark.parametrize("error", RAISED, ids=lambda error: f"{type(error).__name__}: {error}")
def test_an_error_is_the_same_after_it_was_pickled(error: Exception) -> None:
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error)
    assert str(again) == str(error)
    assert vars(again) == vars(error)


def test_every_error_of_a_configuration_is_pickled_above() -> None:
    classes = {kind for _, kind in inspect.getmembers(errors, inspect.isclass) if issubclass(kind, Exception)}
    assert classes == {type(error) for error in RAISED}
