"""A run's text files on a full disk."""

from pathlib import Path

import pytest

from sim.runs.simulation import TextOutput


@pytest.mark.parametrize("lines", [0, 1, 5000])
def test_a_text_on_a_full_disk_ends_with_one_warning_and_nothing_raises(
    lines: int, capsys: pytest.CaptureFixture[str]
) -> None:
    output = TextOutput(Path("/dev/full"))
    for _ in range(lines):
        output.write("a line of a pose\n")
    output.close()
    told = "WARNING: the end of /dev/full is missing: No space left on device\n"
    assert capsys.readouterr().err == (told if lines else "")
