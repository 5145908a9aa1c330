"""The shared key on disk."""

from pathlib import Path

import pytest

from links.key_file import KEY_BYTES, make_key, read_key


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


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620])
def test_a_key_that_others_may_read_or_change_is_refused(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "key"
    make_key(path)
    path.chmod(mode)
    with pytest.raises(ValueError, match="others may know the key"):
        read_key(path)


@pytest.mark.parametrize("text", ["", "00" * 32, "ab" * 31, "ab" * 33, "not hexadecimal", "é" * 32])
def test_what_is_no_key_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "key"
    path.write_text(text)
    path.chmod(0o600)
    with pytest.raises(ValueError, match="64 hexadecimal digits"):
        read_key(path)


def test_a_key_that_is_not_there_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="make a key with --make-key"):
        read_key(tmp_path / "nothing")
    with pytest.raises(ValueError, match=r"mode 0\d+, so others|cannot read"):
        read_key(tmp_path)
