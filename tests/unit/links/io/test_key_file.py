"""A new key on disk; how one is read, tests/unit/links/mavlink/test_mavlink_signing.py knows."""

from pathlib import Path

import pytest

from links.io import make_key, read_key

# By their numbers: a limit that the test took from the code would bear out any value.
KEY_BYTES = 32


def test_a_new_key_is_for_its_owner_alone_and_different_each_time(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    make_key(first)
    make_key(second)
    assert first.stat().st_mode & 0o777 == 0o600
    assert len(read_key(first)) == KEY_BYTES
    assert read_key(first) != read_key(second)


def test_a_key_is_never_written_over(tmp_path: Path) -> None:
    make_key(tmp_path / "key")
    before = read_key(tmp_path / "key")
    with pytest.raises(ValueError, match="File exists"):
        make_key(tmp_path / "key")
    assert read_key(tmp_path / "key") == before
