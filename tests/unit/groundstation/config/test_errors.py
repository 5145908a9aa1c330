"""Errors of a configuration, from a worker process and of files."""

import pickle
from pathlib import Path

import pytest

from groundstation.config import UserCodeFault, errors
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


def test_a_fault_in_the_users_code_brings_the_users_frames_and_none_of_the_worker() -> None:
    try:
        raise RuntimeError("no gains for this vehicle")
    except RuntimeError as error:
        fault = UserCodeFault("controller mine:Bad", error)
    again = pickle.loads(pickle.dumps(fault))
    again.__cause__ = RuntimeError("frames of the pool of workers")
    assert str(again) == "controller mine:Bad failed: RuntimeError: no gains for this vehicle"
    assert again.frames() == fault.frames()
    assert again.frames().endswith("RuntimeError: no gains for this vehicle\n")


def test_a_wrong_value_of_the_users_code_brings_no_frames() -> None:
    again = pickle.loads(pickle.dumps(UserCodeFault("controller mine:Bad returned 3")))
    again.__cause__ = RuntimeError("frames of the pool of workers")
    assert (str(again), again.frames()) == ("controller mine:Bad returned 3", "")


def test_a_file_of_a_folder_that_can_not_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "results.csv").mkdir()
    with (
        pytest.raises(
            errors.ConfigError, match=r"^--out: cannot write .*results\.csv: Is a directory$"
        ),
        errors.refuse_io("--out", "file.unwritten", tmp_path),
    ):
        (tmp_path / "results.csv").write_text("a table")
