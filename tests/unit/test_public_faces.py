"""The faces that users import from: what they may ask for is there and told of, and asking costs little."""

import subprocess
import sys

import pytest

import groundstation
import links
import sim
from tests.unit.test_project import bare_pythons


def test_a_name_that_is_not_handed_on_is_named() -> None:
    for face in (groundstation, links, sim):
        with pytest.raises(AttributeError, match=f"module '{face.__name__}' has no attribute 'simulat'"):
            face.simulat  # noqa: B018


def test_without_the_simulator_what_flies_in_it_says_so_in_a_sentence() -> None:
    code = "import sys; sys.modules['sim'] = None\nfrom groundstation import simulate"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert said.stderr.strip().splitlines()[-1].startswith("ImportError: groundstation.simulate flies in the simulator")


def test_to_import_groundstation_costs_at_most_two_and_a_half_bare_pythons() -> None:
    assert bare_pythons([sys.executable, "-c", "import groundstation"], 2.5) <= 2.5


def test_a_simulated_flight_loads_no_tables_and_no_pictures() -> None:
    code = (
        "import sys; from groundstation import simulate; simulate(duration=0.1, record=False)\n"
        "print({'pandas', 'matplotlib', 'scipy'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
