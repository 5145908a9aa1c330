"""docs/explanation/law.md says what the code has: every gain, commands that work, and the figures
they give.
"""

import json
import shlex
from pathlib import Path

import msgspec
import pytest

from groundstation.core.control import Gains
from sim.__main__ import parser
from sim.scenarios import SCENARIOS, prepare

TEXT = (Path(__file__).parents[2] / "docs" / "explanation" / "law.md").read_text("utf-8")
COMMANDS = [line for line in TEXT.splitlines() if line.startswith("groundstation-sim fly ")]
FIELDS = {f.name: f.default for f in msgspec.structs.fields(Gains) if f.name != "kind"}


def rows(table: str) -> list[list[str]]:
    """The cells of the table between the marks of that name, without its head."""
    body = TEXT.split(f"<!-- {table}:begin -->")[1].split(f"<!-- {table}:end -->")[0]
    lines = [line for line in body.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line[1:-1].split("|")] for line in lines[2:]]


def test_the_table_of_gains_has_each_default() -> None:
    told = {row[0].strip("`"): row[2] for row in rows("gains")}
    assert {
        name: one if isinstance(FIELDS.get(name), str) else json.loads(one)
        for name, one in told.items()
    } == FIELDS


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
