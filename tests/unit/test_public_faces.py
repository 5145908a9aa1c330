"""The faces that users import from hold what they tell of, and asking costs little."""

import subprocess
import sys

import pytest

import groundstation
import links
import sim


def test_a_name_that_is_not_handed_on_is_named() -> None:
    for face in (groundstation, links, sim):
        with pytest.raises(
            AttributeError, match=f"module '{face.__name__}' has no attribute 'simulat'"
        ):
            face.simulat  # noqa: B018


def test_without_the_simulator_what_flies_in_it_says_so_in_a_sentence() -> None:
    code = "import sys; sys.modules['sim'] = None\nfrom groundstation import simulate"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (
        said.stderr.strip()
        .splitlines()[-1]
        .startswith("ImportError: groundstation.simulate flies in the simulator")
    )


HEAVY = {"asyncio", "matplotlib", "msgspec", "numpy", "pandas", "pymavlink", "scipy", "textual"}
"""Modules that take longer to load than all else of a start."""


@pytest.mark.parametrize(
    ("code", "without"),
    [
        ("import groundstation", HEAVY),
        ("from groundstation.__main__ import parser; parser().format_help()", HEAVY),
        ("from sim.__main__ import parser; parser().format_help()", HEAVY),
        (
            "from groundstation.interfaces import cli",
            {"groundstation.flight", "matplotlib", "mcap", "numpy", "pandas", "scipy", "textual"},
        ),
        (
            "from groundstation import simulate; simulate(duration=0.1, record=False)",
            {"matplotlib", "mcap", "multiprocessing", "pandas", "scipy", "textual"},
        ),
    ],
    ids=["import", "help", "help of the simulator", "a request", "a simulated flight"],
)
def test_nothing_heavy_is_loaded_where_nothing_needs_it(code: str, without: set[str]) -> None:
    told = f"import sys\n{code}\nprint(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=True)
    assert without & set(done.stdout.split()) == set()
