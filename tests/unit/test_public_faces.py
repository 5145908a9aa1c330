"""links/__init__.py and sim/__init__.py: what a user may import is there, and each name has its words."""

import re
from types import ModuleType

import pytest

import links
import sim


@pytest.mark.parametrize("face", [links, sim])
def test_every_public_name_can_be_imported_and_is_told_of(face: ModuleType) -> None:
    handed = {name for names in face._MODULES.values() for name in names}
    assert all(getattr(face, name) is not None for name in handed)
    told = set(re.findall(r"``(\w+)``", face.__doc__ or ""))
    assert handed <= told


def test_the_two_lines_of_the_face_fly() -> None:
    world, config = sim.prepare(sim.SCENARIOS["paper"], ["vehicle.mass_kg=0.9"])
    assert config.vehicle.mass_kg == 0.9
    result = sim.fly(world, config, seed=0, duration_s=2.0)
    assert result.completed and result.datagrams > 0
