"""docs/explanation/law.md: the condition on κ by the default gains, and commands that work."""

import shlex
from pathlib import Path

import pytest

from groundstation.core.control import Gains
from sim.__main__ import parser
from sim.scenarios import SCENARIOS, prepare

TEXT = (Path(__file__).parents[2] / "docs" / "explanation" / "law.md").read_text("utf-8")
COMMANDS = [line for line in TEXT.splitlines() if line.startswith("groundstation-sim fly ")]


def test_the_condition_on_kappa_is_met_by_the_defaults_and_said_so() -> None:
    default = Gains()
    assert default.kb**2 * default.kappa < 4.0 * default.k3
    assert (default.b_bound + default.epsilon) ** 2 <= 2.0 * default.b_bound**2  # so that L = 1
    assert f"{default.kb**2 * default.kappa:g} < {4.0 * default.k3:g}" in TEXT


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_is_accepted(command: str) -> None:
    args = parser().parse_args(shlex.split(command)[1:])
    assert args.seed == 0
    prepare(SCENARIOS[args.scenario], args.overrides, controller=args.controller)
